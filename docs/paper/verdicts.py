"""Verdicts on what the paper prints, and the summary of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NotRequired, TypedDict

from ambkit.base import escaping
from ambkit.base.units import with_error
from ambkit.result.report import style
from ambkit.result.report.blocks import number
from ambkit.result.report.markup import inline


class SummaryRow(TypedDict):
    """One line of ``summary.json``."""

    #: Short name; where it begins with a figure's, table's or chapter's id and a dot (or is one),
    #: the report links to it: ``"table4.largest_deviation"``.
    id: str
    what: str  #: What was computed, in words.
    paper: float | str | None  #: The paper's value and this run's; None where there is none.
    ours: float | str | None
    unit: str  #: Unit of both; empty for a pure number.
    verdict: str  #: One of `VERDICTS`.
    #: Standard deviation of ours over the runs, where it is a mean or a median of several.
    spread: NotRequired[float | None]
    #: Of how many runs, each with a seed of its own, or of how many recordings ours is; None where
    #: chance has no part in it.
    runs: NotRequired[int | None]


@dataclass(frozen=True)
class Verdict:
    """How a verdict looks; the sign tells it without colour."""

    sign: str  #: One character.
    kind: str  #: Which colour it takes, in the terminal and in the report.
    meaning: str  #: What it says of the row.


VERDICTS = {
    "agrees": Verdict("✓", "good", "the same as in the paper, within what the row states"),
    "reached": Verdict("✓", "good", "the goal is reached"),
    "better": Verdict("▲", "good", "better than the value it is compared with"),
    "worse": Verdict("▼", "bad", "worse than the value it is compared with"),
    "differs": Verdict("≠", "bad", "not as in the paper"),
    "missed": Verdict("✗", "bad", "the goal is missed"),
    "misprint": Verdict("!", "odd", "the paper misprints it"),
    "not given": Verdict("–", "plain", "the paper gives no number"),
}
"""The words of the column `verdict`."""

COLOURS = {"good": "#00704F", "bad": "#A32A14", "odd": "#7A5600", "plain": style.GREY}
"""Text colours of the kinds of verdict: at least 4.5 to 1 on white."""


def verdict_of(row: SummaryRow) -> Verdict:
    """Look of a row's verdict."""
    word = row["verdict"]
    if word not in VERDICTS:
        raise ValueError(
            f"summary row {row['id']!r}: unknown verdict {word!r}; known: {', '.join(VERDICTS)}"
        )
    return VERDICTS[word]


def ours(row: SummaryRow) -> str:
    """Print what was found for humans: ``"0.640 ± 0.011"``."""
    value, spread = row["ours"], row.get("spread")
    if spread is None or isinstance(value, str | None):
        return number(value)
    return with_error(value, spread).replace("-", "−")


def runs(row: SummaryRow) -> str:
    """Print of how many runs it is; a dash if the result is deterministic."""
    count = row.get("runs")
    return "–" if count is None else str(count)


def tally(rows: Sequence[SummaryRow]) -> list[tuple[str, int]]:
    """How often each verdict was given."""
    for row in rows:
        verdict_of(row)
    verdicts = [row["verdict"] for row in rows]
    return [(word, verdicts.count(word)) for word in VERDICTS if word in verdicts]


def summary(rows: Sequence[SummaryRow], names: Mapping[str, str]) -> str:
    """Write the summary in HTML, with links to what is known by its id."""
    lines = []
    for row in rows:
        anchor = row["id"].partition(".")[0]
        lines.append({
            **row, "what": inline(row["what"]), "paper": number(row["paper"]), "ours": ours(row),
            "runs": runs(row), "look": verdict_of(row),
            "anchor": anchor if anchor in names else "",
        })  # fmt: skip
    template = escaping.templates(Path(__file__).parent, autoescape=True)
    return str(
        template.get_template("summary.html.j2").render(
            rows=lines, tally=tally(rows), verdicts=VERDICTS, colours=COLOURS,
            counted=any(row.get("runs") is not None for row in rows),
        )
    )  # fmt: skip
