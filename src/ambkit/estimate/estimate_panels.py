"""Panels of estimates over time: axes without initial transients, innovations with bounds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.escaping import label as label_of
from ambkit.data.record import Record
from ambkit.data.record_card import lost_spans
from ambkit.estimate.status import Status
from ambkit.result.report import Axis, Band, Item, Line, Note, Panel, Points

STRETCHES, STRETCH = 200, 20
"""Maximum number of bins for innovations, and minimum of samples in each."""

BEYOND = 1.5  #: Ratio of the largest innovation to most others beyond which the axis is limited.


def true_noise(record: Record) -> list[Item]:
    """Plot the total sensor noise, if the truth is known."""
    if "x_m" not in record.truth:
        return []
    return [Line(record.t, record["y"] - record["x_m"], signal="measured")]


def contact_spans(t: Array, estimates: Iterable[Any]) -> list[Item]:
    """Mark where a filter assumes contact with a stop."""
    flags = [(np.asarray(one.status) & int(Status.CONTACT)) != 0 for one in estimates]
    return lost_spans(np.any(flags, axis=0), t, "contact") if flags else []


def with_limits(axis: Axis, items: Iterable[Item], where: NDArray[np.bool_]) -> Axis:
    """Return the axis with limits that show the lines completely where they are settled."""
    edges = [item.y for item in items if isinstance(item, Line)]
    edges += [edge for item in items if isinstance(item, Band) for edge in (item.low, item.high)]
    values = np.concatenate([edge[where] for edge in edges])
    low, high = np.nanmin(values), np.nanmax(values)
    margin = 0.05 * (high - low)
    if not margin > 0:
        return axis
    return replace(axis, limits=(float(low - margin), float(high + margin)))


def settled_samples(t: NDArray[np.float64], estimates: Iterable[Any]) -> NDArray[np.bool_]:
    """Return where all filters are settled: not at the start, nor after a gap with HELD."""
    # Their initial transients would compress the rest.
    blind = np.zeros(t.size, dtype=bool)
    blind[0] = True
    for estimate in estimates:
        blind |= (estimate.status & np.uint16(Status.HELD)) != 0
    last = np.maximum.accumulate(np.where(blind, np.arange(t.size), 0))
    settled = np.asarray(t >= t[last] + 0.02 * np.ptp(t))
    return settled if settled.any() else np.ones(t.size, dtype=bool)


def _innovations(t: Array, innovation: Array) -> Item:
    """Return innovations one by one, or for a long record the range of most in each bin."""
    count = t.size // STRETCH
    if count < STRETCHES:
        return Line(t, innovation, signal="innovation")
    length = t.size // STRETCHES
    stretches = innovation[: STRETCHES * length].reshape(STRETCHES, length)
    known = np.isfinite(stretches).sum(axis=1) >= STRETCH // 2
    low, high = np.full((2, STRETCHES), np.nan)
    low[known], high[known] = np.nanquantile(stretches[known], (0.025, 0.975), axis=1)
    middle = t[: STRETCHES * length].reshape(STRETCHES, length).mean(axis=1)
    return Band(middle, low, high, signal="innovation", label="innovation, 95 % of a stretch")


def innovation_panel(name: str, estimate: Any, time: Axis, absent: Sequence[Item]) -> Panel:
    """Plot innovations with their bounds; mark those beyond the axis."""
    # Of several readings those with the largest normalised innovations.
    t, e, S = estimate.t, estimate.innovation, estimate.innovation_variance
    if e.ndim > 1:
        k = int(np.argmax((e**2 / np.where(S > 0, S, np.inf)).mean(axis=0)))
        e, S, name = e[:, k], S[:, k], f"{name} {estimate.readings[k]}".strip()
    usable = estimate.used | ((estimate.status & np.uint16(Status.OUTLIER)) != 0)
    innovation, expected = np.where(usable, e, np.nan), 2 * np.sqrt(S)
    # The first bounds are so wide that all others would appear as a line.
    expected[expected > 1.5 * np.median(expected)] = np.nan
    expected[expected == 0] = np.nan  # a low-pass has no S
    items: list[Item] = [
        _innovations(t, innovation),
        Line(t, expected, signal="bound", label="±2√S"),
        Line(t, -expected, signal="bound", label=""),
        *absent,
    ]
    axis = Axis("innovation", "µm", 1e6)
    title = f"Innovations of {label_of(name)}" if name else ""
    sizes = np.abs(innovation[np.isfinite(innovation)])
    if not sizes.size:
        return Panel(time, axis, items, title=title)
    most = float(np.nanmax([np.quantile(sizes, 0.995), *expected]))
    if sizes.max() <= BEYOND * most:
        return Panel(time, axis, items, title=title)
    edge = 1.3 * most
    far = np.flatnonzero(np.abs(np.nan_to_num(innovation)) > edge)
    for sign, style in ((1, "beyond above"), (-1, "beyond below")):
        side = far[np.sign(innovation[far]) == sign]
        if side.size:
            items.append(Points(t[side], np.full(side.size, 0.9 * sign * edge), signal=style))
    largest = far[np.argmax(np.abs(innovation[far]))]
    value = f"{1e6 * innovation[largest]:.0f} µm".replace("-", "−")
    up = innovation[largest] > 0
    # At the record's end the text would not fit.
    at = float(np.clip(t[largest], *(t[0] + np.ptp(t) * np.array([0.05, 0.95]))))
    items.append(Note(at, 0.84 * edge * (1 if up else -1), value, "below" if up else "above"))
    return Panel(time, replace(axis, limits=(-edge, edge)), items, title=title)
