"""Panels of signals over time: axes in units that suit, stretches without samples, clock steps."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import label as label_of
from ambkit.base.units import engineering, factor
from ambkit.result.report.figure import Panel
from ambkit.result.report.items import Axis, Item, Line, Rule, Span

MAX_PANELS = 8
"""Channels in a picture; more would not be legible."""

NARROWEST = 0.004
"""Least width of a mark, as a part of the picture's."""

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
