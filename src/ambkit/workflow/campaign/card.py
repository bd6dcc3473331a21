"""What a notebook shows of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.show.notebook.card import Card
from ambkit.workflow.campaign.report import said, share
from ambkit.workflow.campaign.study import UNITS

if TYPE_CHECKING:
    from ambkit.workflow.campaign.result import Campaign


def card(of: Campaign) -> Card:
    """Describe a campaign by its yield, its figures and its worst machine."""
    rows = [["good", share(of.good)]]
    rows += [
        [f"{name} {value}", share(each)]
        for name, shares in of.by_choice.items() for value, each in shares.items()
    ]  # fmt: skip
    rows += [[f"{name}, median and 99 %", f"{said(q[0.5], UNITS[name])}, {said(q[0.99], UNITS[name])}"]
             for name, q in of.quantiles.items()]  # fmt: skip
    notes = [each.command for each in of.worst(count=1)]
    return Card(f"{of.plan.study.name}: {len(of):,} machines", rows, of.figure(), (), notes)
