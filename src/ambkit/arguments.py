"""What a caller gives to a verb, as it is needed: objects for names, files and texts."""

from __future__ import annotations

import difflib
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np

from ambkit.base import files
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.own_class import MARK
from ambkit.base.quantity_arguments import in_si, names_in, of_type
from ambkit.control.control import Control
from ambkit.control.controllers import TYPES
from ambkit.control.linear.steady_state_filter import tells
from ambkit.control.pid import PID
from ambkit.data.channel_map import ChannelMap, inputs_of
from ambkit.data.input_scaling import Inputs
from ambkit.data.reading import load_with_gaps
from ambkit.data.record import Record
from ambkit.estimate import DEFAULT
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile, filter_file_for
from ambkit.estimate.filter_saving import in_memory
from ambkit.estimate.named import FromFile, FromKind, experts, factories
from ambkit.estimate.registry import (
    AT,
    FILTER_SUFFIX,
    KINDS,
    default_name,
    get_kind,
    learned_magnet,
    split_name,
)
from ambkit.export.stiffness_table import tabulate
from ambkit.fuzzy.expert import Expert
from ambkit.judge.plausibility import evaluate_record, off_rate
from ambkit.machine.loading import load_machine
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision
from ambkit.simulation.scenario import (
    Scenario,
    by_axis,
    control_of,
    fastest_of,
    feedback_of,
    wrong_for,
)
from ambkit.simulation.waveforms import Constant

MOST = 0.5
"""Share of the measurements beyond the air gap, where no rotor can be, with which nothing works."""


def check_plausibility(record: Record, machine: Machine, name: Any = "") -> list[str]:
    """Return what is odd about a record of a machine, each with the record's name, or refuse it."""
    prefix = f"{name}: " if name else ""
    if off_rate(record, machine):
        return []
    verdict = evaluate_record(record, machine)
    if machine.single and "y" in record:
        y = record["y"][np.isfinite(record["y"])] / machine.sensor.gain
        beyond = float(np.mean(np.abs(y) > machine.magnet.air_gap)) if y.size else 0.0
        if beyond > MOST:
            raise RecordError([f"{prefix}{problem}" for problem in verdict.problems])
    odd = (*verdict.problems, *(remark for remark in verdict.remarks if remark.endswith("?")))
    return [f"{prefix}{text}" for text in odd]


NOTES = logging.getLogger("ambkit")

NONE = "none"  #: Name of the filter of a loop that has none.


class LoopArguments(NamedTuple):
    """A closed loop: its machine, filters, controllers and operating point."""

    machine: Machine
    filters: dict[str, Estimator]
    controller: PID | None
    position: float  #: Along the axes [m].
    disturbance: Mapping[str, float]  #: By the names of the axes [N].

    def one(self) -> LoopArguments:
        """Refuse several filters for what is of one loop."""
        if len(self.filters) > 1:
            raise AmbkitError(f"one loop has one filter, not {len(self.filters)}")
        return self


def loop_arguments(
    machine: Any, filter: Any, controller: Any, position: Any = 0.0, disturbance: Any = None
) -> LoopArguments:
    """Return machine, filters and controller; the file of a filter gives the first two."""
    plant, filter = _plant_and_filter(machine, filter)
    control, constant, measured = controller_argument(plant, controller)
    if filter is None:
        filter = NONE if measured else default_name(plant)
    if isinstance(filter, (list, tuple)):  # fed by the measurement is assessed beside each
        filter = [item for item in filter if item != NONE] or NONE
    filters = {} if filter == NONE else filter_arguments(filter, plant)
    if filter in ("all", ["all"]):
        for name in [name for name, filter_ in filters.items() if not tells(filter_)]:
            NOTES.warning("%s is omitted: it has no steady-state gain", name)
            del filters[name]
    forces = dict(constant)
    if disturbance:
        forces |= disturbance_argument(plant, disturbance)
    return LoopArguments(plant, filters, control, in_si("position", position, "m"), forces)


class TuningArguments(NamedTuple):
    """What is tuned, and by what, as a caller named it."""

    machine: Machine
    records: list[Record]
    kind: str
    magnet: MagnetModel | None
    controller: PID | Control | None
    channels: Any
    source: str  #: Names of the records' files.
    machine_file: str | os.PathLike[str] | None
    magnet_file: str | None

    @property
    def inputs(self) -> Inputs | None:
        """What the controller reads: the same numbers as the log has."""
        return inputs_argument(self.channels)

    def others(self, records: Any) -> list[Record]:
        """Return further records."""
        return record_arguments(records, self.machine, self.channels)


def tuning_arguments(
    machine: Any, records: Any, filter: Any, controller: Any, channels: Any
) -> TuningArguments:
    """Return machine, records and kind of filter; ``KIND@FILE`` names what its magnet asks."""
    plant = machine_argument(machine)
    filter = default_name(plant) if filter is None else filter
    kind, _, file = filter.partition(AT) if isinstance(filter, str) else (filter, "", "")
    get_kind(kind)
    named = names_in(Record, records=records)
    return TuningArguments(
        plant,
        record_arguments(named, plant, channels),
        kind,
        experts(Path(file), plant) if file else None,
        controller_argument(plant, controller)[0],
        channels,
        ", ".join(Path(item).name for item in named if not isinstance(item, Record)),
        machine if isinstance(machine, str | os.PathLike) else None,
        file or None,
    )


def _plant_and_filter(machine: Any, filter: Any) -> tuple[Machine, Any]:
    """Return the machine and what names the filter; the file of a filter gives both."""
    if not is_filter(machine):
        return machine_argument(machine), filter
    if filter is not None:
        raise AmbkitError(f"{machine} is a filter itself: omit the other one")
    return FilterFile.load(machine).plant, machine


def inputs_argument(channels: Any) -> Inputs | None:
    """Return what the controller reads of a log with a channel map; None without one."""
    if channels is None:
        return None
    return inputs_of(channels if isinstance(channels, ChannelMap) else ChannelMap.load(channels))


def pair_argument(name: str, value: Any, example: str) -> list[Any]:
    """Return the two ends of a range, stated as a pair or as one text with a comma."""
    ends = value.split(",") if isinstance(value, str) else list(value)
    if len(ends) != 2:
        raise AmbkitError(f"{name} must be two {example}, is {value!r}")
    return ends


def record_arguments(
    records: Any, machine: Machine, channels: Any, window: Any = None
) -> list[Record]:
    """Return records; where they do not look like those of the machine, that is noted."""
    results = []
    for number, item in enumerate(names_in(Record, records=records), 1):
        name = f"record {number}" if isinstance(item, Record) else item
        results.append(record_argument(item, channels, window))
        for text in check_plausibility(results[-1], machine, name):
            NOTES.warning("%s", text)
    return results


def machine_argument(source: Any, *others: type) -> Machine:
    """Return the machine that is given or named; refuse all but it and the other types."""
    if isinstance(source, str | os.PathLike):
        return load_machine(source)
    of_type(Machine, *others, machine=source)
    return cast(Machine, source)


@contextmanager
def arguments_of_the_user(prefix: str = "") -> Iterator[None]:
    """Around library calls whose arguments the user gave: their ValueErrors are the user's."""
    try:
        yield
    except ValueError as error:
        raise AmbkitError(f"{prefix}{error}") from error


def is_filter(source: Any) -> bool:
    """Whether this is the TOML file of a filter: only these have a ``kind``."""
    import tomllib

    try:
        if not isinstance(source, str | os.PathLike) or Path(source).suffix != FILTER_SUFFIX:
            return False
        return "kind" in tomllib.loads(files.read_text(source))
    except (AmbkitError, ValueError):  # whoever reads it reports that
        return False


def controller_argument(machine: Machine, value: Any) -> tuple[PID | None, dict[str, float], bool]:
    """Return the controllers, the constant disturbances, and whether a measurement feeds them."""
    if isinstance(value, type) or (isinstance(value, str) and MARK in value):
        return Control(custom=value), {}, False
    if not isinstance(value, str | os.PathLike):
        return value, {}, False
    if value in TYPES:
        return Control.model_validate({"type": value}), {}, False
    if Path(value).suffix != ".toml":
        raise AmbkitError(
            f"controller: {value!r} is none of {', '.join(TYPES)}, no file.py:Class, and no file "
            "that ends with .toml"
        )
    scenario = Scenario.load(value)
    if wrong := list(wrong_for(scenario, machine)):
        raise AmbkitError(f"{value}: {'; '.join(wrong)}")
    if machine.single:
        return scenario.controller, {}, False
    forces = {
        axis: signal.value
        for axis, signal in by_axis(scenario, "disturbance", machine.axes[0].name)
        if isinstance(signal, Constant)
    }  # fmt: skip
    control = scenario.controller
    if fastest_of(machine, scenario) > abs(machine.speed):
        control = control_of(machine, scenario)
    return control, forces, feedback_of(scenario) == "measurement"


def orbit_argument(orbit: Any) -> Any:
    """Return whether a loop is linearised along its orbit, or of which half axis that is [m]."""
    if orbit in (None, "own"):
        return orbit is not None
    return in_si("orbit", orbit, "m")


def record_argument(source: Any, channels: Any = None, window: Any = None) -> Record:
    """Return a record, filled where its log has gaps, or the part of it that is wanted."""
    record: Record = source
    if isinstance(source, str | os.PathLike):
        record = load_with_gaps(source, channels, NOTES.warning)
    of_type(Record, record=record)
    if window is None:
        return record
    ends = pair_argument("window", window, 'times such as "2 s,5 s"')
    return record.between(*(None if end in (None, "") else end for end in ends))


def disturbance_argument(machine: Machine, load: Any) -> dict[str, float]:
    """Return constant loads by the names of axes [N]; a number is of the first axis."""
    if load is None or isinstance(load, Mapping):
        return {
            name: in_si(f"disturbance of {name}", item, "N") for name, item in (load or {}).items()
        }
    return {machine.axes[0].name: in_si("disturbance", load, "N")}


def filter_arguments(filters: Any, machine: Machine) -> dict[str, Estimator]:
    """Return the filters that were given or named, by their names."""
    if filters is None:
        return {}
    return {name: make() for name, make in factories(filters, machine).items()}


def filter_to_export(
    machine: Any, filter: Any, precision: Literal["float", "double"] = "float",
    table_error: Any = None, choice: Sequence[str] = tuple(KINDS),
) -> tuple[Machine, Estimator]:  # fmt: skip
    """Return the machine and the filter that are to be exported; a filter's file gives both."""
    plant, filter = _plant_and_filter(machine, filter)
    of_core: Precision = "float32" if precision == "float" else "float64"
    default = default_name(plant) if DEFAULT in choice else choice[0]
    factory = _factory(default if filter is None else filter, plant, choice)
    if table_error is not None:
        bound = None if table_error == "auto" else in_si("table_error", table_error, "N")
        if not isinstance(factory.magnet, Expert) or not plant.single:
            raise AmbkitError(
                "only an expert can be tabulated, that of a single axis; give one, or export the "
                "exact form"
            )
        table = tabulate(factory.magnet, plant, bound=bound, precision=of_core)
        factory = replace(factory, magnet=table)
    return plant, factory(precision=of_core)


def _factory(filter: Any, machine: Machine, choice: Sequence[str]) -> FromKind | FromFile:
    """Return what makes the filter: a kind, a filter's file, an expert, a force map, an object."""
    of_type(Estimator, str, os.PathLike, filter=filter)
    if isinstance(filter, Estimator):
        return FromFile(_exportable(in_memory(filter), filter.name, choice), filter.magnet)
    text = os.fspath(filter)
    kind, _, file = split_name(text)
    if kind in choice and not file:
        return FromKind(text, machine, learned_magnet(text, machine))
    if text in KINDS:
        raise AmbkitError(f"filter: {text} cannot be exported yet; {', '.join(choice)} can")
    path = Path(file or text)
    if path.suffix == FILTER_SUFFIX:
        of = _exportable(filter_file_for(text, machine), path, choice)
        return FromFile(of, of.magnet_model())
    if not (path.suffix or path.exists() or os.sep in text):
        near = difflib.get_close_matches(text, choice, 1)
        hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(choice)}"
        raise AmbkitError(f'filter: there is no filter and no file "{text}"; {hint}')
    name = text if file else "adaptive"
    get_kind(name)
    return FromKind(name, machine, experts(path, machine))


def _exportable(file: FilterFile, name: Any, choice: Sequence[str]) -> FilterFile:
    if file.kind not in choice:
        raise AmbkitError(f"{name}: {file.kind} cannot be exported so; {', '.join(choice)} can")
    return file


def scenario_argument(value: Any) -> Scenario | None:
    """Return a scenario, or load it."""
    if isinstance(value, str) and not (os.path.exists(value) or value.endswith(".toml")):
        raise AmbkitError(f'there is no file "{value}"; a scenario is a .toml file')
    return Scenario.load(value) if isinstance(value, str | os.PathLike) else value


def band_argument(value: Any) -> tuple[float, float] | None:
    """Return the ends of a band of frequencies [Hz]."""
    if value is None:
        return None
    low, high = pair_argument("band", value, 'frequencies such as "5 Hz,100 Hz"')
    return in_si("band", low, "Hz"), in_si("band", high, "Hz")


def limit_arguments(value: Sequence[str]) -> tuple[float | None, float | None]:
    """Return limits of current [A] and displacement [m], each told by its unit."""
    results: dict[str, float] = {}
    for text in names_in(limit=value):
        for unit in ("A", "m"):
            with suppress(AmbkitError):
                results[unit] = in_si("limit", text, unit)
                break
        else:
            raise AmbkitError(f'limit must be a current or a length such as "2 A", is {text!r}')
    return results.get("A"), results.get("m")
