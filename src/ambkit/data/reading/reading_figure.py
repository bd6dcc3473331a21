"""Figures of a log: as read, with its defects, and the errors of a rejected one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import shortened
from ambkit.base.escaping import markdown, one_line
from ambkit.data.reading.clock import examine
from ambkit.data.reading.faults import Fault
from ambkit.data.reading.rejections import RejectedLog
from ambkit.data.record import Record
from ambkit.data.record_card import MAX_PANELS, axis_of, missing_spans, steps_panel
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule
from ambkit.result.signal_styles import TIME

_FIRST = ("y", "u", "r")
_MARKED = {"missing": "missing", "gap": "missing", "infinite": "missing"}
_OVERLAID = ("saturated", "frozen")


def reading_figure(reading: Any) -> Figure:
    """Plot the channels of a log with their defects; its clock too, if that is uneven."""
    record = reading.record
    names = sorted(record, key=lambda name: (name not in _FIRST, list(record).index(name)))
    delays = {channel.name: channel.delay for channel in reading.channels}
    panels = [
        _channel(record, name, reading.faults, delays.get(name, 0.0)) for name in names[:MAX_PANELS]
    ]
    for clock in reading.clocks.values():
        if clock.gaps.size or clock.jumps.size or clock.uneven.size:
            usual = Rule(clock.step, signal="bound", text="", label="")
            steps = np.diff(clock.times)
            panels.append(steps_panel(clock.name, clock.times[1:], steps, TIME, [usual]))
    left = names[MAX_PANELS:]
    sentences = [f"Not shown: {', '.join(map(markdown, left))}."] if left else []
    sentences += [
        f"{markdown(fault.signal)} {fault.text}."
        for fault in reading.faults
        if fault.kind in ("constant", "quantised")
    ]
    return Figure(
        id="record",
        title=f"{markdown(record.meta.get('source', reading.source))}, as read",
        caption=" ".join(sentences),
        panels=panels,
    )


def _channel(record: Record, name: str, faults: Iterable[Fault], delay: float) -> Panel:
    t, values = record.t, record[name]
    own = [fault for fault in faults if fault.signal == name]
    items: list[Item] = [Line(t, values, signal="channel")]
    for kind in _OVERLAID:
        results = [fault for fault in own if fault.kind == kind]
        if results:
            items.append(Line(t, _only(t, values, results), signal=kind))
    spiky = [fault for fault in own if fault.kind == "spike" and fault.action == "kept"]
    if spiky:
        there = np.isfinite(_only(t, values, spiky))
        items.append(Points(t[there], values[there], signal="spike"))
    missing = [fault for fault in own if _MARKED.get(fault.kind)]
    missing += [fault for fault in own if fault.action == "taken as missing"]
    stretches = [(fault.start, fault.stop) for fault in missing]
    # A gap of the clock is earlier in a channel with a logging delay.
    gaps = [fault for fault in faults if _MARKED.get(fault.kind) and fault.signal == "t"]
    stretches += [(fault.start - delay, fault.stop - delay) for fault in gaps]
    items += missing_spans(
        [stretch for stretch in stretches if stretch[0] <= t[-1] and stretch[1] >= t[0]], t
    )
    if any(fault.kind == "constant" and fault.text for fault in own):
        items.append(Rule(float(np.nanmean(values)), signal="frozen", text="constant", label=""))
    return Panel(TIME, axis_of(name, record.units[name], values), items)


def _only(t: Array, values: Array, faults: Iterable[Fault]) -> Array:
    """Return the samples within the defects, NaN elsewhere."""
    half = 0.5 * float(t[-1] - t[0]) / (t.size - 1)
    result = np.full(values.size, np.nan)
    for fault in faults:
        within = slice(*np.searchsorted(t, [fault.start - half, fault.stop + half]))
        result[within] = values[within]
    return result


SHOWN = 6  #: Maximum number of channels in the figure; its clocks come first.
MAX_REASONS = 3  #: Maximum number of reasons below it.

_NUMBER = Axis("sample")


def refused_figure(refused: RejectedLog) -> Figure | None:
    """Plot the clocks and channels of a rejected log, with the places of the errors."""
    # Over time, if all of its clocks advance; over the sample number otherwise.
    mapped = refused.mapped
    clocks = {name: times for name, times in mapped.clocks.items() if times.size > 1}
    signals = {
        name: values
        for name, values in mapped.signals.items()
        if values.size > 1 and np.isfinite(values).any()
    }
    if not clocks and not signals:
        return None
    over_time = not refused.damaged and all(
        np.isfinite(times).all() and (np.diff(times) > 0).all() for times in clocks.values()
    )
    panels: list[Panel] = []
    for name, times in clocks.items():
        x = times if over_time else _numbers(times)
        marks = list(_marks(x, _troubles(name, times, refused.damaged)))
        axis = TIME if over_time else _NUMBER
        if not over_time:
            line = Line(x, times, signal="measurement", label="clock")
            panels.append(Panel(axis, axis_of(name, "s", times), [line, *marks]))
        panels.append(steps_panel(name, x[1:], np.diff(times), axis, marks))
    for name, values in list(signals.items())[:SHOWN]:
        own = mapped.clock_of[name]
        timed = over_time and own in clocks and clocks[own].shape == values.shape
        x = clocks[own] if timed else _numbers(values)
        trouble = _troubles(own, clocks[own], refused.damaged) if own in clocks else ()
        inside = [at for at in trouble if at < values.size]
        channel = Line(x, np.where(np.isfinite(values), values, np.nan), signal="channel")
        axis = axis_of(name, mapped.units[name], values)
        panels.append(Panel(TIME if timed else _NUMBER, axis, [channel, *_marks(x, inside)]))
    # In Markdown a backquote would end the code, and a dollar sign begin a formula.
    plain = (one_line(text).replace("`", "'").replace("$", "") for text in refused.problems)
    sentences = shortened([f"`{problem}`" for problem in plain], MAX_REASONS)
    if left := list(signals)[SHOWN:]:
        sentences.append(f"Not shown: {', '.join(map(markdown, left))}.")
    return Figure(
        id="refused",
        title=f"{markdown(refused.name.replace(chr(92), '/').rpartition('/')[2])}: refused",
        caption=" ".join(sentences),
        panels=panels,
    )


def _numbers(values: Array) -> Array:
    return np.arange(values.size, dtype=np.float64)


def _troubles(name: str, times: Array, damaged: Iterable[int]) -> list[int]:
    """Return the erroneous samples of a clock."""
    results = [at for at in damaged if at < times.size]
    finite = np.isfinite(times)
    results += np.flatnonzero(~finite).tolist()
    if np.count_nonzero(finite) > 1:
        clock = examine(name, times[finite])
        gaps = clock.gaps if not clock.whole_gaps else clock.gaps[:0]
        places = np.concatenate([clock.jumps, clock.uneven, gaps])
        results += np.flatnonzero(finite)[places].tolist()
    return sorted(set(results))


def _marks(x: Array, troubles: Iterable[int]) -> Iterable[Item]:
    """Mark samples, each with the previous one."""
    stretches = [(float(x[max(at - 1, 0)]), float(x[at])) for at in troubles]
    return missing_spans(stretches, x, "refused for this")
