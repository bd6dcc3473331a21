"""A picture of a log: its channels over time, with their faults marked."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import label as label_of
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering, factor
from ambkit.data.reading.clock import Clock
from ambkit.data.reading.faults import Fault
from ambkit.data.reading.reader import Reading
from ambkit.data.record import Record
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Item, Line, Points, Rule, Span

Array = NDArray[np.float64]

SHOWN = 8
"""Channels in a picture; more would not be legible."""

NARROWEST = 0.004
"""Least width of a mark, as a part of the picture's."""

_TIME = Axis("time", "s")
_FIRST = ("y", "u", "r")
_LABELS = {
    "y": "position $y$",
    "u": "control signal $u$",
    "r": "reference $r$",
    "x": "displacement $x$",
    "v": "velocity $v$",
    "f_d": "disturbance force",
    "iu": "control current $i_u$",
    "f_mag": "magnet force",
}
_MARKED = {"missing": "missing", "gap": "missing", "infinite": "missing"}
_OVERLAID = ("saturated", "frozen")


def reading_figure(reading: Reading) -> Figure:
    """Show the channels of a log with their faults; its clock too, where that is not even."""
    record = reading.record
    names = sorted(record, key=lambda name: (name not in _FIRST, list(record).index(name)))
    delays = {channel.name: channel.delay for channel in reading.channels}
    panels = [
        _channel(record, name, reading.faults, delays.get(name, 0.0)) for name in names[:SHOWN]
    ]
    panels += [_steps(clock) for clock in reading.clocks.values() if _is_uneven(clock)]
    left = f"Not shown: {', '.join(map(markdown, names[SHOWN:]))}. " if len(names) > SHOWN else ""
    fault_texts = [
        f"{markdown(fault.signal)} {fault.text}"
        for fault in reading.faults
        if fault.kind in ("constant", "quantised")
    ]
    return Figure(
        id="record",
        title=f"{markdown(record.meta.get('source', reading.source))}, as read",
        caption=left + " ".join(f"{text}." for text in fault_texts),
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
    # A gap of the clock comes earlier in a channel that was logged late.
    gaps = [fault for fault in faults if _MARKED.get(fault.kind) and fault.signal == "t"]
    stretches += [(fault.start - delay, fault.stop - delay) for fault in gaps]
    items += missing_spans(
        [stretch for stretch in stretches if stretch[0] <= t[-1] and stretch[1] >= t[0]], t
    )
    constant = next((fault.text for fault in own if fault.kind == "constant"), "")
    axis = axis_of(name, record.units[name], values)
    if constant:
        items.append(Rule(float(np.nanmean(values)), signal="frozen", text="constant", label=""))
    return Panel(_TIME, axis, items)


def axis_of(name: str, unit: str, values: Array) -> Axis:
    """Return an axis in the multiple of the unit that suits the values."""
    there = values[np.isfinite(values)]
    largest = float(np.abs(there).max()) if there.size else 0.0
    display_unit = engineering(largest, unit).partition(" ")[2]
    label = _LABELS.get(name, label_of(name))
    if not display_unit or largest == 0.0:
        return Axis(label, "" if unit == "1" else unit)
    return Axis(
        label, display_unit.replace("^2", "²").replace("^3", "³"), factor(unit, display_unit)
    )


def _only(t: Array, values: Array, faults: Iterable[Fault]) -> Array:
    """Return the samples within the faults, NaN elsewhere."""
    half = 0.5 * float(t[-1] - t[0]) / (t.size - 1)
    result = np.full(values.size, np.nan)
    for fault in faults:
        within = slice(*np.searchsorted(t, [fault.start - half, fault.stop + half]))
        result[within] = values[within]
    return result


def missing_spans(
    stretches: Iterable[tuple[float, float]], t: Array, label: str | None = None
) -> Iterator[Item]:
    """Mark stretches [s] without samples; the legend says so, or what `label` says."""
    # They are widened so that one sample is seen, and joined where they would overlap.
    least = NARROWEST * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for first, last in sorted(stretches):
        middle, half = (first + last) / 2, max(last - first, least) / 2
        start, stop = middle - half, middle + half
        if joined and start <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(stop, joined[-1][1])
        else:
            joined.append((start, stop))
    for start, stop in joined:
        narrow = stop - start < 5 * least  # too narrow for its pale colour to be seen
        ends = max(start, float(t[0])), min(stop, float(t[-1]))
        yield Span(*ends, signal="missing", label="" if narrow else label)
        if narrow:
            yield Rule((start + stop) / 2, axis="x", signal="missing", label=label)


def _is_uneven(clock: Clock) -> bool:
    return bool(clock.gaps.size or clock.jumps.size or clock.uneven.size)


def _steps(clock: Clock) -> Panel:
    """Show the time between samples where a clock has gaps or jitter."""
    usual = Rule(clock.step, signal="bound", text="", label="")
    return steps_panel(clock.name, clock.times[1:], np.diff(clock.times), _TIME, [usual])


def steps_panel(name: str, x: Array, steps: Array, axis: Axis, more: Iterable[Item]) -> Panel:
    """Show the time between samples (n,) [s] over `x` (n,), and `more` with it."""
    there = steps[np.isfinite(steps)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 0.0)
    display_unit = engineering(max(abs(low), abs(high)), "s").partition(" ")[2]
    usual = float(np.median(np.abs(there))) if there.size else 1.0
    margin = 0.1 * max(high - low, usual)
    label = Axis(
        f"step of {label_of(name)}",
        display_unit,
        factor("s", display_unit),
        limits=(low - margin, high + margin),
    )
    return Panel(
        axis, label, [Line(x, steps, signal="measurement", label="time between samples"), *more]
    )
