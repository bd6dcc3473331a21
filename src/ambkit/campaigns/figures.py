"""Pictures of many machines: cumulative curves, what drives a figure, parallel coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.units import engineering
from ambkit.result.report import Axis, Figure, Intervals, Item, Line, Note, Panel, Points, Rule

SERIES = 4  #: Curves of one panel that have a look of their own.
POINTS = 400  #: Of a cumulative curve: a million machines make no finer one.
FAR = 0.995  #: Share of the machines that a curve shows where the rest lies far out.
BEYOND = 2.0  #: How far beyond its ceiling, and beyond what was taken, a front is shown.
FOLDED = 14  #: Characters of a line of a name.
LINES = 80  #: Machines of each kind among parallel coordinates.

_PREFIXES = {"": 1.0, "m": 1e3, "µ": 1e6, "n": 1e9, "k": 1e-3}
_SCALED = ("m", "s", "N", "A", "m/s", "V", "kg")


LABELS = {
    "peak_S": "peak of |S|",
    "x_rms": "error of the position, rms",
    "v_rms": "error of the velocity, rms",
    "f_d_rms": "error of the disturbance force, rms",
    "x_peak": "greatest error of the position",
    "v_peak": "greatest error of the velocity",
    "f_d_peak": "greatest error of the disturbance force",
    "nis": "normalised innovation squared",
    "tracking_rms": "control error, rms",
    "tracking_peak": "maximum control error",
    "effort": "change of the current, rms",
    "displacement_peak": "greatest displacement",
    "current_peak": "greatest control current",
    "orbit_peak": "farthest from the middle",
    "orbit_share": "farthest, of the travel",
    "overshoot": "overshoot",
    "settling": "settling time",
    "recovery": "time to recover from the load",
    "load_kept": "load that was kept",
    "touched": "samples at a stop",
    "landed": "at a stop at the end",
}
"""Figures of runs in words."""


def in_words(names: Sequence[str]) -> list[str]:
    """Return keys of what varies in words: the last of each, and more where two are alike."""

    def last(name: str, steps: int) -> str:
        whose, rest = _whose(name)
        parts = [item for item in rest.split(".") if item not in _SAYS_NOTHING]
        return whose + " ".join(parts[-steps:]).replace("_", " ")

    results = []
    for name in names:
        steps = 1 + name[-1].isdecimal()
        while sum(last(item, steps) == last(name, steps) for item in names) > 1 and steps < 9:
            steps += 1
        results.append(last(name, steps))
    return results


def _whose(name: str) -> tuple[str, str]:
    """Return which bearing, sensor or plane of a machine a key is of, and the rest of the key."""
    kind, which, rest = (*name.split(".", 2), "", "")[:3]
    counted = which.isdecimal() or which[:1].isupper()
    if kind in ("bearing", "sensor", "unbalance") and counted and rest:
        return f"{kind} {which} ", rest
    return "", name


_SAYS_NOTHING = ("scenario", "values", "value", "amplitude")


def _folded(text: str) -> str:
    """Return a name in lines that fit beside its neighbours."""
    return "\n".join(wrap(text, FOLDED)) or text


class Quantity(NamedTuple):
    """A column of machines, to be shown."""

    name: str  #: In words.
    unit: str  #: SI.
    values: Array  #: Of the machines (n,); of words their place in `words`.
    words: Sequence[str] = ()  #: Of a choice its values.

    @property
    def axis(self) -> Axis:
        """An axis with a prefix that fits."""
        finite = np.abs(self.values[np.isfinite(self.values)])
        typical = float(np.median(finite)) if finite.size else 1.0
        label = self.name
        if self.unit not in _SCALED or self.unit == "kg" or not typical > 0:
            return Axis(label, "" if self.unit == "1" else self.unit)
        fits = [(p, f) for p, f in _PREFIXES.items() if 1 <= typical * f < 1000]
        prefix, factor = fits[0] if fits else ("", 1.0)
        return Axis(label, prefix + self.unit, factor)


def cumulative_figure(
    title: str,
    figures: Sequence[Quantity],
    groups: Mapping[str, NDArray[np.bool_]],
    limits: Mapping[str, float],
) -> Figure:
    """Show which share of machines is at or below each value of figures."""
    panels = []
    visible_groups = dict(list(groups.items())[:SERIES])
    for of in figures:
        finite = of.values[np.isfinite(of.values)]
        items: list[Item] = []
        for place, (name, these) in enumerate(visible_groups.items()):
            values = np.sort(of.values[these & ~np.isnan(of.values)])
            if not values.size:
                continue
            at = np.unique(np.linspace(0, values.size - 1, POINTS).astype(int))
            keep = at[np.isfinite(values[at])]
            label = name if len(visible_groups) > 1 else ""
            y = (keep + 1) / values.size
            items.append(Line(values[keep], y, signal=f"series {place + 1}", label=label))
        if of.name in limits:
            items.append(Rule(limits[of.name], axis="x", signal="limit", label="limit"))
        axis = of.axis
        if finite.size:
            low, high = float(finite.min()), float(np.quantile(finite, FAR))
            high = max(high, limits.get(of.name, high))
            if high > low:
                room = 0.05 * (high - low)
                axis = Axis(axis.label, axis.unit, axis.factor, limits=(low - room, high + room))
        y_axis = Axis("share of machines", "%", 100.0, limits=(0.0, 1.02))
        panels.append(Panel(axis, y_axis, items))
    left_out = len(groups) - len(visible_groups)
    rest = f" {left_out} more of the choice are not shown." if left_out else ""
    return Figure(
        "cumulative",
        title,
        "Share of machines at or below each value. A curve that ends below 100 % belongs to "
        f"machines without a finite value: unstable, or never recovered.{rest}",
        panels,
        columns=2,
    )


class Swing(NamedTuple):
    """What a quantity does to a figure."""

    name: str  #: Of the quantity.
    low: float  #: Median of the figure where the quantity is low, or of the best choice.
    high: float  #: Where it is high, or of the worst choice.
    text: str  #: Between which values.


def tornado_figure(id: str, figure: Quantity, middle: float, swings: Sequence[Swing]) -> Figure:
    """Show what each quantity does to a figure, the strongest on top."""
    order = sorted(swings, key=lambda item: -abs(item.high - item.low))
    ends = [sorted((entry.low, entry.high)) for entry in order]
    rows = Intervals(
        [_folded(entry.name) for entry in order],
        np.full(len(order), middle),
        np.array([low for low, _ in ends]),
        np.array([high for _, high in ends]),
        [entry.text for entry in order],
        signal="estimate",
        label="",
    )
    return Figure(
        f"tornado-{id}",
        f"What drives the {figure.name}",
        "Median of the figure over the tenth of the machines in which a quantity is lowest, and "
        "over the tenth in which it is highest; of a choice over its best and its worst value.",
        [Panel(figure.axis, Axis(""), [rows])],
        panel_height=max(1.6, 0.45 + 0.32 * len(order)),
    )


def indices_figure(
    id: str,
    figure: str,
    method: str,
    names: Sequence[str],
    shares: Mapping[str, tuple[Array, Array]],
    caption: str,
) -> Figure:
    """Show which share of a figure's variance each quantity has."""
    panels = []
    for place, (order, (value, half)) in enumerate(shares.items()):
        texts = [f"{100 * v:.1f} ± {100 * h:.1f} %" for v, h in zip(value, half, strict=True)]
        rows = Intervals(
            [_folded(name) for name in names], value, value - half, value + half, texts,
            signal=f"series {place + 1}", label="",
        )  # fmt: skip
        axis = Axis(f"{order}, share of the variance", "%", 100.0)
        panels.append(Panel(axis, Axis(""), [rows]))
    return Figure(
        f"indices-{id}",
        f"{method} of the {figure}",
        caption,
        panels,
        panel_height=max(1.6, 0.45 + 0.32 * len(names)),
    )


def parallel_figure(
    title: str, quantities: Sequence[Quantity], passed: NDArray[np.bool_]
) -> Figure:
    """Show machines as lines through all that varies, those that fail in red."""
    # passed (n,)
    k = len(quantities)
    scaled, items = np.empty((passed.size, k)), list[Item]()
    for place, of in enumerate(quantities):
        values = of.values.astype(float)
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        scaled[:, place] = (np.clip(values, low, high) - low) / ((high - low) or 1.0)
        unit = of.unit if of.unit != "1" else ""
        ends = [engineering(e, unit, digits=3) if unit else f"{e:.3g}" for e in (low, high)]
        if of.words:
            ends = [of.words[0], of.words[-1]]
        items += [
            Rule(float(place), axis="x", signal="reference", label=""),
            Note(float(place), 0.0, str(ends[0]), side="below"),
            Note(float(place), 1.0, f"{_folded(of.name)}\n{ends[1]}"),
        ]
    x = np.append(np.arange(k, dtype=float), np.nan)
    for signal, these in (("passed", passed), ("failed", ~passed)):
        rows = scaled[these & ~np.isnan(scaled).any(axis=1)]
        rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(LINES, len(rows))).astype(int))]
        if len(rows):
            y = np.column_stack([rows, np.full(len(rows), np.nan)]).ravel()
            items.append(Line(np.tile(x, len(rows)), y, signal=signal))
    return Figure(
        "parallel",
        title,
        f"Each line is a machine; at most {LINES} of each kind. Where red lines meet, machines "
        "fail.",
        [
            Panel(
                Axis("", limits=(-0.5, k - 0.5)),
                Axis("from the least, 0, to the greatest, 1", limits=(-0.15, 1.45)),
                items,
            )
        ],
        panel_height=3.4,
    )


def front_figure(
    title: str, error: Sequence[float], peak: Sequence[float], best: NDArray[np.bool_],
    allowed: NDArray[np.bool_], peak_limit: float, chosen_index: int,
) -> Figure:  # fmt: skip
    """Show error of the force against the peak of the sensitivity, of all that was tried."""
    # best (n,); allowed (n,)
    x, y = np.asarray(peak, float), np.asarray(error, float)
    right, top = BEYOND * peak_limit, BEYOND * max(y[chosen_index], y[0])
    visible = (x <= right) & (y <= top)
    front = np.flatnonzero(best & visible)
    front = front[np.argsort(x[front])]
    rest = visible & ~best
    items: list[Item] = [
        Points(x[rest & ~allowed], y[rest & ~allowed], signal="measured", label="not allowed"),
        Points(x[rest & allowed], y[rest & allowed], signal="constant", label="tried"),
        Line(x[front], y[front], signal="series 3", label=""),
        Points(x[front], y[front], signal="series 3", label="Pareto front"),
        Points(x[[0]], y[[0]], signal="start", label="untuned"),
        Points(x[[chosen_index]], y[[chosen_index]], signal="estimate", label="taken"),
        Rule(peak_limit, axis="x", signal="limit", label="limit"),
    ]
    left_out = int((~visible).sum())
    left_out_said = f" {left_out} that lie farther out are not shown." if left_out else ""
    return Figure(
        "front",
        title,
        "Each point is a controller with its filter, flown with the same machines and the same "
        f"noise.{left_out_said}",
        [Panel(Axis("peak of |S|"), Axis("error of the disturbance force, rms", "N"), items)],
    )
