"""Figure of a tuning: all evaluations and their cost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ambkit.judge.comparison.tuning import Costed, Range
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule

HIGHEST_PEAK = 10.0  #: Upper end of the axis of the sensitivity peak.
WORST_SHOWN = 5.0  #: Range of the cost axis, in units of the difference between best and untuned.


def tuning_figure(
    title: str,
    free: Sequence[Range],
    trace: Sequence[Costed],
    chosen_values: Mapping[str, float],
    cost: str,
    outcome: str,
    peaks: Sequence[float] = (),
    peak_limit: float | None = None,
) -> Figure:
    """Plot the cost of all evaluations over each tunable and the peak of S."""
    costs = np.array([item.cost for item in trace])
    best = costs.min()
    span = max(float(costs[0] - best), 1e-3 * abs(best))
    limits = (best - 0.1 * span, best + WORST_SHOWN * span)
    visible = costs <= limits[1]

    def panel(of: Range) -> Panel:
        values = np.array([item.values[of.name] for item in trace])
        others = visible & (np.arange(len(trace)) > 0)
        return Panel(
            Axis(of.name, of.unit, scale="log", limits=(of.low, of.high)),
            Axis(cost, limits=limits),
            [
                Points(values[others], costs[others], signal="constant", label="evaluated"),
                Points(values[:1], costs[:1], signal="measurement", label="untuned"),
                Rule(chosen_values[of.name], axis="x", signal="estimate", label="taken"),
            ],
        )

    def of_the_loop() -> Panel:
        """Plot the cost over the peak; the line joins the Pareto-optimal evaluations."""
        size = np.asarray(peaks, float)
        indices = np.flatnonzero(visible & (size < HIGHEST_PEAK))
        order = indices[np.lexsort((costs[indices], size[indices]))]
        front = order[costs[order] <= np.minimum.accumulate(costs[order])]
        items: list[Item] = [
            Points(size[indices], costs[indices], signal="constant", label="evaluated"),
            Line(size[front], costs[front], signal="series 3", label="Pareto front"),
        ]
        if visible[0] and size[0] < HIGHEST_PEAK:
            items.append(Points(size[:1], costs[:1], signal="measurement", label="untuned"))
        if peak_limit is not None:
            items.append(Rule(peak_limit, axis="x", signal="limit", label="limit"))
        return Panel(Axis("peak of |S|"), Axis(cost, limits=limits), items)

    panels = [panel(of) for of in free]
    if np.isfinite(np.asarray(peaks, float)).any():
        panels.append(of_the_loop())
    left_out = int((~visible).sum())
    rest = f" {left_out} that cost more are not shown." if left_out else ""
    return Figure(
        "tuning",
        title,
        f"Each point is one evaluation; the other values change with it. {outcome}{rest}",
        panels,
        columns=min(2, len(panels)),
    )
