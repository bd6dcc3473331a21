"""Picture of a tuning: all that was tried, and what it cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Points, Rule

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ambkit.judge.comparison.contenders import Range
    from ambkit.judge.comparison.tuning import Tried

WORST_SHOWN = 5.0
"""Costs are shown up to so many spans between the best and the untuned one."""


def tuning_figure(
    title: str,
    free: Sequence[Range],
    trace: Sequence[Tried],
    taken: Mapping[str, float],
    cost: str,
    outcome: str,
) -> Figure:
    """Show the cost of all that was tried, over each value that was free.

    Parameters
    ----------
    title : str
        Which filter was tuned.
    free : sequence of Range
        What was free.
    trace : sequence of Tried
        All that was tried, the untuned first.
    taken : mapping of str to float
        What tuning found.
    cost : str
        What the cost is.
    outcome : str
        What became of it, a sentence.
    """
    costs = np.array([each.cost for each in trace])
    best = costs.min()
    span = max(float(costs[0] - best), 1e-3 * abs(best))
    limits = (best - 0.1 * span, best + WORST_SHOWN * span)
    shown = costs <= limits[1]

    def panel(of: Range) -> Panel:
        tried = np.array([each.values[of.name] for each in trace])
        others = shown & (np.arange(len(trace)) > 0)
        return Panel(
            Axis(of.name, of.unit, scale="log", limits=(of.low, of.high)),
            Axis(cost, limits=limits),
            [
                Points(tried[others], costs[others], signal="constant", label="tried"),
                Points(tried[:1], costs[:1], signal="measurement", label="untuned"),
                Rule(taken[of.name], axis="x", signal="estimate", label="taken"),
            ],
        )

    left_out = int((~shown).sum())
    rest = f" {left_out} that cost more are not shown." if left_out else ""
    return Figure(
        "tuning",
        title,
        f"Each point is one evaluation; the other values change with it. {outcome}{rest}",
        [panel(of) for of in free],
        columns=min(2, len(free)),
    )
