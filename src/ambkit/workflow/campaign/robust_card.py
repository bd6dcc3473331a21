"""What a notebook shows of a search over the tolerances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.result.card import Card, value

if TYPE_CHECKING:
    from ambkit.workflow.campaign.robust import Robust


def card(of: Robust) -> Card:
    """Describe a search by what it took."""
    before, after = of.tried[0], of.tried[of.taken]
    rows = [
        [each.name, value(each.default, each.unit), value(after.values[each.name], each.unit)]
        for each in of.free
    ]
    rows += [
        ["error of f_d", value(before.error, "N"), value(after.error, "N")],
        ["peak of |S|", f"{before.peak:.3f}", f"{after.peak:.3f}"],
    ]
    title = f"{of.kind} for {of.plan.study.name}, {100 * of.quantile:g} % of the machines"
    return Card(title, rows, of.figure(), ["", "untuned", "tuned"])
