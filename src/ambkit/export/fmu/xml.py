"""``modelDescription.xml`` and ``buildDescription.xml``, for FMI 2.0 and 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal
from xml.etree import ElementTree

from ambkit.base.escaping import one_line
from ambkit.data.signals import signal
from ambkit.estimate.machine_model import several

Fmi = Literal[2, 3]

COMPILER_OPTIONS = "-std=c99 -ffp-contract=off"  #: Flags for equal bits on every processor.

_CAUSALITY = {"time": "independent", "fixed": "parameter", "tunable": "parameter"}
_LOG = {
    "logStatusDiscard": "A value or a step that was refused",
    "logStatusError": "A call that was refused",
}


@dataclass(frozen=True)
class Model:
    """Content of the descriptions of a model."""

    identifier: str  #: C identifier, and name of the binary.
    name: str  #: Readable name.
    about: str
    version: str  #: Version of ambkit.
    token: str  #: GUID or instantiation token.
    sampling_time: float  #: [s].
    variables: Sequence[Variable]  #: In the order of their value references.
    sources: Sequence[str]  #: Files to compile, relative to ``sources/``.

    @property
    def rates(self) -> list[Variable]:
        """Derivatives of its states, for model exchange."""
        return [variable for variable in self.variables if variable.rate_of]

    @property
    def events(self) -> list[Variable]:
        """Event indicators."""
        return [variable for variable in self.variables if variable.event]


def model_description(model: Model, fmi: Fmi) -> str:
    """Write ``modelDescription.xml``."""
    token = {2: "guid", 3: "instantiationToken"}[fmi]
    indicators = {"numberOfEventIndicators": str(len(model.events))} if fmi == 2 else {}
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": model.name,
            token: model.token,
            "description": model.about,
            "generationTool": f"ambkit {model.version}",
            "variableNamingConvention": "structured",
        }
        | (indicators if model.events else {}),
    )
    if model.rates:
        _interface(root, "ModelExchange", model, fmi, {})
    own = {"canHandleVariableCommunicationStepSize": "true"}
    own |= {"fixedInternalStepSize": _text(model.sampling_time)} if fmi == 3 else {}
    _interface(root, "CoSimulation", model, fmi, own)
    _units(root, model.variables)
    categories = ElementTree.SubElement(root, "LogCategories")
    for name, text in _LOG.items():
        ElementTree.SubElement(categories, "Category", name=name, description=text)
    step = _text(model.sampling_time)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    variables = ElementTree.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        at = _places(model.variables, 1 if fmi == 2 else 0)
        rate = {"derivative": at[variable.rate_of]} if variable.rate_of else {}
        _variable(variables, reference, variable, rate, fmi)
    _structure(root, model.variables, fmi)
    return written(root)


def build_description(model: Model) -> str:
    """Write ``sources/buildDescription.xml`` of FMI 3.0."""
    root = ElementTree.Element("fmiBuildDescription", fmiVersion="3.0")
    build = ElementTree.SubElement(root, "BuildConfiguration", modelIdentifier=model.identifier)
    sources = ElementTree.SubElement(
        build,
        "SourceFileSet",
        {"language": "C99", "compiler": "gcc", "compilerOptions": COMPILER_OPTIONS},
    )
    for name in model.sources:
        ElementTree.SubElement(sources, "SourceFile", name=name)
    return written(root)


def _interface(
    root: ElementTree.Element, name: str, model: Model, fmi: Fmi, own: Mapping[str, str]
) -> None:
    state = "FMUstate" if fmi == 2 else "FMUState"
    attributes = {
        "modelIdentifier": model.identifier,
        **own,
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    element = ElementTree.SubElement(root, name, attributes)
    if fmi == 2:
        element.set("canNotUseMemoryManagementFunctions", "true")
        files = ElementTree.SubElement(element, "SourceFiles")
        for name in model.sources:
            ElementTree.SubElement(files, "File", name=name)


def _units(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    used = {variable.unit for variable in variables}
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name in UNITS:
        if name in used:
            unit = ElementTree.SubElement(definitions, "Unit", name=name)
            powers = {base: str(exponent) for base, exponent in exponents(name).items()}
            ElementTree.SubElement(unit, "BaseUnit", powers)


def _common(reference: int, variable: Variable) -> dict[str, str]:
    """Return the attributes of a variable common to both versions."""
    variability: str = variable.role
    if variability not in ("fixed", "tunable"):
        variability = "discrete" if variable.held or variable.integer else "continuous"
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.about,
        "causality": _CAUSALITY.get(variable.role, variable.role),
        "variability": variability,
    }
    calculated = variable.role in ("output", "local")
    return attributes | ({"initial": "calculated"} if calculated else {})


def _number(variable: Variable) -> dict[str, str]:
    """Return the attributes of a variable's value."""
    attributes = {} if variable.integer else {"unit": variable.unit}
    if variable.limit in ("not negative", "positive"):
        attributes["min"] = "0.0"
    if variable.role not in ("time", "output", "local"):
        attributes["start"] = _text(variable.start)
    return attributes


def _variable(
    parent: ElementTree.Element, reference: int, variable: Variable, rate: dict[str, str], fmi: Fmi
) -> None:
    own, common = _number(variable) | rate, _common(reference, variable)
    if fmi == 2:
        element = ElementTree.SubElement(parent, "ScalarVariable", common)
        ElementTree.SubElement(element, "Integer" if variable.integer else "Real", own)
    else:
        ElementTree.SubElement(parent, "Int32" if variable.integer else "Float64", common | own)


def _places(variables: Sequence[Variable], first: int) -> Mapping[str, str]:
    return {variable.name: str(first + i) for i, variable in enumerate(variables)}


def _structure(root: ElementTree.Element, variables: Sequence[Variable], fmi: Fmi) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    at = _places(variables, 1 if fmi == 2 else 0)
    unknowns = {
        ("Outputs", "Output"): [v for v in variables if v.role == "output"],
        ("Derivatives", "ContinuousStateDerivative"): [v for v in variables if v.rate_of],
        ("InitialUnknowns", "InitialUnknown"): [
            v for v in variables if v.role == "output" or (v.role == "local" and not v.event)
        ],
        ("", "EventIndicator"): [v for v in variables if v.event],
    }
    for (group, name), those in unknowns.items():
        if fmi == 2 and (not group or (group == "Derivatives" and not those)):
            continue
        parent = ElementTree.SubElement(structure, group) if fmi == 2 else structure
        for variable in those:
            key = "index" if fmi == 2 else "valueReference"
            follows = {"dependencies": _follows(variable, at)} if name == "Output" else {}
            ElementTree.SubElement(
                parent, "Unknown" if fmi == 2 else name, {key: at[variable.name]} | follows
            )


def _follows(output: Variable, at: Mapping[str, str]) -> str:
    """Return the direct dependencies of an output."""
    return " ".join(sorted((at[name] for name in output.follows), key=int))


def _text(value: float) -> str:
    return repr(float(value))  # the shortest exact text


def written(root: ElementTree.Element) -> str:
    """Return a document as text."""
    # the library escapes, but also writes characters that XML 1.0 cannot hold
    for element in root.iter():
        element.attrib = {key: one_line(value) for key, value in element.items()}
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


Role = Literal["time", "fixed", "tunable", "input", "output", "local"]
Limit = Literal["any", "not negative", "positive", "losable"]


@dataclass(frozen=True)
class Variable:
    """A variable of a model; its value reference is its index in the table."""

    name: str  #: Name in the importer.
    #: Fixed parameters hold from the start, tunable ones can be changed between steps; local ones
    #: are for model exchange only.
    role: Role
    unit: str  #: As in `UNITS`; empty for integers.
    about: str  #: Short description.
    start: float = 0.0  #: Start value; none for an output.
    #: Limits of a settable value; losable ones may be NaN, as for a lost sensor.
    limit: Limit = "any"
    #: Inputs and parameters on which an output depends directly, not with the next step.
    follows: tuple[str, ...] = ()
    held: bool = False  #: Whether it changes only with a sample.
    rate_of: str = ""  #: State of which it is the derivative.
    event: bool = False  #: Whether a change of its sign is an event.
    #: C name of the first of contiguous variables; empty for others.
    first: str = ""

    @property
    def integer(self) -> bool:
        """Whether it is an integer, which has no unit."""
        return not self.unit

    @property
    def reference(self) -> str:
        """Name of its value reference in C."""
        return "VR_" + re.sub(r"\W", "_", self.name)


UNITS = (
    "1", "s", "m", "m2", "m/s", "m/s2", "rad", "rad/s", "kg.m", "N/s", "kg", "A", "A/s", "A/m",
    "A/(m.s)", "A.s/m", "V", "A2", "V2", "N", "N/A", "N/m", "N2/s", "N.m2/A2",
)  # fmt: skip
"""Units of variables, in the order of the file."""

_DERIVED = {"N": {"kg": 1, "m": 1, "s": -2}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1}}


def exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units in a unit."""
    total: dict[str, int] = {}
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(\d?)", product):
            for base, exponent in _DERIVED.get(name, {name: 1}).items():
                total[base] = total.get(base, 0) + sign * exponent * int(power or 1)
    order = ("kg", "m", "s", "A") if total.get("kg") else ("rad", "A", "m", "s")
    return {base: total[base] for base in order if total.get(base)}


TIME = Variable("time", "time", "s", "time")


def in_unit(variables: Sequence[Variable], control: str) -> tuple[Variable, ...]:
    """Return variables with control signals in their unit."""
    units = {"V": control, "V2": f"{control}2"}
    return tuple(
        replace(variable, unit=units.get(variable.unit, variable.unit)) for variable in variables
    )


def per_name(
    what: str, role: Role, unit: str, about: str, names: Sequence[str],
    starts: Iterable[float] | float = 0.0, **more: Any,
) -> list[Variable]:  # fmt: skip
    """Return a variable for each name of an axis or a reading."""
    start_values = several(starts) * (1 if isinstance(starts, tuple | list) else len(names))
    block = what.rsplit(".", 1)[-1]
    return [
        Variable(signal(what, name), role, unit, about + (f", {name}" if name else ""),
                 float(start), first="" if k else block, **more)
        for k, (name, start) in enumerate(zip(names, start_values, strict=True))
    ]  # fmt: skip
