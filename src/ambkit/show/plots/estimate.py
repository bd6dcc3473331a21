"""What one estimator said, with how sure it is."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ambkit.base.escaping import label, markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Band, Item, Line
from ambkit.show.plots.filters import innovation_panel, settled_samples, with_limits
from ambkit.show.plots.signal_styles import CURRENT, DISTURBANCE, POSITION, TIME, VELOCITY

if TYPE_CHECKING:
    from ambkit.estimate.estimate import Estimate

AXES = {
    "position": POSITION,
    "velocity": VELOCITY,
    "disturbance force": DISTURBANCE,
    "current": CURRENT,
}
"""States that are shown, by role."""


def estimate_figure(estimate: Estimate) -> Figure:
    """Show the states over time, with 95 % of what the filter believes, and the innovations."""
    t = estimate.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    settled = settled_samples(t, [estimate])
    panels = []
    for role, axis in AXES.items():
        items: list[Item] = []
        names = estimate.of_role(role)
        for place, name in enumerate(names):
            style = f"series {1 + place % 4}" if len(names) > 1 else "estimate"
            if estimate.covariance is not None:
                half = 2 * estimate.std(name)
                mean = estimate[name]
                items.append(Band(t, mean - half, mean + half, signal=style, label="±2σ"))
            text = label(name) if len(names) > 1 else None
            items.append(Line(t, estimate[name], signal=style, label=text))
        if items:
            panels.append(Panel(time, with_limits(axis, items, settled), items))
    if estimate.scale is not None:
        scale: list[Item] = [Line(t, estimate.scale, signal="identified", label="")]
        panels.append(Panel(time, Axis("magnet constant over the known"), scale))
    return Figure(
        id="estimate",
        title=markdown(estimate.estimator),
        caption="First guesses, at the start, may reach beyond the axes.",
        panels=[*panels, innovation_panel("", estimate, time, [])],
    )
