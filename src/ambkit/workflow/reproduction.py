"""The reproduction of the paper; its chapters are beside their pages in docs/paper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit.result.report import Figure
from ambkit.result.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Reproduction(Result):
    """Verdicts on the paper's results, and the report."""

    folder: Path  #: Folder of the report, its figures and tables.
    summary: Sequence[Mapping[str, Any]]  #: Rows of ``summary.json``.
    pictures: Sequence[Figure] = ()  #: Figures of the report.

    TITLE = "The paper, reproduced"

    @property
    def path(self) -> Path:
        """The report."""
        return self.folder / "report.html"

    @property
    def series(self) -> dict[str, Any]:
        return {"summary": list(self.summary)}

    def figures(self) -> Sequence[Figure]:
        return self.pictures
