"""Blocks of a report: chapters with texts, formulas, figures and tables."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from ambkit.result.report.figure import Figure

Cell = str | float | int | None


@dataclass(frozen=True)
class Text:
    """Paragraphs, lists, small headings."""

    source: str  #: Markdown; formulas between dollar signs; ``[](#fig15)`` becomes "Figure 7".


@dataclass(frozen=True)
class Equation:
    """A displayed formula."""

    source: str  #: LaTeX.
    number: str = ""  #: Its number: ``"eq. 15"``.


@dataclass(frozen=True)
class Remark:
    """A highlighted paragraph: a finding, a misprint, a choice."""

    title: str  #: Title, in a word or two.
    source: str  #: Markdown.


@dataclass(frozen=True)
class FigureBlock:
    """A figure with its number and caption."""

    figure: Figure  #: The figure.


@dataclass(frozen=True)
class TableBlock:
    """A table."""

    id: str  #: Anchor: ``"table4"``.
    title: str  #: Short title.
    headers: Sequence[str]  #: Heads of the columns (Markdown with formulas), with units.
    rows: Sequence[Sequence[Cell]]  #: Cells: text (Markdown), numbers, or None for none.
    caption: str = ""  #: What the table shows (Markdown).
    #: Format of the numbers, for all columns or one each: ``".2f"``.
    digits: str | Sequence[str] = ".4g"
    #: ``(row, column)`` of highlighted cells, with the reason, which is printed below the table.
    highlight: Mapping[tuple[int, int], str] = field(default_factory=dict)
    row_heads: bool = True  #: Whether the first column names the rows.
    source: str = ""  #: Origin: ``"paper, Table 4"``.

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
    blocks: Sequence[Block]  #: Its blocks.
    lead: str = ""  #: The chapter in two sentences (Markdown), set larger.


@dataclass(frozen=True)
class Report:
    """A whole report."""

    title: str  #: Title.
    subtitle: str  #: One line below it.
    lead: str  #: Introduction for a first reader (Markdown).
    version: str  #: Version of ambkit.
    chapters: Sequence[Chapter]  #: The chapters.
    #: Inputs, name to value: machine, seed, command.
    facts: Mapping[str, str] = field(default_factory=dict)
    #: Writes a summary in HTML for the start; its argument is their names by id.
    summary: Callable[[Mapping[str, str]], str] | None = None

    @property
    def figures(self) -> list[Figure]:
        """All figures, in order."""
        return [
            block.figure
            for chapter in self.chapters
            for block in chapter.blocks
            if isinstance(block, FigureBlock)
        ]


def number(value: float | str | None, digits: str = ".4g") -> str:
    """Format a value for humans."""
    if value is None:
        return "–"
    if isinstance(value, str):
        return value
    mantissa, _, exponent = format(value, digits).replace("-", "−").partition("e")
    if not exponent:
        return mantissa
    power = str(int(exponent.replace("−", "-"))).translate(_SUPERSCRIPT)
    return f"{mantissa}×10{power}"


_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
