"""A simulated run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Item, Line, Rule
from ambkit.show.plots.filters import whole_noise
from ambkit.show.plots.machine import machine_figure
from ambkit.show.plots.signal_styles import CURRENT, DISTURBANCE, NOISE, POSITION, TIME, VELOCITY

if TYPE_CHECKING:
    from ambkit.simulation.run import Run


def simulation_figure(run: Run) -> Figure:
    """Show what happened in a simulated run, and what the estimator said to it."""
    record, estimate = run.record, run.estimate
    if not run.plant.single:
        return machine_figure(run)
    bearing = run.plant.isolated_axis("")
    t, name = record.t, "estimate"

    def told(signal: str) -> list[Item]:
        return [] if estimate is None else [Line(t, estimate[signal], signal=name)]

    limits = [
        Rule(limit, signal="limit", label="limit")
        for limit in (bearing.current_min, bearing.current_max)
        if np.max(np.abs(record["iu"])) > 0.5 * abs(limit)
    ]
    position: list[Item] = [
        Line(t, record["y"], signal="measured"),
        Line(t, record["r"], signal="reference"),
        Line(t, record["x"], signal="truth"),
        *told("x"),
    ]
    control = Line(t, record["iu"], signal="control", label="control current")
    follows = (
        [] if estimate is None else [item for n in estimate.of_role("current") for item in told(n)]
    )
    coloured = None if estimate is None else estimate.sensor_noise
    noises = (
        [] if coloured is None
        else [Panel(TIME, NOISE, [*whole_noise(record), Line(t, coloured, signal=name)])]
    )  # fmt: skip
    return Figure(
        id="simulation",
        title=f"Simulated run of {markdown(bearing.name)}",
        caption="" if estimate is None else f"In the loop or beside it: {estimate.estimator}.",
        panels=[
            Panel(TIME, POSITION, position),
            Panel(TIME, VELOCITY, [Line(t, record["v"], signal="truth"), *told("v")]),
            Panel(TIME, CURRENT, [control, *follows, *limits]),
            Panel(TIME, DISTURBANCE, [Line(t, record["f_d"], signal="truth"), *told("f_d")]),
            *noises,
        ],
    )
