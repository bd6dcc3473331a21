"""Pictures of a campaign: its columns, as `ambkit.campaigns.figures` wants them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.campaigns import figures as plots
from ambkit.campaigns.distributions import OneOf
from ambkit.campaigns.figures import LABELS, Quantity, Swing, in_words
from ambkit.campaigns.study_tables import UNITS, limit_of
from ambkit.judge.loop.loop_of import ZONES

if TYPE_CHECKING:
    from ambkit.campaigns.results import Machines
    from ambkit.campaigns.sobol_indices import Indices
    from ambkit.result.report import Figure

TENTH = 0.1  #: Of the machines, those in which a quantity counts as low, and as high.


def quantity(campaign: Machines, name: str) -> Quantity:
    """Return what varies, or a figure, to be shown."""
    plan = campaign.plan
    values = campaign.column(name)
    if name not in plan.names:
        return Quantity(LABELS[name], UNITS[name], values)
    place = plan.names.index(name)
    label = in_words(plan.names)[place]
    key, of = plan.keys[place], plan.marginals[place]
    if isinstance(of, OneOf):
        words = [_said(value, key.unit) for value in of.values]
        at = {value: float(number) for number, value in enumerate(of.values)}
        return Quantity(label, "1", np.array([at[value] for value in values.tolist()]), words)
    return Quantity(label, key.unit, values)


def _said(value: object, unit: str) -> str:
    if not isinstance(value, float):
        return str(value)
    return engineering(value, unit) if unit != "1" else f"{value:g}"


def cumulative(campaign: Machines) -> Figure:
    """Show the figures' cumulative curves, apart by the first choice."""
    figures = [quantity(campaign, name) for name in campaign.names_shown]
    limits = {
        LABELS[name]: limit_of(name, limit, campaign.plan.nominal)
        for name, limit in campaign.plan.study.passes.at_most.items()
    }
    zone = campaign.plan.study.passes.zone
    if zone is not None:
        peak = LABELS["peak_S"]
        limits[peak] = min(dict(ZONES)[zone], limits.get(peak, np.inf))
    return plots.cumulative_figure(
        f"{markdown(campaign.plan.study.name)}: {len(campaign):,} machines",
        figures,
        _groups(campaign),
        limits,
    )


def _groups(campaign: Machines) -> dict[str, NDArray[np.bool_]]:
    for name, of in zip(campaign.plan.names, campaign.plan.marginals, strict=True):
        if isinstance(of, OneOf):
            choice = quantity(campaign, name)
            return {word: choice.values == at for at, word in enumerate(choice.words)}
    return {"all": np.ones(len(campaign), bool)}


def tornado(campaign: Machines, figure: str) -> Figure:
    """Show what each quantity does to a figure."""
    Y = campaign.column(figure)
    known = ~np.isnan(Y)
    swings = []
    for name in campaign.plan.names:
        X = quantity(campaign, name)
        if X.words:
            medians = {
                word: _median(Y[known & (X.values == at)])
                for at, word in enumerate(X.words) if (known & (X.values == at)).any()
            }  # fmt: skip
            low, high = min(medians, key=medians.__getitem__), max(medians, key=medians.__getitem__)
            swings.append(Swing(X.name, medians[low], medians[high], f"{low} … {high}"))
            continue
        a, b = np.quantile(X.values, [TENTH, 1 - TENTH])
        low_median, high_median = (
            _median(Y[known & these]) for these in (X.values <= a, X.values >= b)
        )
        text = f"{_said(float(a), X.unit)} … {_said(float(b), X.unit)}"
        if X.unit != "1":
            text = " … ".join(engineering(float(end), X.unit, digits=3) for end in (a, b))
        swings.append(Swing(X.name, low_median, high_median, text))
    of = quantity(campaign, figure)
    return plots.tornado_figure(figure, of, _median(Y[known]), swings)


def _median(values: NDArray[np.float64]) -> float:
    """Return the middle value, which may be infinite."""
    return float(np.sort(values)[values.size // 2]) if values.size else np.nan


def indices(result: Indices) -> Figure:
    """Show which share of a figure's variance each quantity has."""
    order = result.order
    shares = {"first order": (result.first[order], result.first_confidence[order])}
    if result.total is not None and result.total_confidence is not None:
        shares["total"] = (result.total[order], result.total_confidence[order])
    caption = f"By SALib, from {result.used:,} runs."
    if result.left_out:
        caption += f" {result.left_out:,} without a finite value are left out."
    return plots.indices_figure(
        result.figure,
        LABELS[result.figure],
        result.method,
        [in_words(result.names)[at] for at in order],
        shares,
        caption,
    )


def parallel(campaign: Machines) -> Figure:
    """Show machines as lines through what varies, and through the first figures."""
    names = [*campaign.plan.names, *campaign.names_shown[:2]]
    return plots.parallel_figure(
        f"{markdown(campaign.plan.study.name)}: machines, and which of them fail",
        [quantity(campaign, name) for name in names], campaign.column("passed"),
    )  # fmt: skip
