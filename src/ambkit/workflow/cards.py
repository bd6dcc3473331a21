"""What a notebook shows of what the commands came to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambkit.base.units import engineering
from ambkit.judge.comparison.criteria import EVALUATED
from ambkit.result.card import Card, value
from ambkit.show.plots.design import design_figure
from ambkit.show.plots.filters import filter_figure

if TYPE_CHECKING:
    from ambkit.workflow.designing import Design
    from ambkit.workflow.filtering import Filtering


def filtering(of: Filtering) -> Card:
    """Describe estimators along a record by their innovations, predictions and errors."""
    evaluated = of.evaluations.values()
    rows = [
        ["measurements used", *(f"{e.used} of {e.samples}" for e in evaluated)],
        ["innovation, std", *(value(e.innovation_std, "m") for e in evaluated)],
        ["mean NIS (1: consistent)", *("–" if math.isnan(e.nis) else f"{e.nis:.3f}"
                                       for e in evaluated)],
        ["load, mean", *(value(e.disturbance_mean, "N") for e in evaluated)],
    ]  # fmt: skip
    first = next(iter(evaluated))
    units = first.estimate.units
    rows += [
        [f"{ahead} step{'s' * (ahead > 1)} ahead, rms",
         *(value(e.prediction[ahead], "m") for e in evaluated)]
        for ahead in first.prediction
    ]  # fmt: skip
    rows += [
        [f"error of {name}, rms", *(value(e.rmse[name], units[name]) for e in evaluated)]
        for name in first.rmse
    ]
    title = f"{of.machine.name}: {len(of.record)} samples"
    figure = filter_figure(of.record, of.evaluations, of.smoothed)
    return Card(title, rows, figure, ["", *of.evaluations])


def design(of: Design) -> Card:
    """Describe a design by those that were tried, and why one is to fly."""
    rows = [
        [c.kind, *(value(c.errors[s], unit, 3) for s, unit in EVALUATED.items()),
         "–" if math.isnan(c.efficiency) else f"{100 * c.efficiency:.0f} %",
         "tuned" if c.kept else "untuned"]
        for c in of.candidates
    ]  # fmt: skip
    heads = ["", *(f"error of {s}" for s in EVALUATED), "of what is possible", ""]
    notes = [of.why, *of.objections, *of.notes, f"All of it lies in {of.folder}."]
    figure = design_figure(
        [c.kind for c in of.candidates],
        [c.errors for c in of.candidates],
        of.chosen.raw,
        f"The {of.chosen.kind} filter is chosen; the sensors alone err by "
                 f"{engineering(of.chosen.raw, 'm', 3)}",
    )  # fmt: skip
    return Card(f"Design: the {of.chosen.kind} filter", rows, figure, heads, notes)
