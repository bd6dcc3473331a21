"""The verdict on a loop as one page, to be read and signed off."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib.metadata import version

from ambkit.base.escaping import markdown
from ambkit.result.report.blocks import Chapter, FigureBlock, Remark, Report, TableBlock, Text
from ambkit.result.report.figure import Figure

SIGNS = {True: "✓\N{NO-BREAK SPACE}kept", False: "✗ not\N{NO-BREAK SPACE}kept", None: ""}
"""How a line of the verdict ends."""


def write_assessment(
    path: str | os.PathLike[str],
    bearing: str,
    fed_by: str,
    lines: Sequence[tuple[str, str, str, bool | None]],
    margins: Sequence[Figure],
    loads: Sequence[Figure],
    facts: Mapping[str, str],
) -> None:
    """Write the page."""
    from ambkit.result.report.page import write_page

    missed = [what.strip() for what, _, _, good in lines if good is False]
    words = "All that has a limit keeps it." if not missed else f"Not kept: {', '.join(missed)}."
    table = TableBlock(
        id="looked-at",
        title="What was looked at",
        headers=["", "found", "limit", ""],
        rows=[[markdown(what.strip()), markdown(found), markdown(limit), SIGNS[good]]
              for what, found, limit, good in lines],
        caption="Of a linear model at one work point, peaks with unbalance, runout and three times "
        "the rms of noise. An aid, not a certificate: the standards ask for measurements on the "
        "machine.",
    )  # fmt: skip
    signed = Text(
        "| | name | date | signature |\n|---|---|---|---|\n"
        "| assessed by | | | |\n| reviewed by | | | |\n"
    )
    report = Report(
        title=f"Verdict on the loop of {bearing}",
        subtitle=f"controller fed by {fed_by}",
        lead="Stability margin, displacement, current and load of the closed loop, sampled, with "
        "dead time, amplifier, sensor, controller and filter.",
        version=version("ambkit"),
        chapters=[
            Chapter("verdict", "Verdict", [Remark("In short", markdown(words)), table]),
            Chapter("margins", "Margins", [FigureBlock(each) for each in margins]),
            *([Chapter("loads", "Loads", [FigureBlock(each) for each in loads])] if loads else []),
            Chapter("signed", "Signed off", [signed]),
        ],
        facts=dict(facts),
    )
    write_page(report, path)
