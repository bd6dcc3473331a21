"""What a notebook shows of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.result.card import Card
from ambkit.workflow.campaign import pictures
from ambkit.workflow.campaign.parts import UNITS
from ambkit.workflow.campaign.report import said, share

if TYPE_CHECKING:
    from ambkit.workflow.campaign.machines import Machines


def card(of: Machines) -> Card:
    """Describe a campaign by its yield, its figures and its worst machine."""
    rows = [["good", share(of.good)]]
    rows += [
        [f"{name} {value}", share(each)]
        for name, shares in of.by_choice.items() for value, each in shares.items()
    ]  # fmt: skip
    rows += [
        [f"{name}, median and 99 %", ", ".join(said(q[at], UNITS[name]) for at in (0.5, 0.99))]
        for name, q in of.quantiles.items()
    ]
    notes = [each.command for each in of.worst(count=1)]
    return Card(
        f"{of.plan.study.name}: {len(of):,} machines", rows, pictures.cumulative(of), (), notes
    )
