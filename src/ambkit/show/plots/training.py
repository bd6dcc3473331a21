"""An expert as it was trained."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Heatmap, Item, Line

if TYPE_CHECKING:
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.stiffness import StiffnessMap


Array = NDArray[np.float64]

CURRENT = Axis("control current $i_u$", "A")
PLACE = Axis("displacement $x$", "mm", 1e3)


def training_figure(expert: Expert, stiff: StiffnessMap) -> Figure:
    """Show how an expert learned, and by how much its force is off over the box."""
    iu, x = (_fine(nodes[0], nodes[-1]) for nodes in (stiff.current, stiff.displacement))
    grid = np.meshgrid(iu, x)
    off = expert.force(*grid) - np.asarray(stiff.force(*grid))
    surface = Heatmap(iu, x, off, Axis("force error", "N"), diverging=True)
    return Figure(
        id="training",
        title=_title(expert),
        caption="The learning curve counts from the untrained network on.",
        panels=[
            _learning(expert),
            Panel(
                CURRENT, PLACE, [surface], title="force of the expert, less the force it learned"
            ),
            *_stiffnesses(expert, iu, x),
        ],
        columns=2,
    )


def expert_figure(expert: Expert) -> Figure:
    """Show what an expert says over its box, and how it learned if it was trained."""
    iu, x = _fine(*expert.current_range), _fine(*expert.displacement_range)
    force = Heatmap(iu, x, expert.force(*np.meshgrid(iu, x)), Axis("force", "N"), diverging=True)
    return Figure(
        id="expert",
        title=_title(expert),
        caption="",
        panels=[
            *_stiffnesses(expert, iu, x),
            Panel(CURRENT, PLACE, [force], title="force"),
            *([_learning(expert)] if expert.training else []),
        ],
        columns=2,
    )


def _title(expert: Expert) -> str:
    return f"Expert of {len(expert.rules)} rules for {markdown(expert.source)}"


def _fine(low: float, high: float) -> Array:
    return np.linspace(low, high, 81)


def _learning(expert: Expert) -> Panel:
    curve = expert.learning_curve
    learning: list[Item] = [
        Line(np.arange(curve.size, dtype=float), curve, signal="estimate", label="")
    ]
    return Panel(
        Axis("step of the training"), Axis("force error", "N rms"), learning, title="learning curve"
    )


def _stiffnesses(expert: Expert, iu: Array, x: Array) -> list[Panel]:
    k_i, k_s = expert.stiffness(*np.meshgrid(iu, x))
    return [
        Panel(CURRENT, PLACE, [Heatmap(iu, x, k_i, Axis("$k_i$", "N/A"))], title="$k_i$"),
        Panel(CURRENT, PLACE, [Heatmap(iu, x, k_s, Axis("$k_s$", "N/mm", 1e-3))], title="$k_s$"),
    ]
