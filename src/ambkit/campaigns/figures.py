"""Figures of many machines: cumulative distributions, drivers, parallel coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.campaigns.distributions import ChoiceMarginal
from ambkit.campaigns.results import Machines
from ambkit.campaigns.sobol_indices import Indices
from ambkit.campaigns.study_tables import UNITS, limit_of
from ambkit.data.record_card import axis_of
from ambkit.judge.loop.loop_builder import ZONES
from ambkit.result.report import Axis, Figure, Intervals, Item, Line, Note, Panel, Points, Rule

TENTH = 0.1  #: Share of the machines with a quantity that counts as low, and as high.
SERIES = 4  #: Curves with a style of their own in one panel.
POINTS = 400  #: Points of a cumulative curve, for any number of machines.
FAR = 0.995  #: Share of the machines on the axis of a curve with distant outliers.
BEYOND = 2.0  #: Range of the axes of a front, over the limit and the selected point.
FOLDED = 14  #: Characters per line of a name.
LINES = 80  #: Machines of each class in parallel coordinates.

LABELS = {
    "peak_S": "peak of |S|",
    "x_rms": "error of the position, rms",
    "v_rms": "error of the velocity, rms",
    "f_d_rms": "error of the disturbance force, rms",
    "x_peak": "maximum error of the position",
    "v_peak": "maximum error of the velocity",
    "f_d_peak": "maximum error of the disturbance force",
    "nis": "normalised innovation squared",
    "tracking_rms": "control error, rms",
    "tracking_peak": "maximum control error",
    "effort": "change of the current, rms",
    "displacement_peak": "maximum displacement",
    "current_peak": "maximum control current",
    "orbit_peak": "maximum orbit",
    "orbit_share": "maximum orbit over clearance",
    "overshoot": "overshoot",
    "settling": "settling time",
    "recovery": "recovery time after the load",
    "load_kept": "largest load without contact",
    "touched": "samples in contact",
    "landed": "in contact at the end",
}
"""Names of figures in words."""


def in_words(names: Sequence[str]) -> list[str]:
    """Return keys in words: the last part of each, and more where two are equal."""

    def last(name: str, steps: int) -> str:
        whose, rest = _split_name(name)
        parts = [item for item in rest.split(".") if item not in _SAYS_NOTHING]
        return whose + " ".join(parts[-steps:]).replace("_", " ")

    results = []
    for name in names:
        steps = 1 + name[-1].isdecimal()
        while sum(last(item, steps) == last(name, steps) for item in names) > 1 and steps < 9:
            steps += 1
        results.append(last(name, steps))
    return results


def _split_name(name: str) -> tuple[str, str]:
    """Return the bearing, sensor or plane of a key, and the rest of the key."""
    kind, which, rest = (*name.split(".", 2), "", "")[:3]
    counted = which.isdecimal() or which[:1].isupper()
    if kind in ("bearing", "sensor", "unbalance") and counted and rest:
        return f"{kind} {which} ", rest
    return "", name


_SAYS_NOTHING = ("scenario", "values", "value", "amplitude")


def _folded(text: str) -> str:
    """Return a name broken into lines."""
    return "\n".join(wrap(text, FOLDED)) or text


class Quantity(NamedTuple):
    """A column over the machines, for a plot."""

    name: str  #: Name in words.
    unit: str  #: SI.
    values: Array  #: Values of the machines (n,); for words their index in `words`.
    words: Sequence[str] = ()  #: Values of a choice.

    @property
    def axis(self) -> Axis:
        """Axis with a suitable prefix."""
        finite = np.abs(self.values[np.isfinite(self.values)])
        return axis_of(self.name, self.unit, np.atleast_1d(np.median(finite) if finite.size else 0))


def quantity(campaign: Machines, name: str) -> Quantity:
    """Return a varied quantity or a figure for a plot."""
    plan = campaign.plan
    values = campaign.column(name)
    if name not in plan.names:
        return Quantity(LABELS[name], UNITS[name], values)
    place = plan.names.index(name)
    label = in_words(plan.names)[place]
    key, of = plan.keys[place], plan.marginals[place]
    if isinstance(of, ChoiceMarginal):
        words = [_text(value, key.unit) for value in of.values]
        at = {value: float(number) for number, value in enumerate(of.values)}
        return Quantity(label, "1", np.array([at[value] for value in values.tolist()]), words)
    return Quantity(label, key.unit, values)


def _text(value: object, unit: str, digits: int = 6) -> str:
    if not isinstance(value, float):
        return str(value)
    return engineering(value, unit, digits) if unit != "1" else f"{value:g}"


def cumulative(campaign: Machines) -> Figure:
    """Plot cumulative distributions of figures, by the first choice."""
    passes = campaign.plan.study.passes
    limits = {name: limit_of(name, limit) for name, limit in passes.at_most.items()}
    if passes.zone is not None:
        limits["peak_S"] = min(dict(ZONES)[passes.zone], limits.get("peak_S", np.inf))
    groups = _groups(campaign)
    visible_groups = dict(list(groups.items())[:SERIES])
    share = Axis("share of machines", "%", 100.0, limits=(0.0, 1.02))
    panels = []
    for figure in campaign.names_shown:
        of, items = quantity(campaign, figure), list[Item]()
        for place, (name, these) in enumerate(visible_groups.items(), 1):
            values = np.sort(of.values[these & ~np.isnan(of.values)])
            if not values.size:
                continue
            at = np.unique(np.linspace(0, values.size - 1, POINTS).astype(int))
            keep = at[np.isfinite(values[at])]
            label = name if len(visible_groups) > 1 else ""
            y = (keep + 1) / values.size
            items.append(Line(values[keep], y, signal=f"series {place}", label=label))
        if figure in limits:
            items.append(Rule(limits[figure], axis="x", signal="limit", label="limit"))
        panels.append(Panel(_without_outliers(of, limits.get(figure)), share, items))
    left_out = len(groups) - len(visible_groups)
    rest = f" {left_out} more of the choice are not shown." if left_out else ""
    return Figure(
        "cumulative",
        f"{markdown(campaign.plan.study.name)}: {len(campaign):,} machines",
        "Share of machines at or below each value. Where a curve ends below 100 %, the remaining "
        f"machines have no finite value: unstable, or not recovered.{rest}",
        panels,
        columns=2,
    )


def _groups(campaign: Machines) -> dict[str, NDArray[np.bool_]]:
    for name, of in zip(campaign.plan.names, campaign.plan.marginals, strict=True):
        if isinstance(of, ChoiceMarginal):
            choice = quantity(campaign, name)
            return {word: choice.values == at for at, word in enumerate(choice.words)}
    return {"all": np.ones(len(campaign), bool)}


def _without_outliers(of: Quantity, limit: float | None) -> Axis:
    """Return the axis of a quantity without outliers, but with its limit."""
    finite = of.values[np.isfinite(of.values)]
    if not finite.size:
        return of.axis
    low, high = float(finite.min()), float(np.quantile(finite, FAR))
    high = high if limit is None else max(high, limit)
    room = 0.05 * (high - low)
    return replace(of.axis, limits=(low - room, high + room)) if high > low else of.axis


def tornado(campaign: Machines, figure: str) -> Figure:
    """Plot the effect of each quantity on a figure, the strongest on top."""
    of, Y = quantity(campaign, figure), campaign.column(figure)
    known = ~np.isnan(Y)
    swings: list[tuple[str, float, float, str]] = []
    for name in campaign.plan.names:
        X = quantity(campaign, name)
        if X.words:
            medians = {
                word: _median(Y[known & (X.values == at)])
                for at, word in enumerate(X.words) if (known & (X.values == at)).any()
            }  # fmt: skip
            low, high = min(medians, key=medians.__getitem__), max(medians, key=medians.__getitem__)
            swings.append((X.name, medians[low], medians[high], f"{low} … {high}"))
            continue
        a, b = np.quantile(X.values, [TENTH, 1 - TENTH]).tolist()
        below, above = (_median(Y[known & these]) for these in (X.values <= a, X.values >= b))
        text = " … ".join(_text(end, X.unit, 3) for end in (a, b))
        swings.append((X.name, below, above, text))
    swings.sort(key=lambda item: -abs(item[2] - item[1]))
    ends = [sorted(item[1:3]) for item in swings]
    return _drivers(
        f"tornado-{figure}",
        f"Influences on the {of.name}",
        "Median over the machines in the lowest and in the highest tenth of each quantity; of a "
        "choice, over its best and its worst value.",
        [item[0] for item in swings],
        [(of.axis, np.full(len(ends), _median(Y[known])), np.array(ends).reshape(-1, 2).T,
          [item[3] for item in swings], "estimate")],
    )  # fmt: skip


def _median(values: NDArray[np.float64]) -> float:
    """Return the median, which may be infinite."""
    return float(np.sort(values)[values.size // 2]) if values.size else np.nan


def indices(result: Indices) -> Figure:
    """Plot the share of each quantity in a figure's variance."""
    order = result.order
    shares = [("first order", result.first, result.first_confidence)]
    if result.total is not None and result.total_confidence is not None:
        shares.append(("total", result.total, result.total_confidence))
    caption = f"By SALib, from {result.used:,} runs."
    if result.left_out:
        caption += f" {result.left_out:,} without a finite value are left out."
    panels = []
    for place, (name, value, half) in enumerate(shares, 1):
        v, h = value[order], half[order]
        texts = [f"{100 * a:.1f} ± {100 * b:.1f} %" for a, b in zip(v, h, strict=True)]
        axis = Axis(f"{name}, share of the variance", "%", 100.0)
        panels.append((axis, v, np.stack([v - h, v + h]), texts, f"series {place}"))
    return _drivers(
        f"indices-{result.figure}",
        f"{result.method} of the {LABELS[result.figure]}",
        caption,
        [in_words(result.names)[at] for at in order],
        panels,
    )


def _drivers(
    id: str, title: str, caption: str, names: Sequence[str],
    panels: Sequence[tuple[Axis, Array, Array, Sequence[str], str]],
) -> Figure:  # fmt: skip
    """Plot values of quantities, each with an interval and a text."""
    folded = [_folded(name) for name in names]
    return Figure(
        id, title, caption,
        [Panel(axis, Axis(""), [Intervals(folded, value, ends[0], ends[1], texts, signal=style,
                                          label="")])
         for axis, value, ends, texts, style in panels],
        panel_height=max(1.6, 0.45 + 0.32 * len(names)),
    )  # fmt: skip


def parallel(campaign: Machines) -> Figure:
    """Plot machines as lines through varied quantities and the first figures, failures in red."""
    names, passed = [*campaign.plan.names, *campaign.names_shown[:2]], campaign.column("passed")
    k = len(names)
    scaled, items = np.empty((passed.size, k)), list[Item]()
    for place, of in enumerate(quantity(campaign, name) for name in names):
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
    to = Axis("from the least, 0, to the greatest, 1", limits=(-0.15, 1.45))
    return Figure(
        "parallel",
        f"{markdown(campaign.plan.study.name)}: machines, and which of them fail",
        f"Each line is a machine; at most {LINES} of each kind. Machines fail where red lines "
        "meet.",
        [Panel(Axis("", limits=(-0.5, k - 0.5)), to, items)],
        panel_height=3.4,
    )


def front_figure(
    title: str, error: Sequence[float], peak: Sequence[float], best: NDArray[np.bool_],
    allowed: NDArray[np.bool_], peak_limit: float, chosen_index: int,
) -> Figure:  # fmt: skip
    """Plot the force error over the sensitivity peak for all evaluations."""
    # best (n,); allowed (n,)
    x, y = np.asarray(peak, float), np.asarray(error, float)
    right, top = BEYOND * peak_limit, BEYOND * max(y[chosen_index], y[0])
    visible = (x <= right) & (y <= top)
    front = np.flatnonzero(best & visible)
    front = front[np.argsort(x[front])]
    rest = visible & ~best
    items: list[Item] = [
        Points(x[rest & ~allowed], y[rest & ~allowed], signal="measured", label="not allowed"),
        Points(x[rest & allowed], y[rest & allowed], signal="constant", label="evaluated"),
        Line(x[front], y[front], signal="series 3", label=""),
        Points(x[front], y[front], signal="series 3", label="Pareto front"),
        Points(x[[0]], y[[0]], signal="start", label="untuned"),
        Points(x[[chosen_index]], y[[chosen_index]], signal="estimate", label="taken"),
        Rule(peak_limit, axis="x", signal="limit", label="limit"),
    ]
    left_out = int((~visible).sum())
    left_out_note = f" {left_out} beyond the axes are not shown." if left_out else ""
    return Figure(
        "front",
        title,
        "Each point is a controller with its filter, simulated with the same machines and the same "
        f"noise.{left_out_note}",
        [Panel(Axis("peak of |S|"), Axis("error of the disturbance force, rms", "N"), items)],
    )
