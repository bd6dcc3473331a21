"""The paper, reproduced. Its chapters stand beside the pages that show them."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from ambkit.base import files
from ambkit.result.report import Report, write_report
from ambkit.result.report.blocks import number
from ambkit.result.row import Row
from ambkit.workflow.reproduction import Reproduction
from paper.study import SEEDS, Part, Study
from paper.verdicts import SummaryRow, ours, tally, verdict_of
from paper.verdicts import summary as summary_of

CHAPTERS = (
    "linear", "adaline", "lsm", "expert", "adaptive", "gain", "sampling", "chain", "errata",
    "recording",
)  # fmt: skip
"""In the order of the report; each a module, and a function of its name."""


@dataclass(frozen=True, eq=False, repr=False)
class Judged(Reproduction):
    """The reproduction, with what its verdicts say."""

    summary: Sequence[SummaryRow]

    @property
    def finding(self) -> str:
        verdicts = ", ".join(f"{word} {count}" for word, count in tally(self.summary))
        return f"{self.title}: {verdicts}."

    @property
    def rows(self) -> list[Row]:
        results = []
        for line in self.summary:
            head, _, name = line["what"].rpartition(": ")
            unit, verdict = f" {line['unit']}".rstrip(), verdict_of(line)
            values = {
                "paper": None if line["paper"] is None else number(line["paper"]) + unit,
                "ours": ours(line) + unit,
                "verdict": f"{verdict.sign} {line['verdict']}",
            }
            results += [Row(line["id"], name, value, of=of, section=(head,))
                        for of, value in values.items()]  # fmt: skip
        return results


def reproduce(
    out: str | os.PathLike[str],
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _message: None,
) -> Judged:
    """Reproduce the paper's tables and figures, and judge them."""
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
        report = _report(study, parts, rows, seed)
        write_report(report, temporary, progress)
        summary = json.dumps(rows, indent=2, ensure_ascii=False)
        files.write_text(temporary / "summary.json", f"{summary}\n")
    return Judged(folder, rows, report.figures)


def _report(study: Study, parts: list[Part], rows: list[SummaryRow], seed: int) -> Report:
    """Put the chapters together."""
    return Report(
        title="Adaptive Kalman filter for active magnetic bearings",
        subtitle="The paper of Li, Kästner and Worlitz, reproduced and judged",
        lead="An active magnetic bearing is unstable without control, its force law is nonlinear, "
        "and its sensor is noisy and delayed. The paper corrects the model of a Kalman filter as "
        "it runs: ADALINE identifies the magnet, least squares gives the stiffnesses at 25 points, "
        "a fuzzy network interpolates them, and the filter evaluates it at each sample (Fig. 1 "
        "of the paper is the block diagram). Everything below is computed by the C core that runs "
        "in the controller.",
        version=version("ambkit"),
        chapters=[part.chapter for part in parts],
        summary=partial(summary_of, rows),
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
