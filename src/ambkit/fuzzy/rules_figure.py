"""Pictures of a measured force, and of the choice of the number of rules."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ambkit.result.report import Axis, Figure, Heatmap, Item, Note, Panel, Points, Rule

if TYPE_CHECKING:
    from ambkit.fuzzy.rule_selection import RuleChoice
    from ambkit.machine.forces.force_surface import ForceSurface
    from ambkit.machine.stiffness import StiffnessMap

MOST_SHOWN = 400  #: More points would hide what lies below them.
FEW = 60  #: So many points are shown large.
NEARBY = 7  #: Of the 61 places along the box each way, within which the largest error is shown.


def with_surface(figure: Figure, surface: ForceSurface, stiff: StiffnessMap) -> Figure:
    """Put a measured force before the picture of a training."""
    from scipy.ndimage import maximum_filter

    iu = np.linspace(stiff.current[0], stiff.current[-1], 61)
    x = np.linspace(stiff.displacement[0], stiff.displacement[-1], 61)
    grid = np.meshgrid(iu, x)
    axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    points = surface.points.where(
        surface.points.within((iu[0], iu[-1]), (x[0], x[-1]))  # the picture shows the box
    )
    step = -(-len(points) // MOST_SHOWN)
    look = "measurement" if len(points) <= FEW else "place"
    marks = Points(points.current[::step], points.displacement[::step], signal=look)
    moved = Heatmap(iu, x, surface.correction(*grid), Axis("force", "N"), diverging=True)
    # Between the rows of a grid the error goes up and down; the eye wants its height.
    worst = maximum_filter(surface.standard_error(*grid), NEARBY, mode="nearest")
    known = Heatmap(iu, x, worst, Axis("standard error", "N"), lines=4)
    panels = [
        Panel(*axes, [moved, marks], title="measured force, less the bearing's law"),
        Panel(*axes, [known, marks], title="how well the force is known, at worst nearby"),
    ]
    return replace(figure, panels=[*panels, *figure.panels])


def with_choice(figure: Figure, choice: RuleChoice) -> Figure:
    """Put the choice of the number of rules before the picture of a training."""
    caption = (
        "Error at points that the network was not trained on, with its standard error; 1 is as "
        f"good as can be. The smallest network below the line is taken, {choice.chosen.name}. "
        f"{figure.caption}"
    )
    chosen = choice.chosen
    groups = {"constant": [c for c in choice.candidates if c is not chosen], "estimate": [chosen]}
    items: list[Item | Note] = [
        Points(*np.array([(c.rules, c.error, c.standard_error) for c in some]).T, signal=signal,
               label="")
        for signal, some in groups.items() if some
    ]  # fmt: skip
    items.append(Rule(choice.limit, signal="limit", label=""))
    items.append(Note(chosen.rules, chosen.error + chosen.standard_error, chosen.name))
    panel = Panel(
        Axis("number of rules"), Axis("error", "standard deviations"), items,
        title="points left out of the training",
    )  # fmt: skip
    return replace(figure, panels=[panel, *figure.panels], caption=caption)
