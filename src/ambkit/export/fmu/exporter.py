"""Put an FMU together: descriptions, sources, binary."""

from __future__ import annotations

import hashlib
import os
import re
import uuid
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.control.control import Control
from ambkit.control.controller_states import Controller
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import kind_called
from ambkit.export.c import c_literals
from ambkit.export.c.c_literals import CPrecision
from ambkit.export.fmu import archive, compiler, sources, variables, xml
from ambkit.export.fmu import controller as flown
from ambkit.export.fmu.variables import Kind, Variable
from ambkit.export.fmu.xml import Fmi, Model
from ambkit.judge.adequacy import require_adequate
from ambkit.machine.loading import levitation_current_at
from ambkit.machine.machine import Bearing, Machine
from ambkit.result.document import Statement
from ambkit.simulation.scenario import Scenario

if TYPE_CHECKING:
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.machine.magnets import MagnetModel


@dataclass(frozen=True)
class FmuExport:
    """What was written."""

    path: Path  #: The FMU.
    kind: Kind  #: What it models.
    fmi: Fmi  #: Version of the standard.
    identifier: str  #: Its model identifier.
    token: str  #: Its GUID or instantiation token: a hash of all that it was made from.
    variables: tuple[str, ...]  #: Names of its variables, in the order of their value references.

    def stated(self) -> Statement:
        """Return it as a result."""
        data = {
            "path": str(self.path), "kind": self.kind, "fmi": f"{self.fmi}.0",
            "identifier": self.identifier, "token": self.token, "variables": list(self.variables),
        }  # fmt: skip
        count = len(self.variables)
        return Statement(f"{self.path}: FMI {self.fmi}.0, {count} variables.", data)


def export_fmu(
    bearing: Machine,
    magnet: MagnetModel | None,
    out: str | os.PathLike[str],
    *,
    kind: Kind = "estimator",
    fmi: Fmi = 3,
    scenario: Scenario | None = None,
    filter: str | None = None,
    filter_file: FilterFile | None = None,
    precision: CPrecision = "double",
    everywhere: bool = False,
    force: bool = False,
) -> FmuExport:
    """Write an FMU around the C of the library: binary and sources, no Python."""
    # Bit for bit as the library. A communication step may be any: the filter takes its samples at
    # whole multiples of the bearing's sampling time, and holds its estimates in between; the plant
    # goes on by what is asked. As in a controller, the sample at a communication point is taken by
    # the step that begins there, with the inputs set there: an estimate read after the step from t
    # to t + T is that of the sample at t. The plant's outputs are those at the end of the step. NaN
    # on an estimator's input is a lost sensor.
    # FMUs are for co-simulation. A plant without a dead time is for model exchange too: its
    # importer integrates it, and its outputs follow at any time.
    of_type(Machine, bearing=bearing)
    short = bearing.short
    machine: Any = short.isolated_axis("") if short.single else short
    if kind not in (known := get_args(Kind)):
        raise AmbkitError(f"there is no FMU of kind {kind!r}; known: {', '.join(known)}")
    if precision == "float" and kind not in ("estimator", "whole-controller"):
        raise AmbkitError(
            f"a {kind} computes in double; precision float is for an estimator or a "
            "whole-controller"
        )
    of: Any = {"precision": "float32" if precision == "float" else "float64"}
    if filter_file is not None:
        filter_ = filter_file.make(magnet=magnet, **of)
    else:
        kind_of_filter = filter or ("linear" if magnet is None else "adaptive")
        filter_ = kind_called(kind_of_filter).make(machine, magnet, **of)
    if kind != "plant":
        require_adequate(filter_, bearing, scenario, force=force)
    what = scenario or Scenario()
    if short.single:
        what = what.model_copy(update={"controller": what.controller.completed(machine)})
    elif kind in ("plant", "closed-loop", "controller"):
        raise AmbkitError(
            f"{short.name} has several axes: of these there are FMUs of kind estimator and "
            f"whole-controller, and no {kind}"
        )
    parts = _parts(kind, machine, filter_, what)
    made = _content(short, kind, fmi, parts, token="")
    token = _token(made.files)
    made = _content(short, kind, fmi, parts, token)
    binaries = compiler.binaries(
        made.in_sources, made.model.sources, made.model.identifier, fmi, everywhere=everywhere
    )
    content = {name: text.encode() for name, text in made.files.items()}
    archive.write(Path(out), content | binaries)
    names = tuple(variable.name for variable in parts.variables)
    return FmuExport(Path(out), kind, fmi, made.model.identifier, token, names)


class _Parts(NamedTuple):
    """What differs from kind to kind."""

    about: str
    model: str  # by its name in C
    variables: tuple[Variable, ...]
    data: dict[str, str]  # the data files
    filter: Estimator | None


def _parts(kind: Kind, machine: Any, filter: Estimator, scenario: Scenario) -> _Parts:
    match kind:
        case "estimator":
            return _estimator(filter)
        case "plant":
            return _plant(machine, flown.starts_at(machine, scenario))
        case "closed-loop":
            return (
                _whole_loop(filter, scenario)
                if flown.has_more_than_pid(scenario)
                else _loop(filter, scenario)
            )
        case "controller":
            return (
                _regulator(filter, scenario)
                if flown.has_more_than_pid(scenario)
                else _pid(machine, scenario)
            )
        case "whole-controller":
            return _whole(filter, scenario)


def _estimator(filter: Estimator) -> _Parts:
    about = f"The {filter.name} of {filter.bearing.name}"
    data = sources.data_files("estimator", filter=sources.filter_data(filter))
    return _Parts(about, "estimator", variables.of_estimator(filter), data, filter)


def _plant(bearing: Bearing, place: float) -> _Parts:
    about = f"Bearing {bearing.name}: amplifier, magnet, rotor and sensor"
    plant_variables = variables.of_plant(bearing, place)
    sizes = sources.nominals(bearing, [v.rate_of for v in plant_variables if v.rate_of])
    model = "plant" if sizes else "late-plant"
    data = sources.data_files(model, rig=sources.rig_data(bearing), nominals=sizes)
    return _Parts(about, model, plant_variables, data, None)


def _pid(bearing: Bearing, scenario: Scenario) -> _Parts:
    controller = scenario.controller
    estimate = controller.feedback == "estimate"
    source = "an estimator" if estimate else "the sensor"
    data = sources.data_files(
        "pid", pid=sources.pid_data(bearing, controller), feedback_estimate=estimate,
        k_ui=c_literals.number(bearing.amplifier.gain, "double"),
        K_sen=c_literals.number(1.0 if estimate else bearing.sensor.gain, "double"),
    )  # fmt: skip
    about = f"The PID controller of bearing {bearing.name}, fed by {source}"
    return _Parts(about, "pid", variables.of_controller(bearing, controller), data, None)


def _regulator(filter: Estimator, scenario: Scenario) -> _Parts:
    bearing = filter.bearing
    if scenario.feedback == "measurement":
        raise AmbkitError(
            "a controller with blocks that the sensor feeds has no FMU of its own: take kind "
            "whole-controller or closed-loop"
        )
    controller = Controller.of_axis(bearing, filter, scenario.controller, scenario.sequence)
    about = f"The {_called(scenario.controller)} of bearing {bearing.name}, fed by an estimator"
    current = levitation_current_at(bearing)
    own = variables.of_regulator(filter, current, controller.integral(current, 0.0))
    data = sources.data_files("regulator", **flown.law_data(controller))
    return _Parts(about, "regulator", own, data, None)


def _loop(filter: Estimator, scenario: Scenario) -> _Parts:
    bearing, controller = filter.bearing, scenario.controller
    estimate = controller.feedback == "estimate"
    source = f"the {filter.name}" if estimate else "the sensor"
    data = sources.data_files(
        "loop-pid", filter=sources.filter_data(filter), rig=sources.rig_data(bearing),
        pid=sources.pid_data(bearing, controller), feedback_estimate=estimate,
    )  # fmt: skip
    about = f"Bearing {bearing.name}, held by a PID controller that {source} feeds"
    return _Parts(about, "loop-pid", variables.of_loop(filter, controller), data, filter)


def _whole_loop(filter: Estimator, scenario: Scenario) -> _Parts:
    bearing, start = filter.bearing, flown.flown(filter, scenario)
    law = _called(scenario.controller)
    about = f"Bearing {bearing.name}, held by its whole controller: {filter.name}, {law}"
    data = sources.data_files(
        "loop-flight", filter=sources.filter_data(filter), rig=sources.rig_data(bearing),
        **flown.controller_data(start, "double"),
    )  # fmt: skip
    own = variables.of_loop(filter, scenario.controller, start)
    return _Parts(about, "loop-flight", own, data, filter)


def _whole(filter: Estimator, scenario: Scenario) -> _Parts:
    start = flown.flown(filter, scenario)
    law = _called(scenario.controller) if filter.machine.single else "of all axes"
    about = f"The whole controller of {filter.bearing.name}: {filter.name}, {law}"
    of_controller = flown.controller_data(start, sources.precision_of(filter))
    data = sources.data_files("flight", filter=sources.filter_data(filter), **of_controller)
    return _Parts(about, "flight", variables.of_whole(filter, start), data, filter)


def _called(controller: Control) -> str:
    """Return what a controller is, in words."""
    if controller.type == "lqg":
        return "linear-quadratic regulator"
    return "PID controller" + (" with feed-forward" if controller.needs_estimate else "")


class _Content(NamedTuple):
    model: Model
    in_sources: dict[str, str]
    files: dict[str, str]  # of the FMU, without the binary


def _content(machine: Machine, kind: Kind, fmi: Fmi, parts: _Parts, token: str) -> _Content:
    """Return all texts of the FMU, with the token in them."""
    fixed = sources.model_files(parts.model, fmi) | parts.data
    fixed |= sources.library_files(fixed, parts.filter)
    compiled = sources.compiled_files([*fixed, "description.c"])
    model = Model(
        identifier=_identifier(machine, kind),
        name=f"{machine.name} {kind}",
        about=parts.about,
        version=version("ambkit"),
        token=token,
        sampling_time=machine.sampling_time,
        variables=variables.in_unit(parts.variables, machine.control_unit),
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


def _identifier(machine: Machine, kind: Kind) -> str:
    words = re.sub(r"\W", "_", f"{machine.name}_{kind}", flags=re.ASCII)
    return words if words[0].isalpha() else f"model_{words}"


def _token(files: dict[str, str]) -> str:
    """Return a hash of all texts, in the form of a GUID."""
    digest = hashlib.sha256()
    for name, text in sorted(files.items()):
        digest.update(f"{name}\0{text}\0".encode())
    return f"{{{uuid.UUID(digest.hexdigest()[:32])}}}"
