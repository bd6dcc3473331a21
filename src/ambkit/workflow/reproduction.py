"""The paper, reproduced. Its chapters stand beside the pages that show them, in docs/paper."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base import files, installed
from ambkit.base.progress import shown_in_notebooks
from ambkit.result.table import screen_width

if TYPE_CHECKING:
    from paper.study import Part, Study

    from ambkit.result.report.blocks import Report
    from ambkit.result.report.summary import SummaryRow

CHAPTERS = (
    "linear", "adaline", "lsm", "expert", "adaptive", "gain", "sampling", "chain", "errata",
    "recording",
)  # fmt: skip
"""In the order of the report; each a module, and a function of its name."""


@dataclass(frozen=True)
class Outcome:
    """Where a reproduction went, and what it found."""

    folder: Path
    rows: list[SummaryRow]

    @property
    def path(self) -> Path:
        """The report."""
        return self.folder / "report.html"

    def __str__(self) -> str:
        from io import StringIO

        from rich.console import Console

        from ambkit.result.report.terminal import print_summary

        text = StringIO()
        print_summary(self.rows, Console(file=text, width=screen_width()))
        return text.getvalue()

    def to_dict(self) -> list[SummaryRow]:
        """Return the verdicts as plain data."""
        return self.rows


@shown_in_notebooks("reproducing the paper", by="progress")
def reproduce(
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _message: None,
) -> Outcome:
    """Reproduce the paper's tables and figures, and judge them."""
    from ambkit.result.report.page import write_report

    _find_chapters()
    from paper.study import Study

    folder = Path(out)
    # Begun before the work: an unwritable place is told at once.
    with files.replacing_in(folder) as temporary:
        study = Study(seed=seed)
        parts = _chapters(study, progress)
        rows = [row for part in parts for row in part.rows]
        files.make_folder(temporary / "tables")
        for part in parts:
            for name, text in part.tables.items():
                files.write_text(temporary / "tables" / name, text)
        write_report(_report(study, parts, rows, seed), temporary, progress)
        summary = json.dumps(rows, indent=2, ensure_ascii=False)
        files.write_text(temporary / "summary.json", f"{summary}\n")
    return Outcome(folder, rows)


def _find_chapters() -> None:
    """Let Python find the package of the chapters."""
    docs = str(installed.folder("docs", "docs"))
    if docs not in sys.path:
        sys.path.insert(0, docs)


def _report(study: Study, parts: list[Part], rows: list[SummaryRow], seed: int) -> Report:
    """Put the chapters together."""
    from importlib.metadata import version

    from paper.study import SEEDS

    from ambkit.result.report.blocks import Report

    return Report(
        title="Adaptive Kalman filter for active magnetic bearings",
        subtitle="The paper of Li, Kästner and Worlitz, reproduced and judged",
        lead="An active magnetic bearing is unstable without control, its force law is nonlinear, "
        "its sensor noisy and late. The paper corrects the model of a Kalman filter while it runs: "
        "ADALINE identifies the magnet, least squares gives the stiffnesses at 25 points, "
        "a fuzzy network makes an expert of them, and the filter asks it at each sample (its "
        "Fig. 1 draws it as one block diagram). Everything below is computed by one C core, the "
        "same that flies.",
        version=version("ambkit"),
        chapters=[part.chapter for part in parts],
        summary=rows,
        facts={
            "bearing": f"{study.bearing.name}, {study.bearing.description}",
            "noise": f"seed {seed} and on",
            "figures of merit": f"means over {SEEDS} seeds or more; pictures of runs show one",
            "made by": "ambkit reproduce",
        },
    )


def _chapters(study: Study, progress: Callable[[str], None]) -> list[Part]:
    """Make the chapters, in the order of the report."""
    parts: list[Part] = []
    for name in CHAPTERS:
        progress(f"chapter {len(parts) + 1} of {len(CHAPTERS)}: {name}")
        parts.append(getattr(import_module(f"paper.{name}"), name)(study))
    return parts
