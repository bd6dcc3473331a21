"""A picture of what ADALINE, least squares and the Kalman filter learn along one record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import markdown
from ambkit.identification.online.adaline import AdalineResult
from ambkit.identification.online.augmented import AugmentedResult
from ambkit.identification.online.comparison import NAMES, SideBySide
from ambkit.identification.online.result import CONFIDENCE, OnlineResult
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Band, Item, Line, Points, Rule, Span

Array = NDArray[np.float64]

STYLES = {"adaline": "series 2", "rls": "series 3", "augmented": "series 1"}
TIME = Axis("time", "s")
LEAST = 0.02
"""Default of the excitation below which ADALINE and least squares hold k [1]."""

JOINED = 0.004
"""Stretches nearer to each other than this part of the record are drawn as one."""

ENDS = (1.03, 1.05, 1.07)
"""Where the results stand, right of the curves, in parts of the record."""


def online_figure(learned: SideBySide) -> Figure:
    """Show k over time with its errors, and below what each had to learn from."""
    t = next(iter(learned.results.values())).t
    right = t[0] + 1.09 * np.ptp(t)
    time = Axis(TIME.label, TIME.unit, limits=(float(t[0]), float(right)))
    return Figure(
        id="online",
        title=f"Magnet constant of {markdown(learned.bearing.name)}, learned online",
        caption=f"{learned.agreement} On the right the results with 95 % intervals; ADALINE's and "
        "that of least squares are the means over the last quarter, their intervals from the "
        "scatter there. Band: 95 % as the Kalman filter believes it. Shaded: k is held, for there "
        "is too little to learn it from.",
        panels=[
            Panel(time, _limits(learned), _constants(learned)),
            *(_monitor(name, one, time) for name, one in learned.results.items()),
        ],
    )


def _constants(learned: SideBySide) -> list[Item]:
    items: list[Item] = [Rule(learned.start, signal="reference", label="start")]
    if learned.truth is not None:
        items.append(Rule(learned.truth, signal="truth"))
    for (name, one), place in zip(learned.results.items(), ENDS, strict=True):
        style = STYLES[name]
        learned_some = not one.held.all()
        if isinstance(one, AugmentedResult) and learned_some:
            half = CONFIDENCE * one.error
            half[: int(np.argmin(one.held))] = np.nan  # what it began with is no finding
            items.append(Band(one.t, one.k - half, one.k + half, signal=style, label=""))
        items.append(Line(one.t, one.k, signal=style, label=NAMES[name]))
        if not learned_some:
            continue
        end = np.array([one.t[0] + place * np.ptp(one.t)])
        error = np.nan_to_num([CONFIDENCE * one.standard_error])
        items.append(Points(end, np.array([one.magnet_constant]), error, signal=style, label=""))
    return items


def _limits(learned: SideBySide) -> Axis:
    """Return the axis of k that shows all but the wildest first guesses."""
    values = [learned.start] if learned.truth is None else [learned.start, learned.truth]
    for one in learned.results.values():
        half = np.nan_to_num(CONFIDENCE * one.standard_error)
        values += [one.magnet_constant - half, one.magnet_constant + half]
        values += np.quantile(one.k, (0.02, 0.98)).tolist()
    margin = 0.06 * (max(values) - min(values))
    return Axis("magnet constant $k$", "N mm²/A²", 1e6,
                limits=(min(values) - margin, max(values) + margin))  # fmt: skip


def _monitor(name: str, one: OnlineResult, time: Axis) -> Panel:
    held: list[Item] = [
        Span(a, b, signal="limit", label="UNEXCITED: k is held")
        for a, b in _stretches(one.t, one.held)
    ]
    style = STYLES[name]
    if isinstance(one, AugmentedResult):
        # Where it learns its error falls, where it does not it grows with the wander of k.
        error = Line(one.t, one.error / one.k, signal=style, label="")
        return Panel(time, Axis("error of $k$, filter", "%", 100.0), [*held, error])
    assert isinstance(one, AdalineResult)
    line = Line(one.t, one.excitation, signal=style, label="")
    least = Rule(LEAST, signal="bound", text="least", label="")
    return Panel(time, Axis(f"excitation, {NAMES[name]}"), [*held, line, least])


def _stretches(t: Array, where: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return from when to when [s] something holds; what is near to each other is one."""
    edges = np.flatnonzero(np.diff(np.r_[False, where, False].astype(np.int8))).reshape(-1, 2)
    least = JOINED * float(t[-1] - t[0])
    joined: list[tuple[float, float]] = []
    for a, b in edges:
        start, stop = float(t[a]), float(t[b - 1])
        if joined and start - joined[-1][1] < least:
            joined[-1] = joined[-1][0], stop
        else:
            joined.append((start, stop))
    return joined
