"""``modelDescription.xml`` and ``buildDescription.xml``, for FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

from ambkit.base.escaping import one_line
from ambkit.export.fmu.variable import UNITS, Variable, exponents

Fmi = Literal[2, 3]

COMPILER_OPTIONS = "-std=c99 -ffp-contract=off"
"""With which the same bits come out on every processor."""

_CAUSALITY = {"time": "independent", "fixed": "parameter", "tunable": "parameter"}
_LOG = {
    "logStatusDiscard": "A value or a step that was refused",
    "logStatusError": "A call that was refused",
}


@dataclass(frozen=True)
class Model:
    """What the descriptions say of a model."""

    identifier: str  #: C identifier, and name of the binary.
    name: str  #: For people.
    about: str
    version: str  #: Of ambkit.
    token: str  #: GUID or instantiation token.
    sampling_time: float  #: [s].
    variables: Sequence[Variable]  #: In the order of their value references.
    sources: Sequence[str]  #: What is compiled, relative to ``sources/``.

    @property
    def rates(self) -> list[Variable]:
        """Derivatives of its states, where an importer may integrate it."""
        return [variable for variable in self.variables if variable.rate_of]

    @property
    def events(self) -> list[Variable]:
        """What events begin with."""
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
    _co_simulation(root, model, fmi)
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
    (_structure_2 if fmi == 2 else _structure_3)(root, model.variables)
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


def _co_simulation(root: ElementTree.Element, model: Model, fmi: Fmi) -> None:
    own = {"canHandleVariableCommunicationStepSize": "true"}
    if fmi == 3:
        own["fixedInternalStepSize"] = _text(model.sampling_time)
    _interface(root, "CoSimulation", model, fmi, own)


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
    if fmi == 2:
        attributes["canNotUseMemoryManagementFunctions"] = "true"
    element = ElementTree.SubElement(root, name, attributes)
    if fmi == 2:
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
    """Attributes of a variable that both versions have."""
    discrete = variable.held or variable.integer
    variability = {"fixed": "fixed", "tunable": "tunable"}.get(
        variable.role, "discrete" if discrete else "continuous"
    )
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
    """Attributes of a variable that tell of its value."""
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


def _asked_first(variables: Sequence[Variable]) -> list[Variable]:
    """Return what is calculated at the start: outputs, states and their rates."""
    return [v for v in variables if v.role == "output" or (v.role == "local" and not v.event)]


def _structure_2(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    at = _places(variables, 1)
    outputs = ElementTree.SubElement(structure, "Outputs")
    for output in (variable for variable in variables if variable.role == "output"):
        ElementTree.SubElement(
            outputs, "Unknown", index=at[output.name], dependencies=_follows(output, at)
        )
    rates = [variable for variable in variables if variable.rate_of]
    if rates:
        derivatives = ElementTree.SubElement(structure, "Derivatives")
        for rate in rates:
            ElementTree.SubElement(derivatives, "Unknown", index=at[rate.name])
    initially = ElementTree.SubElement(structure, "InitialUnknowns")
    for variable in _asked_first(variables):
        ElementTree.SubElement(initially, "Unknown", index=at[variable.name])


def _structure_3(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    at = _places(variables, 0)
    unknowns = {
        "Output": [v for v in variables if v.role == "output"],
        "ContinuousStateDerivative": [v for v in variables if v.rate_of],
        "InitialUnknown": _asked_first(variables),
        "EventIndicator": [v for v in variables if v.event],
    }
    for name, those in unknowns.items():
        for variable in those:
            follows = {"dependencies": _follows(variable, at)} if name == "Output" else {}
            attributes = {"valueReference": at[variable.name]} | follows
            ElementTree.SubElement(structure, name, attributes)


def _follows(output: Variable, at: Mapping[str, str]) -> str:
    """Return what an output follows at once."""
    return " ".join(sorted((at[name] for name in output.follows), key=int))


def _text(value: float) -> str:
    return repr(float(value))  # the shortest that is read back to the last bit


def written(root: ElementTree.Element) -> str:
    """Return a document as text."""
    for element in root.iter():  # the library escapes, but writes what XML 1.0 cannot hold
        element.attrib = {key: one_line(value) for key, value in element.items()}
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'
