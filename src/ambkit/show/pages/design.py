"""The report on a design: which filter to fly, and what speaks for it, on one page."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib.metadata import version

from ambkit.base.escaping import markdown
from ambkit.result.report.blocks import Block, Chapter, FigureBlock, Remark, Report, TableBlock
from ambkit.result.report.figure import Figure


def write_design(
    path: str | os.PathLike[str],
    bearing: str,
    why: str,
    objections: Sequence[str],
    notes: Sequence[str],
    rows: Mapping[str, Sequence[float]],
    headers: Sequence[str],
    along: Figure | None,
    made: Mapping[str, str],
) -> None:
    """Write the page."""
    from ambkit.result.report.page import write_page

    verdict: list[Block] = [Remark("Which filter", markdown(why))]
    verdict += [Remark("Objection", markdown(text)) for text in objections]
    verdict += [Remark("Note", markdown(text)) for text in notes]
    verdict.append(
        TableBlock(
            id="candidates",
            title="Who was tried",
            headers=["", *headers],
            rows=[[label, *values] for label, values in rows.items()],
            caption="Log likelihood and predictions are those on records that it was not tuned on. "
            "Errors are those in simulated runs that it was not tuned on; of a filter tuned on "
            "records with the noise that it assumes, under a step of the disturbance force.",
        )
    )
    report = Report(
        title=f"A filter for {bearing}",
        subtitle=f"{len(rows)} candidates",
        lead="Tuned in the loop with the machine's controllers, judged on what was not seen and "
        "against simulated truth.",
        version=version("ambkit"),
        chapters=[
            Chapter("verdict", "Which filter to fly", verdict),
            *(
                []
                if along is None
                else [Chapter("along", "Along the record", [FigureBlock(along)])]
            ),
            Chapter(
                "made",
                "What was made",
                [
                    TableBlock(
                        id="files",
                        title="Files",
                        headers=["file", "what"],
                        rows=[[markdown(name), text] for name, text in made.items()],
                    )
                ],
            ),
        ],
    )
    write_page(report, path)
