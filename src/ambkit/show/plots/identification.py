"""A magnet constant as it was learned, and lift-off points with their law."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Line, Points, Rule
from ambkit.show.plots.signal_styles import TIME

if TYPE_CHECKING:
    from ambkit.identification.forces.lift_off_fit import LiftOffFit
    from ambkit.identification.online.magnet_constant import Identification


def identification_figure(result: Identification, start: float) -> Figure:
    """Show how the magnet constant was learned along a record, from `start` [N m^2/A^2]."""
    # :func:`~ambkit.show.plots.online.online_figure` shows several learners.
    from ambkit.identification.online.adaline import AdalineResult

    history = result.history
    panels = [
        Panel(TIME, Axis("magnet constant $k$", "N mm²/A²", 1e6), [
            Rule(start, signal="reference", label="start"),
            Rule(result.magnet_constant, signal="bound", label="result"),
            Line(history.t, history.k, signal="identified"),
        ]),
    ]  # fmt: skip
    if isinstance(history, AdalineResult):
        force = Line(history.t, history.force, signal="force", label="identified force")
        excitation = Line(history.t, history.excitation, signal="control", label="")
        panels.append(Panel(TIME, Axis("magnet force", "N"), [force]))
        panels.append(Panel(TIME, Axis("excitation"), [excitation]))
    return Figure(
        id="identification",
        title=f"Identification of {markdown(result.bearing.name)}",
        caption="Where the excitation is too small, the magnet constant is held.",
        panels=panels,
    )


def lift_off_figure(fit: LiftOffFit) -> Figure:
    """Show lift-off points, the law through them, and what it leaves."""
    gap = Axis("distance $z$ at lift-off", "mm", 1e3)
    points = np.array([(p.gap, p.current, p.acceleration) for p in fit.points])
    at = np.linspace(0.0, 1.05 * points[:, 0].max(), 200)
    law = fit.current(at)
    # A point lies off the law for its own acceleration; that is how the residuals count.
    measured = fit.current(points[:, 0]) + fit.residuals
    return Figure(
        id="lift_off",
        title="Lift-off points and the law fitted to them",
        caption="Points as they would be without the acceleration that they were measured at.",
        panels=[
            Panel(gap, Axis("coil current $i$", "A"), [
                Line(at, law, signal="fit", label="F = k (i / (z + z_off))²"),
                Points(points[:, 0], measured, signal="measurement"),
            ]),
            Panel(gap, Axis("residual", "mA", 1e3), [
                Rule(0.0, signal="bound", label=""),
                Points(points[:, 0], fit.residuals, signal="measurement"),
            ]),
        ],
    )  # fmt: skip
