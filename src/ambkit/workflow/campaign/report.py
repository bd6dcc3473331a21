"""The report of a campaign: one page with yield, worst machines, what drives them."""

from __future__ import annotations

import os
from importlib.metadata import version
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError, ExtraMissing
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.result.report.blocks import (
    Block,
    Cell,
    Chapter,
    FigureBlock,
    Remark,
    Report,
    TableBlock,
    Text,
)
from ambkit.workflow.campaign import pictures
from ambkit.workflow.campaign.parts import UNITS
from ambkit.workflow.campaign.rare_file import told
from ambkit.workflow.campaign.sensitivities import indices

if TYPE_CHECKING:
    from ambkit.workflow.campaign.machines import Machines
    from ambkit.workflow.campaign.statistics import Share

DRIVEN = 3
"""Figures that are explained."""


def write(campaign: Machines, path: str | os.PathLike[str]) -> None:
    """Write the page."""
    from ambkit.result.report.page import write_page

    if not len(campaign):
        raise AmbkitError(f"{campaign.folder}: no part is finished yet")
    write_page(report_of(campaign), path)


def report_of(campaign: Machines) -> Report:
    """Build the report of a campaign that has runs."""
    study, plan = campaign.plan.study, campaign.plan
    good = campaign.good
    chapters = [_yield(campaign), _figures(campaign)]
    if plan.names:
        chapters.append(_drives(campaign))
    chapters.append(_worst(campaign))
    return Report(
        title=f"{markdown(study.name)}: {good.of:,} machines",
        subtitle=f"machine {markdown(plan.nominal.name)}",
        lead=f"**{share(good)}** of the machines are good. {markdown(study.description)}",
        version=version("ambkit"),
        chapters=chapters,
        facts={
            "study": study.name,
            "runs": f"{good.of:,} of {plan.runs:,}",
            "sampling": study.sampling,
            "seed": str(study.seed),
            "rows": str(campaign.runs),
        },
    )


def share(of: Share) -> str:
    """Print a share with its interval."""
    if not of.of:
        return "–"
    return f"{100 * of.value:.2f} % ({100 * of.low:.2f} to {100 * of.high:.2f} %)"


def said(value: object, unit: str) -> str:
    """Print a value in SI as an engineer writes it; a word as it is."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str | None):
        return markdown(value or "–")
    number = float(str(value))
    if number != number:
        return "–"
    if number in (float("inf"), float("-inf")):
        return "∞"
    return f"{number:.4g}" if unit in ("1", "") else engineering(number, unit, digits=4)


def _yield(campaign: Machines) -> Chapter:
    passes = campaign.plan.study.passes
    wanted = [] if passes.zone is None else [f"zone {passes.zone} or better"]
    wanted += [] if passes.contact else ["no contact"]
    wanted += [f"{name} at most {limit}" for name, limit in passes.at_most.items()]
    level = f"{100 * campaign.plan.study.confidence:g} %"
    blocks: list[Block] = [
        Text(
            f"Good is a machine with {markdown('; '.join(wanted))}. "
            f"Intervals are those of Clopper and Pearson, {level}."
            if wanted
            else "Any machine counts as good: the study has no criterion."
        )
    ]
    rows: list[list[Cell]] = [["all", share(campaign.good), campaign.good.of]]
    for name, shares in campaign.by_choice.items():
        rows += [[f"{markdown(name)} {markdown(v)}", share(s), s.of] for v, s in shares.items()]
    blocks.append(TableBlock("shares", "Yield", ["", "good", "machines"], rows, digits=",d"))
    if campaign.fails:
        failed: list[list[Cell]] = [
            [markdown(name), count, f"{100 * count / len(campaign):.2f} %"]
            for name, count in campaign.fails.items()
        ]
        heads = ["by", "machines", "share"]
        blocks.append(TableBlock("failures", "What they fail by", heads, failed, digits=",d"))
    if campaign.zones:
        zones: list[list[Cell]] = [
            [name or "not told", count, f"{100 * count / len(campaign):.2f} %"]
            for name, count in campaign.zones.items()
        ]
        blocks.append(
            TableBlock(
                "zones", "Zones of ISO 14839-3", ["zone", "machines", "share"], zones, digits=",d",
                caption="By the peak of the sensitivity of each machine's linear loop.",
            )
        )  # fmt: skip
    for text in told(campaign.folder):
        blocks.append(Remark("Rare failure", markdown(text)))
    return Chapter("good", "How many are good", blocks)


def _figures(campaign: Machines) -> Chapter:
    quantiles = campaign.quantiles
    heads = ["", *(f"{100 * q:g} %" for q in next(iter(quantiles.values()), {}))]
    rows = [
        [markdown(name), *(said(value, UNITS[name]) for value in of.values())]
        for name, of in quantiles.items()
    ]
    table = TableBlock(
        "quantiles", "Quantiles", heads, rows,
        caption="That share of the machines is at or below the value.",
    )  # fmt: skip
    return Chapter("figures", "How good", [FigureBlock(pictures.cumulative(campaign)), table])


def _drives(campaign: Machines) -> Chapter:
    blocks: list[Block] = [FigureBlock(pictures.parallel(campaign))]
    for name in campaign.figures[:DRIVEN]:
        blocks.append(FigureBlock(pictures.tornado(campaign, name)))
        try:
            blocks.append(FigureBlock(pictures.indices(indices(campaign, name))))
        except ExtraMissing as error:
            blocks.append(Remark("Sobol indices", markdown(str(error))))
        except AmbkitError as error:  # which is told where the picture would be
            blocks.append(Remark(f"Indices of {markdown(name)}", markdown(str(error))))
    return Chapter("drives", "What drives it", blocks)


def _worst(campaign: Machines) -> Chapter:
    names, blocks = campaign.plan.names, list[Block]()
    units = [key.unit for key in campaign.plan.keys]
    for figure in campaign.figures[:DRIVEN]:
        worst = campaign.worst(figure)
        rows = [
            [str(each.run), said(each.value, UNITS[figure]),
             *(said(each.values[n], unit) for n, unit in zip(names, units, strict=True)),
             f"`{each.command}`"]
            for each in worst
        ]  # fmt: skip
        heads = ["run", markdown(figure), *map(markdown, names), "replay"]
        title = f"Worst by {markdown(figure)}"
        blocks.append(TableBlock(f"worst-{figure}", title, heads, rows))
    lead = "Each command simulates the machine again, with every sample."
    return Chapter("worst", "The worst machines", blocks, lead=lead)
