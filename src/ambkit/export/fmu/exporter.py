"""Assembly of an FMU: descriptions, sources, binary."""

import hashlib
import os
import re
import tempfile
import uuid
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, get_args
from xml.etree import ElementTree

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import one_line
from ambkit.base.quantity_arguments import of_type
from ambkit.estimate.estimator import Estimator
from ambkit.export.c import c_literals
from ambkit.export.c.model import c_model
from ambkit.export.fmu import controller as start_data
from ambkit.export.fmu import rig, sources, variables, xml
from ambkit.export.fmu.variables import Kind
from ambkit.export.fmu.xml import Fmi, Model, Variable, in_unit, written
from ambkit.judge.adequacy import require_adequate
from ambkit.machine.machine import Machine
from ambkit.result.result import Statement
from ambkit.simulation.scenario import Scenario, settled_scenario


@dataclass(frozen=True)
class FmuExport:
    """Result of an export to FMU."""

    path: Path  #: The FMU.
    kind: Kind  #: Model.
    fmi: Fmi  #: FMI version.
    identifier: str  #: Its model identifier.
    token: str  #: GUID or instantiation token: a hash of all inputs.
    variables: tuple[str, ...]  #: Names of its variables, in the order of their value references.
    inputs: tuple[str, ...] = ()  #: Names of the inputs.
    outputs: tuple[str, ...] = ()  #: Names of the outputs.

    def stated(self) -> Statement:
        """Return it as a result."""
        data = {
            "path": str(self.path), "kind": self.kind, "fmi": f"{self.fmi}.0",
            "identifier": self.identifier, "token": self.token, "variables": list(self.variables),
        }  # fmt: skip
        count = len(self.variables)
        return Statement(f"{self.path}: FMI {self.fmi}.0, {count} variables.", data)


def export_fmu(
    machine: Machine,
    filter: Estimator,
    out: str | os.PathLike[str],
    *,
    kind: Kind = "estimator",
    fmi: Fmi = 3,
    scenario: Scenario | None = None,
    everywhere: bool = False,
    force: bool = False,
) -> FmuExport:
    """Write an FMU around the library's C: binary and sources, no Python."""
    # It reproduces the library's bits. Any communication step is allowed: the filter samples at
    # whole multiples of the machine's sampling time, and holds its estimates in between; the plant
    # is integrated as requested. As in a controller, the sample at a communication point is
    # processed by the step that begins there, with the inputs set there: an estimate read after the
    # step from t to t + T is that of the sample at t. The plant's outputs are those at the end of
    # the step. NaN on an estimator's input is a lost sensor. FMUs are for co-simulation. A plant
    # without dead time is for model exchange too: the importer integrates it, and its outputs
    # follow at any time.
    of_type(Machine, machine=machine)
    of_type(Estimator, filter=filter)
    if kind not in (known := get_args(Kind)):
        raise AmbkitError(f"there is no FMU of kind {kind!r}; known: {', '.join(known)}")
    if filter.precision == "float32" and kind not in ("estimator", "whole-controller"):
        raise AmbkitError(
            f"a {kind} computes in double; precision float is for an estimator or a "
            "whole-controller"
        )
    if kind != "plant":
        require_adequate(filter, machine, scenario, force=force)
    what = scenario or Scenario()
    if kind in ("closed-loop", "controller"):
        what = settled_scenario(machine, what)
    parts = _parts(kind, machine, filter, what)
    if parts.filter is not None and machine.angle is not None and filter.engine.synchronous:
        states = " and ".join(filter.engine.synchronous)
        raise AmbkitError(
            f"an FMU has no input for the sensor of the angle, by which this filter estimates "
            f"{states}: use ambkit export c, or a filter without them"
        )
    made = _content(machine, kind, fmi, parts, token="")
    token = _token(made.files)
    made = _content(machine, kind, fmi, parts, token)
    binaries = sources.binaries(
        made.in_sources, made.model.sources, made.model.identifier, fmi, everywhere=everywhere
    )
    content = {name: text.encode() for name, text in made.files.items()}
    write_archive(Path(out), content | binaries)
    names, inputs, outputs = (
        tuple(item.name for item in parts.variables if role in (None, item.role))
        for role in (None, "input", "output")
    )
    return FmuExport(
        Path(out), kind, fmi, made.model.identifier, token, names, inputs, outputs
    )  # fmt: skip


class _Parts(NamedTuple):
    """The parts that differ between kinds."""

    about: str
    model: str  # name of the model in C
    variables: tuple[Variable, ...]
    data: dict[str, str]  # the data files
    filter: Estimator | None


def _parts(kind: Kind, machine: Any, filter: Estimator, scenario: Scenario) -> _Parts:
    law, single = scenario.controller, filter.machine.single
    more = not single or scenario.sequence is not None or law.needs_estimate or bool(law.block)
    match kind:
        case "estimator":
            return _estimator(filter)
        case "plant":
            return _plant(machine, scenario)
        case "closed-loop":
            return _loop(filter, scenario, complete=more)
        case "controller":
            return _regulator(filter, scenario) if more else _pid(machine, scenario)
        case "whole-controller":
            return _complete_controller(filter, scenario)


def _estimator(filter: Estimator) -> _Parts:
    about = f"The {filter.name} of {filter.machine.name}"
    data = sources.data_files("estimator", filter=sources.filter_data(filter))
    return _Parts(about, "estimator", variables.of_estimator(filter), data, filter)


def _plant(machine: Machine, scenario: Scenario) -> _Parts:
    s = "" if machine.single else "s"
    about = f"{machine.name}: amplifier{s}, magnet{s}, rotor and sensor{s}"
    start = rig.RigStart.of(machine, scenario)
    plant_variables = variables.of_plant(machine, start.place.tolist())
    rates = [variable.rate_of for variable in plant_variables if variable.rate_of]
    sizes = rig.nominals(machine, rates)
    model = "plant" if sizes else "late-plant"
    data = sources.data_files(model, rig=rig.rig_data(machine, start), nominals=sizes)
    return _Parts(about, model, plant_variables, data, None)


def _pid(machine: Machine, scenario: Scenario) -> _Parts:
    controller = scenario.controller
    estimate = controller.feedback == "estimate"
    source = "an estimator" if estimate else "the sensor"
    data = sources.data_files(
        "pid", pid=sources.pid_data(machine, controller), feedback_estimate=estimate,
        k_ui=[c_literals.number(machine.amplifier.gain, "double")],
        K_sen=c_literals.number(1.0 if estimate else machine.sensor.gain, "double"),
    )  # fmt: skip
    about = f"The PID controller of {machine.name}, fed by {source}"
    return _Parts(about, "pid", variables.of_controller(machine, controller), data, None)


def _regulator(filter: Estimator, scenario: Scenario) -> _Parts:
    if scenario.sequence is not None:
        raise AmbkitError(
            "kind controller has no lift-off: use kind whole-controller, or remove "
            "[sequence] out of the scenario"
        )
    start = start_data.controller_start(filter, scenario)
    source = "a filter" if start.controller.fed else "the sensors"
    about = f"The {_called(filter, scenario)} of {filter.machine.name}, fed by {source}"
    own = variables.of_regulator(start.controller, start.current)
    data = sources.data_files("regulator", **start_data.law_data(start.controller))
    return _Parts(about, "regulator", own, data, None)


def _loop(filter: Estimator, scenario: Scenario, *, complete: bool) -> _Parts:
    machine, controller = filter.machine, scenario.controller
    start = start_data.controller_start(filter, scenario) if complete else None
    if start is not None:
        held = f"its whole controller: {filter.name}, {_called(filter, scenario)}"
        own = start_data.controller_data(start, "double")
    else:
        estimate = controller.feedback == "estimate"
        held = f"a PID controller that {f'the {filter.name}' if estimate else 'the sensor'} feeds"
        own = {"pid": sources.pid_data(machine, controller), "feedback_estimate": estimate}
    model = "loop-flight" if complete else "loop-pid"
    plant = rig.rig_data(machine, rig.RigStart.of(machine, scenario))
    data = sources.data_files(model, filter=sources.filter_data(filter), rig=plant, **own)
    own_variables = variables.of_loop(filter, controller, start)
    return _Parts(f"{machine.name}, held by {held}", model, own_variables, data, filter)


def _complete_controller(filter: Estimator, scenario: Scenario) -> _Parts:
    start, law = start_data.controller_start(filter, scenario), _called(filter, scenario)
    about = f"The whole controller of {filter.machine.name}: {filter.name}, {law}"
    of_controller = start_data.controller_data(start, c_literals.precision_of(filter))
    data = sources.data_files("flight", filter=sources.filter_data(filter), **of_controller)
    return _Parts(about, "flight", variables.of_complete_controller(filter, start), data, filter)


def _called(filter: Estimator, scenario: Scenario) -> str:
    """Return a description of a machine's controllers."""
    controller = scenario.controller
    if not filter.machine.single:
        return "controller of all axes"
    if controller.type == "lqg":
        return "linear-quadratic regulator"
    return "PID controller" + (" with feed-forward" if controller.needs_estimate else "")


class _Content(NamedTuple):
    model: Model
    in_sources: dict[str, str]
    files: dict[str, str]  # files of the FMU, without the binary


def _content(machine: Machine, kind: Kind, fmi: Fmi, parts: _Parts, token: str) -> _Content:
    """Return all texts of the FMU, including the token."""
    fixed = sources.model_files(parts.model, fmi) | parts.data
    of_model = None if parts.filter is None else c_model(parts.filter)
    if of_model is None and not machine.single and "rig.c" in fixed:
        of_model = rig.room_of(machine)
    fixed |= sources.library_files(fixed, parts.filter, of_model)
    compiled = tuple(sorted(name for name in (*fixed, "description.c") if name.endswith(".c")))
    identifier = re.sub(r"\W", "_", f"{machine.name}_{kind}", flags=re.ASCII)
    model = Model(
        identifier=identifier if identifier[0].isalpha() else f"model_{identifier}",
        name=f"{machine.name} {kind}",
        about=parts.about,
        version=version("ambkit"),
        token=token,
        sampling_time=machine.sampling_time,
        variables=in_unit(parts.variables, machine.control_unit),
        sources=compiled,
    )
    in_sources = fixed | sources.description_files(parts.model, model)
    files = {f"sources/{name}": text for name, text in in_sources.items()}
    files["modelDescription.xml"] = xml.model_description(model, fmi)
    if fmi == 3:
        files["sources/buildDescription.xml"] = xml.build_description(model)
    for name, text in sources.licences().items():
        files[f"documentation/licenses/{name}"] = text
    page = {"model": model, "kind": kind, "fmi": fmi}
    files["documentation/index.html"] = sources.rendered("index.html.j2", page)
    return _Content(model, in_sources, files)


def _token(files: dict[str, str]) -> str:
    """Return a hash of all texts, in the form of a GUID."""
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        digest.update(f"{name}\0{text}\0".encode())
    return f"{{{uuid.UUID(digest.hexdigest()[:32])}}}"


_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the earliest time in ZIP


def write_archive(path: Path, content: Mapping[str, bytes]) -> None:
    """Write files in alphabetical order and without times to an archive."""
    with files.replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name, _LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, on any platform
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content[name])


_SSD = "http://ssp-standard.org/SSP1/SystemStructureDescription"
_SSC = "http://ssp-standard.org/SSP1/SystemStructureCommon"

Wire = tuple[str, str, str, str]
"""From an element and its output to an element and its input; an empty element is the system."""


def export_ssp(
    machine: Machine,
    filter: Estimator,
    out: str | os.PathLike[str],
    *,
    fmi: Fmi = 2,
    scenario: Scenario | None = None,
    **options: Any,
) -> tuple[FmuExport, ...]:
    """Write plant, estimator and controller, connected, as a system for importers of SSP 1.0."""
    # An importer passes values from step to step: with a step of the sampling time the estimate
    # reaches the controller one sample late and its command the plant another, unlike the closed
    # loop of :func:`export_fmu`. With lift-off and landing, estimator and controller are one FMU,
    # the complete controller, which also switches the plant's currents.
    what = scenario or Scenario()
    has_sequence = what.sequence is not None
    kinds: dict[str, Kind] = {"plant": "plant", "controller": "controller"}
    kinds |= {"controller": "whole-controller"} if has_sequence else {"estimator": "estimator"}
    options |= {"fmi": fmi, "scenario": what}
    with tempfile.TemporaryDirectory() as place:
        made = {
            name: export_fmu(machine, filter, Path(place, f"{name}.fmu"), kind=kind, **options)
            for name, kind in kinds.items()
        }
        content = {f"resources/{one.path.name}": one.path.read_bytes() for one in made.values()}
    wires = _wires(made, estimate=what.feedback != "measurement" and not has_sequence)
    content["SystemStructure.ssd"] = description(machine.name, wires).encode()
    write_archive(Path(out), content)
    return tuple(made.values())


def _wires(made: dict[str, FmuExport], *, estimate: bool) -> list[Wire]:
    """Return the connections between elements, and to outside; `estimate`: the feedback."""
    sources = {
        "plant": ("controller",),
        "estimator": ("plant", "controller"),
        "controller": ("estimator",) if estimate else ("plant",),
    }
    plant, wires = made["plant"], list[Wire]()
    for element, one in made.items():
        for name in one.inputs:
            output = name
            if element == "controller" and not estimate and name in ("x", "v"):
                if name == "v":  # not an input of a PID with measurement feedback
                    continue
                output = "y"
            source = next((s for s in sources[element] if output in made[s].outputs), None)
            if source is not None:
                wires.append((source, output, element, name))
            elif not name.startswith("fault_") and name != "on":
                wires.append(("", name, element, name))
    displayed = [
        name for name in plant.outputs if name == "x" or name.startswith(("q_", "s_", "y"))
    ]
    wires += [("plant", name, "", name) for name in displayed]
    of_controller = [n for n in made["controller"].outputs if re.match(r"(u|mode)(_|$)", n)]
    wires += [("controller", name, "", name) for name in of_controller]
    element, before = list(made)[-1], "" if len(made) > 2 else "estimate."
    for output in made[element].outputs:
        name = output.removeprefix(before)
        if output.startswith(before) and (
            name == "x" or name.startswith("f_d") or f"q_{name}" in plant.outputs
        ):
            wires.append((element, output, "", f"estimate_{name}"))
    return wires


def description(name: str, wires: list[Wire]) -> str:
    """Write ``SystemStructure.ssd``."""
    for prefix, uri in (("ssd", _SSD), ("ssc", _SSC)):
        ElementTree.register_namespace(prefix, uri)
    root = ElementTree.Element(
        f"{{{_SSD}}}SystemStructureDescription", {"version": "1.0", "name": one_line(name)}
    )
    system = _under(root, "System", name="system")
    own = {wire[1]: "input" for wire in wires if not wire[0]}
    _connectors(system, own | {wire[3]: "output" for wire in wires if not wire[2]})
    elements = _under(system, "Elements")
    for element in dict.fromkeys(wire[0] for wire in wires if wire[0]):
        ends = {wire[1]: "output" for wire in wires if wire[0] == element}
        ends |= {wire[3]: "input" for wire in wires if wire[2] == element}
        component = _under(
            elements, "Component", name=element, type="application/x-fmu-sharedlibrary",
            source=f"resources/{element}.fmu",
        )  # fmt: skip
        _connectors(component, ends)
    connections = _under(system, "Connections")
    for start, output, end, input_name in wires:
        words = {"startConnector": output, "endConnector": input_name}
        words |= {"startElement": start} if start else {}
        words |= {"endElement": end} if end else {}
        _under(connections, "Connection", **words)
    return written(root)


def _connectors(of: ElementTree.Element, kinds: dict[str, str]) -> None:
    connectors = _under(of, "Connectors")
    for name, kind in kinds.items():
        connector = _under(connectors, "Connector", name=name, kind=kind)
        ElementTree.SubElement(connector, f"{{{_SSC}}}Real")


def _under(parent: ElementTree.Element, what: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, f"{{{_SSD}}}{what}", attributes)
