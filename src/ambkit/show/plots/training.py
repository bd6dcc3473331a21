"""An expert as it was trained."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Heatmap, Item, Line

if TYPE_CHECKING:
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.stiffness import StiffnessMap


def training_figure(expert: Expert, stiff: StiffnessMap) -> Figure:
    """Show how an expert learned, and by how much its force is off over the box."""
    iu = np.linspace(stiff.current[0], stiff.current[-1], 81)
    x = np.linspace(stiff.displacement[0], stiff.displacement[-1], 81)
    grid = np.meshgrid(iu, x)
    off = expert.force(*grid) - np.asarray(stiff.force(*grid))
    axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    curve = expert.learning_curve
    epochs = np.arange(curve.size, dtype=float)
    k_i, k_s = expert.stiffness(*grid)
    learning: list[Item] = [Line(epochs, curve, signal="estimate", label="")]
    return Figure(
        id="training",
        title=f"Expert of {len(expert.rules)} rules for {markdown(expert.source)}",
        caption="The learning curve counts from the untrained network on.",
        panels=[
            Panel(
                Axis("step of the training"),
                Axis("force error", "N rms"),
                learning,
                title="learning curve",
            ),
            Panel(
                *axes,
                [Heatmap(iu, x, off, Axis("force error", "N"), diverging=True)],
                title="force of the expert, less the force it learned",
            ),
            Panel(*axes, [Heatmap(iu, x, k_i, Axis("$k_i$", "N/A"))], title="$k_i$"),
            Panel(*axes, [Heatmap(iu, x, k_s, Axis("$k_s$", "N/mm", 1e-3))], title="$k_s$"),
        ],
        columns=2,
    )
