"""What a notebook shows of comparisons and of what was identified."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.units import engineering, typeset
from ambkit.identification.online.side_by_side import NAMES
from ambkit.judge.comparison.criteria import CRITERIA
from ambkit.judge.comparison.seeds import EVALUATED
from ambkit.result.card import Card, value
from ambkit.show.plots.comparison import comparison_figure
from ambkit.show.plots.identification import identification_figure
from ambkit.show.plots.online import online_figure
from ambkit.show.plots.study import cases_figure, matrix_figure

if TYPE_CHECKING:
    from ambkit.identification.online.magnet_constant import Identification
    from ambkit.identification.online.side_by_side import SideBySide
    from ambkit.judge.comparison.bench import Bench, Benches
    from ambkit.judge.comparison.seeds import Score, Scores
    from ambkit.judge.comparison.study import Study

K = "N m^2/A^2"
"""Unit of a magnet constant."""


def bench(of: Bench) -> Card:
    """Describe a comparison in one case by the criteria that apply."""
    best = of.best
    shown = [c for c in CRITERIA if any(np.isfinite(s.mean(c)) for s in best.values())]
    heads = [f"{CRITERIA[c].label} [{CRITERIA[c].unit or 1}]" for c in shown]
    rows = [
        [name, *(f"{CRITERIA[c].factor * one.mean(c):.3g}" for c in shown)]
        for name, one in best.items()
    ]
    how = "tuned alike" if of.tuned else "with their defaults"
    title = f"{of.bearing.name}, case {of.case.name}: {of.case.title}; {of.runs} runs, {how}"
    limit = ", ".join(f"{name} {value(of.limit[name], u)}" for name, u in EVALUATED.items()
                      if name in of.limit)  # fmt: skip
    notes = [f"No estimator can have less than {limit} rms."] if limit else []
    return Card(title, rows, matrix_figure(of), ["", *heads], notes)


def study(of: Study) -> Card:
    """Describe a comparison by the case that was asked for."""
    return bench(of.bench)


def benches(of: Benches) -> Card:
    """Describe a comparison in several cases by the error of the disturbance force."""
    first = next(iter(of.values()))
    rows = [
        [name, *(value(each.best[name].mean("f_d"), "N", 3) for each in of.values())]
        for name in first.best
    ]
    title = f"{first.bearing.name}: error of the disturbance force, {first.runs} runs in each case"
    return Card(title, rows, cases_figure(of), ["", *of])


def scores(of: Scores) -> Card:
    """Describe estimators, each in its own loop."""
    runs = len(next(iter(of.values())).nis)
    title = f"Errors in the loop, mean and standard deviation over {runs} runs"
    return loops({"": of}, title)


def loops(of: Mapping[str, Mapping[str, Score]], title: str) -> Card:
    """Describe estimators, each in its own loop, for each thing that happens."""
    rows = [
        [f"{case} {name}".strip(), *(_pair(one, s) for s in EVALUATED), f"{one.nis.mean():.3f}",
         str(one.touched)]
        for case, of_case in of.items() for name, one in of_case.items()
    ]  # fmt: skip
    heads = ["", *(f"error of {signal}" for signal in EVALUATED), "mean NIS", "runs at the stop"]
    return Card(title, rows, comparison_figure(of, ""), heads)


def _pair(score: Score, signal: str) -> str:
    mean, spread, unit = score.mean(signal), score.spread(signal), EVALUATED[signal]
    return with_spread(mean, spread, unit)


def with_spread(mean: float, spread: float, unit: str) -> str:
    """Print a value with its error, both in the same unit."""
    if not np.isfinite(spread):
        return value(mean, unit)
    number, _, shown = engineering(mean, unit, 4).partition(" ")
    error = engineering(spread, unit, 2, like=mean).partition(" ")[0]
    return typeset(f"{number} ± {error} {shown}")


def identification(of: Identification) -> Card:
    """Describe what one learned of a magnet constant along a record."""
    rows = [
        ("magnet constant", with_spread(of.magnet_constant, of.spread, K)),
        ("standard error", value(of.history.standard_error, K)),
        ("drift in the last quarter", value(of.history.drift, K)),
        ("samples in which it was held", f"{100 * float(of.history.held.mean()):.3g} %"),
    ]
    notes = [] if of.history.settled else ["It still drifts; a longer record may settle it."]
    figure = identification_figure(of, float(of.history.k[0]))
    return Card(f"Identification of {of.bearing.name}", rows, figure, notes=notes)


def side_by_side(of: SideBySide) -> Card:
    """Describe what each learned of a magnet constant along a record."""
    rows = [
        [NAMES[name], value(one.magnet_constant, K), value(one.standard_error, K)]
        for name, one in of.results.items()
    ]
    title = f"Magnet constant of {of.bearing.name}, learned online"
    heads = ["", "magnet constant", "standard error"]
    return Card(title, rows, online_figure(of), heads, [of.agreement, *of.notes])
