"""A picture of a log: its channels over time, with their faults marked."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.data.reading.faults import Fault
from ambkit.data.record import Record
from ambkit.data.record_card import MAX_PANELS, axis_of, missing_spans, steps_panel
from ambkit.result.report import Figure, Item, Line, Panel, Points, Rule
from ambkit.result.signal_styles import TIME

_FIRST = ("y", "u", "r")
_MARKED = {"missing": "missing", "gap": "missing", "infinite": "missing"}
_OVERLAID = ("saturated", "frozen")


def reading_figure(reading: Any) -> Figure:
    """Show the channels of a log with their faults; its clock too, where that is not even."""
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
    # A gap of the clock comes earlier in a channel that was logged late.
    gaps = [fault for fault in faults if _MARKED.get(fault.kind) and fault.signal == "t"]
    stretches += [(fault.start - delay, fault.stop - delay) for fault in gaps]
    items += missing_spans(
        [stretch for stretch in stretches if stretch[0] <= t[-1] and stretch[1] >= t[0]], t
    )
    if any(fault.kind == "constant" and fault.text for fault in own):
        items.append(Rule(float(np.nanmean(values)), signal="frozen", text="constant", label=""))
    return Panel(TIME, axis_of(name, record.units[name], values), items)


def _only(t: Array, values: Array, faults: Iterable[Fault]) -> Array:
    """Return the samples within the faults, NaN elsewhere."""
    half = 0.5 * float(t[-1] - t[0]) / (t.size - 1)
    result = np.full(values.size, np.nan)
    for fault in faults:
        within = slice(*np.searchsorted(t, [fault.start - half, fault.stop + half]))
        result[within] = values[within]
    return result
