"""What a report is made of: chapters of texts, formulas, figures and tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NotRequired, TypedDict

from ambkit.base.units import with_error
from ambkit.result.report import style
from ambkit.result.report.figure import Figure

Cell = str | float | int | None


@dataclass(frozen=True)
class Text:
    """Paragraphs, lists, small headings."""

    source: str  #: Markdown; formulas between dollar signs; ``[](#fig15)`` becomes "Figure 7".


@dataclass(frozen=True)
class Equation:
    """A formula on its own line."""

    source: str  #: LaTeX as `formula.mathml` understands it.
    number: str = ""  #: Written beside it: ``"eq. 15"``.


@dataclass(frozen=True)
class Remark:
    """A paragraph set apart: a finding, a misprint, a choice that was made."""

    title: str  #: In a word or two.
    source: str  #: Markdown.


@dataclass(frozen=True)
class FigureBlock:
    """A figure with its number and caption."""

    figure: Figure  #: The figure.


@dataclass(frozen=True)
class TableBlock:
    """A table."""

    id: str  #: Anchor: ``"table4"``.
    title: str  #: What it holds, in a few words.
    headers: Sequence[str]  #: Heads of the columns (Markdown with formulas), with units.
    rows: Sequence[Sequence[Cell]]  #: Cells: text (Markdown), numbers, or None for none.
    caption: str = ""  #: What to see in it (Markdown).
    #: Format of the numbers, for all columns or one each: ``".2f"``.
    digits: str | Sequence[str] = ".4g"
    #: ``(row, column)`` of cells that stand out, with the reason, which goes below the table.
    highlight: Mapping[tuple[int, int], str] = field(default_factory=dict)
    row_heads: bool = True  #: Whether the first column names the rows.
    source: str = ""  #: Where it is from: ``"paper, Table 4"``.

    def __post_init__(self) -> None:
        for place, row in enumerate(self.rows):
            if len(row) != len(self.headers):
                raise ValueError(
                    f"table {self.id}: row {place} has {len(row)} cells for "
                    f"{len(self.headers)} columns"
                )
        for row_place, column in self.highlight:
            if not (0 <= row_place < len(self.rows) and 0 <= column < len(self.headers)):
                raise ValueError(f"table {self.id}: no cell {row_place, column} to highlight")


Block = Text | Equation | Remark | FigureBlock | TableBlock


@dataclass(frozen=True)
class Chapter:
    """A chapter."""

    id: str  #: Anchor.
    title: str  #: Its heading.
    blocks: Sequence[Block]  #: What it holds.
    lead: str = ""  #: The chapter in two sentences (Markdown), set larger.


@dataclass(frozen=True)
class Report:
    """A whole report."""

    title: str  #: Title.
    subtitle: str  #: One line below it.
    lead: str  #: What this is, for someone who has just opened it (Markdown).
    version: str  #: Version of ambkit that made it.
    chapters: Sequence[Chapter]  #: The chapters.
    summary: Sequence[SummaryRow] = ()  #: The list of verdicts; may be empty.
    #: What it was made from, name to value: bearing, seed, command.
    facts: Mapping[str, str] = field(default_factory=dict)

    @property
    def figures(self) -> list[Figure]:
        """All figures, in the order they are shown."""
        return [
            block.figure
            for chapter in self.chapters
            for block in chapter.blocks
            if isinstance(block, FigureBlock)
        ]


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


def number(value: float | str | None, digits: str = ".4g") -> str:
    """Print a value for humans."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    mantissa, _, exponent = format(value, digits).replace("-", "−").partition("e")
    if not exponent:
        return mantissa
    power = str(int(exponent.replace("−", "-"))).translate(_SUPERSCRIPT)
    return f"{mantissa}×10{power}"


def ours(row: SummaryRow) -> str:
    """Print what was found for humans: ``"0.640 ± 0.011"``."""
    value, spread = row["ours"], row.get("spread")
    if spread is None or isinstance(value, str | None):
        return number(value)
    return with_error(value, spread).replace("-", "−")


def runs(row: SummaryRow) -> str:
    """Print of how many runs it is; a dash where chance has no part."""
    count = row.get("runs")
    return "–" if count is None else str(count)


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def tally(rows: Sequence[SummaryRow]) -> list[tuple[str, int]]:
    """How often each verdict was given."""
    for row in rows:
        verdict_of(row)
    verdicts = [row["verdict"] for row in rows]
    return [(word, verdicts.count(word)) for word in VERDICTS if word in verdicts]
