"""The picture of a campaign: each estimator in each fault."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.judge.faults.fault_run import BASELINE, SETTINGS, recovery_text
from ambkit.result.report import Axis, Cells, Figure, Panel

if TYPE_CHECKING:
    from ambkit.judge.faults.fault_run import Outcome

SLOW = 1000.0
"""Samples until recovery from which on a cell is as dark as that of one that came back can be."""


RAISED = "\n\n\n"
"""Below every other head, which so stands above its neighbours: they are wider than columns."""


def faults_figure(campaign: Any) -> Figure:
    """Show what became of each estimator in each fault, beside the loop and in it."""
    panels = [
        Panel(Axis(""), Axis(""), [_cells(campaign, setting)], title=setting)
        for setting in SETTINGS
    ]
    rows = max(len(cells.rows) for panel in panels if (cells := panel.item(Cells)))
    return Figure(
        id="faults",
        title=f"{campaign.bearing.name}: recovery from faults",
        caption="Samples until the estimate, and in the loop the rotor, are back and stay so, the "
        "most of all seeds; the darker the longer. Darkest: lost (the rotor stayed on a stop), "
        "never, held (stands still for ever), or ∞ (not finite). In the loop the last column is "
        "the controller fed by the measurement itself.",
        panels=panels,
        panel_height=0.19 * rows,
    )


def _cells(campaign: Any, setting: str) -> Cells:
    columns = [*campaign.estimators, BASELINE]
    rows = [name for name in campaign.faults if campaign.select(setting=setting, fault=name)]
    results = [
        [campaign.select(setting=setting, fault=fault, estimator=name) for name in columns]
        for fault in rows
    ]
    return Cells(
        [_head(name, place) for place, name in enumerate(columns)],
        rows,
        np.array([[_shade(cell) for cell in row] for row in results]),
        [[recovery_text(cell).replace("not finite", "∞") for cell in row] for row in results],
    )


def _head(name: str, place: int) -> str:
    return name.replace("-", "\n") + (RAISED if place % 2 else "")


def _shade(outcomes: Sequence[Outcome]) -> float:
    text = recovery_text(outcomes)
    if not text:
        return math.nan
    return min(0.7, 0.7 * math.log1p(float(text)) / math.log1p(SLOW)) if text.isdigit() else 1.0
