"""What a notebook shows of what the commands came to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambkit.result.card import Card, value
from ambkit.show.plots.filters import filter_figure

if TYPE_CHECKING:
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
