"""Figure and description of a record: its signals over time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base import escaping
from ambkit.base.arrays import Array, Bools, stretches
from ambkit.base.units import engineering, factor
from ambkit.result.card import SPAN, Card, spread, value
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule, Span
from ambkit.result.signal_styles import TIME

MAX_PANELS = 8  #: Maximum number of channels in a figure.
NARROWEST = 0.004  #: Minimum width of a mark, over that of the figure.

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


def axis_of(name: str, unit: str, values: Array) -> Axis:
    """Return an axis with a suitable prefix."""
    there = values[np.isfinite(values)]
    largest = float(np.abs(there).max()) if there.size else 0.0
    display_unit = engineering(largest, unit).partition(" ")[2]
    label = _LABELS.get(name, escaping.label(name))
    if not display_unit or largest == 0.0:
        return Axis(label, "" if unit == "1" else unit)
    return Axis(
        label, display_unit.replace("^2", "²").replace("^3", "³"), factor(unit, display_unit)
    )


def missing_spans(
    spans: Iterable[tuple[float, float]], t: Array, label: str | None = None,
    signal: str = "missing",
) -> Iterator[Item]:  # fmt: skip
    """Mark spans [s], by default those without samples; the legend is `label`."""
    # They are widened to the visible width of a sample, and joined where they would overlap.
    least = NARROWEST * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for first, last in sorted(spans):
        middle, half = (first + last) / 2, max(last - first, least) / 2
        start, stop = middle - half, middle + half
        if joined and start <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(stop, joined[-1][1])
        else:
            joined.append((start, stop))
    for start, stop in joined:
        narrow = stop - start < 5 * least  # too narrow for its pale colour to be visible
        ends = max(start, float(t[0])), min(stop, float(t[-1]))
        yield Span(*ends, signal=signal, label="" if narrow else label)
        if narrow:
            yield Rule((start + stop) / 2, axis="x", signal=signal, label=label)


def lost_spans(lost: Bools, t: Array, signal: str = "missing") -> list[Item]:
    """Mark samples (n,), by default missing ones, at the times (n,) [s]."""
    spans = [(float(t[a]), float(t[b - 1])) for a, b in stretches(lost)]
    return list(missing_spans(spans, t, signal=signal))


def steps_panel(name: str, x: Array, steps: Array, axis: Axis, more: Iterable[Item]) -> Panel:
    """Plot the time between samples (n,) [s] over `x` (n,), with further items."""
    there = steps[np.isfinite(steps)]
    low, high = (float(there.min()), float(there.max())) if there.size else (0.0, 0.0)
    usual = float(np.median(np.abs(there))) if there.size else 1.0
    margin = 0.1 * max(high - low, usual)
    step_axis = replace(
        axis_of(name, "s", steps), label=f"step of {escaping.label(name)}",
        limits=(low - margin, high + margin),
    )  # fmt: skip
    line = Line(x, steps, signal="measurement", label="time between samples")
    return Panel(axis, step_axis, [line, *more])


SHARING = {"y": "measured", "r": "reference", "x": "truth"}
"""Signals that share a panel, with their styles; the first one names it."""

TOLD_BY = {"iu": "u", "f_mag": "f_d", "x_m": "y"}
"""Signals that are omitted if the other one is nearly equal."""


def record_figure(record: Any) -> Figure:
    """Plot a record's signals over time; at most eight panels."""
    groups = list(_groups(record))
    names = [name for names in groups[MAX_PANELS:] for name in names]
    left = f"Not shown: {', '.join(map(escaping.markdown, names))}." if names else ""
    return Figure(
        id="record",
        title=escaping.markdown(record.meta.get("source") or "Record"),
        caption=left,
        panels=[_panel(record, names) for names in groups[:MAX_PANELS]],
    )


def _groups(record: Any) -> Iterator[Sequence[str]]:
    names = [name for name in record if TOLD_BY.get(name) not in record.signals]
    if shared := [name for name in SHARING if name in names]:
        yield shared
    yield from ([name] for name in names if name not in SHARING)


def _panel(record: Any, names: Sequence[str]) -> Panel:
    t = record.t
    several = len(names) > 1
    items: list[Item] = []
    for name in names:
        known = several and (name != "x" or record.has_truth)
        text = None if known else escaping.label(name) if several else ""
        style = SHARING[name] if known else "channel"
        items.append(Line(t, record[name], signal=style, label=text))
    items += lost_spans(np.isnan(record[names[0]]), t)
    values = np.concatenate([record[name] for name in names])
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    return Panel(time, axis_of(names[0], record.units[names[0]], values), items)


def record_card(of: Any) -> Card:
    """Describe a record by its signals."""
    rows = [
        [name, *spread(of[name], of.units[name]), str(int(np.isnan(of[name]).sum()))] for name in of
    ]
    simulated = ", simulated" if of.has_truth else ""
    title = (
        f"Record{simulated}: {len(of)} samples, {value(float(of.t[0]), 's')} to "
        f"{value(float(of.t[-1]), 's')}, every {value(of.sampling_time, 's')}"
    )
    source = of.meta.get("source")
    notes = [] if source is None else [f"From {source}."]
    return Card(title, rows, record_figure(of), ["", *SPAN, "missing"], notes)
