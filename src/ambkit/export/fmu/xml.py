"""``modelDescription.xml`` and ``buildDescription.xml``, for FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal
from xml.etree import ElementTree

from ambkit.base.escaping import one_line
from ambkit.export.fmu.variables import UNITS, Variable

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
    """What the descriptions say of a model.

    Attributes
    ----------
    identifier : str
        C identifier, and name of the binary.
    name, about : str
        For people.
    version : str
        Of ambkit.
    token : str
        GUID or instantiation token.
    sampling_time : float
        [s].
    variables : sequence of Variable
        In the order of their value references.
    sources : sequence of str
        What is compiled, relative to ``sources/``.
    """

    identifier: str
    name: str
    about: str
    version: str
    token: str
    sampling_time: float
    variables: Sequence[Variable]
    sources: Sequence[str]


def model_description(model: Model, fmi: Fmi) -> str:
    """Write ``modelDescription.xml``."""
    token = {2: "guid", 3: "instantiationToken"}[fmi]
    root = ElementTree.Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": model.name,
            token: model.token,
            "description": model.about,
            "generationTool": f"ambkit {model.version}",
            "variableNamingConvention": "structured",
        },
    )
    _co_simulation(root, model, fmi)
    _units(root, model.variables)
    categories = ElementTree.SubElement(root, "LogCategories")
    for name, text in _LOG.items():
        ElementTree.SubElement(categories, "Category", name=name, description=text)
    step = _text(model.sampling_time)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0.0", stepSize=step)
    variables = ElementTree.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(model.variables):
        (_variable_2 if fmi == 2 else _variable_3)(variables, reference, variable)
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
    state = "FMUstate" if fmi == 2 else "FMUState"
    attributes = {
        "modelIdentifier": model.identifier,
        "canHandleVariableCommunicationStepSize": "true",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    attributes |= (
        {"canNotUseMemoryManagementFunctions": "true"}
        if fmi == 2
        else {"fixedInternalStepSize": _text(model.sampling_time)}
    )
    element = ElementTree.SubElement(root, "CoSimulation", attributes)
    if fmi == 2:
        files = ElementTree.SubElement(element, "SourceFiles")
        for name in model.sources:
            ElementTree.SubElement(files, "File", name=name)


def _units(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    used = {variable.unit for variable in variables}
    definitions = ElementTree.SubElement(root, "UnitDefinitions")
    for name, exponents in UNITS.items():
        if name in used:
            unit = ElementTree.SubElement(definitions, "Unit", name=name)
            powers = {base: str(exponent) for base, exponent in exponents.items()}
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
    return attributes | ({"initial": "calculated"} if variable.role == "output" else {})


def _number(variable: Variable) -> dict[str, str]:
    """Attributes of a variable that tell of its value."""
    attributes = {} if variable.integer else {"unit": variable.unit}
    if variable.limit in ("not negative", "positive"):
        attributes["min"] = "0.0"
    if variable.role not in ("time", "output"):
        attributes["start"] = _text(variable.start)
    return attributes


def _variable_2(parent: ElementTree.Element, reference: int, variable: Variable) -> None:
    element = ElementTree.SubElement(parent, "ScalarVariable", _common(reference, variable))
    kind = "Integer" if variable.integer else "Real"
    ElementTree.SubElement(element, kind, _number(variable))


def _variable_3(parent: ElementTree.Element, reference: int, variable: Variable) -> None:
    kind = "Int32" if variable.integer else "Float64"
    ElementTree.SubElement(parent, kind, _common(reference, variable) | _number(variable))


def _places(variables: Sequence[Variable], first: int) -> Mapping[str, str]:
    return {variable.name: str(first + i) for i, variable in enumerate(variables)}


def _structure_2(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    at = _places(variables, 1)
    outputs = ElementTree.SubElement(structure, "Outputs")
    initially = ElementTree.SubElement(structure, "InitialUnknowns")
    for output in (variable for variable in variables if variable.role == "output"):
        index, follows = at[output.name], " ".join(at[name] for name in output.follows)
        ElementTree.SubElement(outputs, "Unknown", index=index, dependencies=follows)
        ElementTree.SubElement(initially, "Unknown", index=index)


def _structure_3(root: ElementTree.Element, variables: Sequence[Variable]) -> None:
    structure = ElementTree.SubElement(root, "ModelStructure")
    at = _places(variables, 0)
    outputs = [variable for variable in variables if variable.role == "output"]
    for output in outputs:
        follows = " ".join(at[name] for name in output.follows)
        ElementTree.SubElement(
            structure, "Output", valueReference=at[output.name], dependencies=follows
        )
    for output in outputs:
        ElementTree.SubElement(structure, "InitialUnknown", valueReference=at[output.name])


def _text(value: float) -> str:
    return repr(float(value))  # the shortest that is read back to the last bit


def written(root: ElementTree.Element) -> str:
    """Return a document as text."""
    for element in root.iter():  # the library escapes, but writes what XML 1.0 cannot hold
        element.attrib = {key: one_line(value) for key, value in element.items()}
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'
