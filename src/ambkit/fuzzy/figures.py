"""Pictures of the choice of the number of rules."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ambkit.report.figure import Figure, Panel
from ambkit.report.items import Axis, Heatmap, Item, Note, Points, Rule

if TYPE_CHECKING:
    from ambkit.fuzzy.choice import RuleChoice
    from ambkit.identification.force_table import ForceTable


def with_choice(figure: Figure, choice: RuleChoice, table: ForceTable) -> Figure:
    """Put the choice of the number of rules before the picture of a training.

    Parameters
    ----------
    figure : Figure
        Of :func:`ambkit.plots.training_figure`.
    choice : RuleChoice
        What cross-validation said.
    table : ForceTable
        The measured points; their standard errors are shown where they are known.
    """
    panels = [choice_panel(choice)]
    if table.standard_error is not None:
        known = Heatmap(
            table.current, table.displacement, table.standard_error, Axis("standard error", "N")
        )
        axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
        panels.append(Panel(*axes, [known], title="how well the force is known"))
    caption = (
        "Error at points that the network was not trained on, with its standard error: the "
        f"smallest network below the line is taken, {choice.chosen.name}. {figure.caption}"
    )
    return replace(figure, panels=[*panels, *figure.panels], caption=caption)


def choice_panel(choice: RuleChoice) -> Panel:
    """Show error against number of rules, the limit, and what was chosen."""
    taken = choice.chosen
    groups = [("constant", "", [c for c in choice.candidates if c is not taken])]
    groups.append(("estimate", "", [taken]))
    items: list[Item | Note] = [
        Points(
            np.array([c.rules for c in some], dtype=float),
            np.array([c.error for c in some]),
            np.array([c.standard_error for c in some]),
            signal=signal,
            label=label,
        )
        for signal, label, some in groups
        if some
    ]
    items.append(Rule(choice.limit, signal="limit", label=""))
    items.append(Note(taken.rules, taken.error + taken.standard_error, taken.name))
    unit = "standard errors" if choice.weighted else "N rms"
    return Panel(
        Axis("number of rules"),
        Axis("error", unit),
        items,
        title="points left out of the training",
    )
