"""Conversion of a log into a record, with a report of defects and actions."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, shortened
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.base.units import engineering, figure
from ambkit.data.channel_map import ChannelMap, MappedSignals
from ambkit.data.files.log import DamagedLog, Log
from ambkit.data.files.tables import read_log, to_table
from ambkit.data.reading import clock as timing
from ambkit.data.reading import faults as channel_faults
from ambkit.data.reading.clock import HELD, Clock
from ambkit.data.reading.faults import Channel, Fault, clock_faults
from ambkit.data.reading.plausibility import suspects
from ambkit.data.reading.reading_figure import reading_figure
from ambkit.data.reading.rejections import RejectedLog, check_times, refuse_uneven, segments_of
from ambkit.data.record import Record, time_problems
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

SENTENCES = 30  #: Maximum number of report sentences stored with the record.


@dataclass(frozen=True, eq=False, repr=False)
class Reading(Result):
    """A record, and the report of its reading."""

    record: Record  #: The signals on one even grid.
    clocks: Mapping[str, Clock]  #: The clocks of the log, ``t`` first.
    channels: tuple[Channel, ...]  #: Summary of each channel of the log.
    faults: tuple[Fault, ...]  #: All defects, by channel, with the actions.
    remarks: tuple[str, ...]  #: Remarks on the format, shifts and resampling.
    source: str  #: File.

    def account(self) -> list[str]:
        """Summarise defects and actions in sentences, grouped by kind."""
        lines = [f"{name}: {clock.describe()}" for name, clock in self.clocks.items()]
        step = min(clock.step for clock in self.clocks.values())
        return [*lines, *self.remarks, *channel_faults.account(self.faults, step)]

    TITLE = "{0.source}"
    SECTIONS = {("channels",): Section("Channels", across=True)}

    @property
    def finding(self) -> str:
        record, count = self.record, len(self.faults)
        return (
            f"{Path(self.source).name}: {len(record)} samples every "
            f"{figure(record.sampling_time, 's')}, "
            f"{f'{count} fault' + 's' * (count > 1) if count else 'no faults'} found."
        )

    @property
    def rows(self) -> list[Row]:
        return [row for channel in self.channels for row in put(channel.rows(), of=channel.name)]

    @property
    def notes(self) -> list[str]:
        return self.account()

    @property
    def series(self) -> dict[str, Any]:
        return {
            "source": self.source,
            "samples": len(self.record),
            "sampling_time": self.record.sampling_time,
            "clocks": {name: clock.to_dict() for name, clock in self.clocks.items()},
            "channels": {channel.name: asdict(channel) for channel in self.channels},
            "faults": [asdict(fault) for fault in self.faults],
        }

    def file(self) -> Record:
        return self.record

    def figures(self) -> list[Figure]:
        return [reading_figure(self)]


def read(
    path: str | os.PathLike[str],
    map: ChannelMap | str | os.PathLike[str] | None = None,
    *,
    resample: bool = False,
    sampling_time: QuantityLike | None = None,
    segment: int | None = None,
    missing: Collection[str] = (),
    progress: Callable[[str], object] = lambda _: None,
) -> Reading:
    """Read a log into a record, and report its defects."""
    wrong = set(missing) - set(channel_faults.MASKABLE)
    if wrong:
        *some, last = channel_faults.MASKABLE
        known = f"{', '.join(some)} and {last}"
        raise RecordError(f"only {known} can be taken as missing, not {min(wrong)}")
    sampling_time = in_si("sampling_time", sampling_time, "s")
    log, mapped = _mapped(path, map, progress)
    try:
        return _placed(log, mapped, resample, sampling_time, segment, missing, progress)
    except RecordError as error:
        raise RejectedLog(error, log.name, mapped) from None


def _placed(
    log: Log,
    mapped: MappedSignals,
    resample: bool,
    sampling_time: float | None,
    segment: int | None,
    missing: Collection[str],
    progress: Callable[[str], object],
) -> Reading:
    """Put the signals of a log on one grid, and report defects; see `read`."""
    remarks = [*log.remarks, *mapped.remarks]
    clocks = _clocks(log, mapped)
    signals = dict(mapped.signals)
    faults = [fault for clock in clocks.values() for fault in clock_faults(clock)]
    if segment is not None or any(clock.jumps.size for clock in clocks.values()):
        parts, remark = segments_of(log, clocks, segment)
        signals = {name: v[parts[mapped.clock_of[name]]] for name, v in signals.items()}
        clocks = {name: clock.part(parts[name]) for name, clock in clocks.items()}
        remarks.append(remark)
        faults = [replace(f, action="another part is read") for f in faults if f.kind == "jump"]
        faults += [fault for clock in clocks.values() for fault in clock_faults(clock)]
    if not resample:
        refuse_uneven(log, mapped, clocks)
    channels: list[Channel] = []
    for name in signals:
        progress(f"looking at {name}")
        clock = clocks[mapped.clock_of[name]]
        channel, signals[name], more = _examined(name, signals[name], mapped, clock, missing)
        channels.append(channel)
        faults += more
    progress("placing the samples")
    if resample:
        done = "resampled"
        times, on_grid, notes = _resampled(log, signals, mapped.clock_of, clocks, sampling_time)
        remarks += notes
    elif sampling_time is not None:
        raise RecordError("sampling_time (--sampling-time) is the step to resample to: ask for it")
    else:
        done = "filled with missing samples"
        times, place = timing.insert_missing(clock)
        on_grid = {name: timing.spread(v, place, times.size) for name, v in signals.items()}
    step = float(times[-1] - times[0]) / (times.size - 1)
    for name, delay in mapped.delays.items():
        on_grid[name] = timing.shifted(on_grid[name], delay / step, held=name in HELD)
        remarks.append(timing.describe_shift(name, delay, step))
    remarks += suspects(times, on_grid, mapped.units)
    faults = [replace(f, action=done) if f.kind in ("gap", "jitter") else f for f in faults]
    reading = Reading(
        Record.__new__(Record), clocks, tuple(_as_placed(c, on_grid, mapped) for c in channels),
        tuple(_within(fault, times) for fault in faults), tuple(remarks), log.name,
    )  # fmt: skip
    meta = mapped.meta | {"source": Path(log.name).name}
    meta["reading"] = reading.account()[:SENTENCES]
    return replace(reading, record=_record(log, times, on_grid, mapped.units, meta))


def _clocks(log: Log, mapped: MappedSignals) -> dict[str, Clock]:
    used = list(dict.fromkeys(mapped.clock_of.values()))
    check_times(log, mapped, used)
    return {name: timing.examine(name, mapped.clocks[name]) for name in used}


def _record(log: Log, times: Array, signals: Mapping[str, Array], *of: Any) -> Record:
    try:
        return Record(times, signals, *of)
    except RecordError as error:
        raise RecordError([f"{log.name}: {text}" for text in error.problems], log.name) from None


def _examined(
    name: str, logged: Array, mapped: MappedSignals, clock: Clock, missing: Collection[str]
) -> tuple[Channel, Array, list[Fault]]:
    """Summarise a channel with its defects, and mark samples as missing."""
    unit, delay = mapped.units[name], mapped.delays.get(name, 0.0)
    values, faults = np.where(np.isinf(logged), np.nan, logged), []
    channel = channel_faults.measure(name, unit, values, clock.name)
    for fault in channel_faults.find(name, logged, clock.times, unit):
        if fault.kind in missing:
            first = np.searchsorted(clock.times, fault.start)
            values[first : first + fault.samples] = np.nan
        if fault.kind in (*missing, "infinite"):
            fault = replace(fault, action="taken as missing")
        # Defects are at their places in the record.
        faults.append(replace(fault, start=fault.start - delay, stop=fault.stop - delay))
    return channel, values, faults


def load_with_gaps(
    path: str | os.PathLike[str],
    channel_map: ChannelMap | str | os.PathLike[str] | None = None,
    note: Callable[[str], object] = lambda _: None,
) -> Record:
    """Read a record as `load` does; gaps of a log are filled as by `read`."""
    try:
        return load(path, channel_map)
    except RecordError:
        if channel_map is None:
            raise
    result = read(path, channel_map)
    for sentence in result.account():
        note(f"{os.fspath(path)}: {sentence}")
    return result.record


def load(
    path: str | os.PathLike[str], channel_map: ChannelMap | str | os.PathLike[str] | None = None
) -> Record:
    """Read a record with an even clock, with or without a channel map; `read` accepts defects."""
    if channel_map is None:
        return Record.load(path)
    log, mapped = _mapped(path, channel_map, lambda _: None)
    clocks = _clocks(log, mapped)
    if len(clocks) > 1:
        refuse_uneven(log, mapped, clocks)
    t = mapped.clocks[next(iter(clocks))]
    problems = list(time_problems(t, log.place))
    if problems:
        advice = f"{log.name}: 'ambkit read' can make an even record of it"
        raise RecordError([*shortened(problems), advice], log.name)
    step = float(t[-1] - t[0]) / (t.size - 1)
    signals = dict(mapped.signals)
    for name, delay in mapped.delays.items():
        signals[name] = timing.shifted(signals[name], delay / step, held=name in HELD)
    return _record(log, t, signals, mapped.units, mapped.meta | {"source": Path(path).name})


def _mapped(
    path: str | os.PathLike[str],
    channel_map: ChannelMap | str | os.PathLike[str] | None,
    progress: Callable[[str], object],
) -> tuple[Log, MappedSignals]:
    """Read a log, and select its signals; a table with names and units needs no map."""
    if channel_map is not None and not isinstance(channel_map, ChannelMap):
        channel_map = ChannelMap.load(channel_map)
    selection, texts = (
        (channel_map.columns_needed, channel_map.texts) if channel_map else (None, ())
    )
    error: RecordError | None = None
    damaged: tuple[int, ...] = ()
    try:
        log = read_log(path, selection, progress, texts=texts)
    except DamagedLog as damage:
        log, error, damaged = damage.log, damage, damage.samples
    if channel_map is not None:
        mapped, problems = channel_map.pick(log)
        error = error or (RecordError(problems, log.name) if problems else None)
    else:
        try:
            table = to_table(log)
        except RecordError as other:
            raise error or other from None
        columns = dict(table.columns)
        if "t" not in columns and error is None:
            raise RecordError(f"{path}: has no column t [s]; it has {', '.join(columns)}")
        clocks = {"t": columns.pop("t")} if "t" in columns else {}
        units = {name: table.units[name] for name in columns}
        mapped = MappedSignals(columns, units, clocks, dict.fromkeys(columns, "t"), {}, table.meta)
    if error:
        raise RejectedLog(error, log.name, mapped, damaged)
    return log, mapped


def _within(fault: Fault, times: Array) -> Fault:
    """Clip a defect to the record, beyond which a delay may have moved it."""
    if fault.kind == "jump" or (times[0] <= fault.start and fault.stop <= times[-1]):
        return fault
    if fault.stop < times[0] or fault.start > times[-1]:
        return replace(fault, action="shifted out of the record")
    ends = max(fault.start, float(times[0])), min(fault.stop, float(times[-1]))
    return replace(fault, start=ends[0], stop=ends[1])


def _as_placed(channel: Channel, on_grid: Mapping[str, Array], mapped: MappedSignals) -> Channel:
    """Count the samples of the record: gaps are filled, stretches may be masked."""
    values, delay = on_grid[channel.name], mapped.delays.get(channel.name, 0.0)
    missing = int(np.isnan(values).sum())
    return replace(channel, samples=values.size, missing=missing, delay=delay)


def _resampled(
    log: Log,
    signals: Mapping[str, Array],
    clock_of: Mapping[str, str],
    clocks: Mapping[str, Clock],
    sampling_time: float | None,
) -> tuple[Array, dict[str, Array], list[str]]:
    """Resample all signals on the even grid of the first clock."""
    jumping = [clock.name for clock in clocks.values() if clock.jumps.size]
    if jumping:
        raise RecordError(f"{log.name}: the clock {jumping[0]} jumps: it cannot be resampled")
    main = clocks.get("t") or next(iter(clocks.values()))
    step = sampling_time or main.step
    times = timing.even_grid(main, step)
    if times.size < 2:
        raise RecordError(
            f"{log.name}: a sampling time of {engineering(step, 's')} leaves no two samples"
        )
    results = {
        name: timing.resample(v, clocks[clock_of[name]], times, held=name in HELD)
        for name, v in signals.items()
    }
    how = Counter("held" if name in HELD else "straight" for name in signals)
    notes = [f"resampled to {engineering(1 / step, 'Hz', digits=5)}, without a low-pass before"]
    if how["straight"]:
        names = ", ".join(name for name in signals if name not in HELD)
        notes.append(f"{names}: on straight lines between the samples")
    if how["held"]:
        notes.append("u: as it was at the last sample, since a controller holds it")
    return times, results, notes
