"""What a report is made of: chapters of texts, formulas, figures and tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ambkit.show.report.figure import Figure
from ambkit.show.report.summary import SummaryRow

Cell = str | float | int | None


@dataclass(frozen=True)
class Text:
    """Paragraphs, lists, small headings.

    Parameters
    ----------
    source : str
        Markdown; formulas between dollar signs; ``[](#fig15)`` becomes "Figure 7".
    """

    source: str


@dataclass(frozen=True)
class Equation:
    """A formula on its own line.

    Parameters
    ----------
    source : str
        LaTeX as `formula.mathml` understands it.
    number : str
        Written beside it: ``"eq. 15"``.
    """

    source: str
    number: str = ""


@dataclass(frozen=True)
class Remark:
    """A paragraph set apart: a finding, a misprint, a choice that was made.

    Parameters
    ----------
    title : str
        In a word or two.
    source : str
        Markdown.
    """

    title: str
    source: str


@dataclass(frozen=True)
class FigureBlock:
    """A figure with its number and caption.

    Parameters
    ----------
    figure : Figure
        The figure.
    """

    figure: Figure


@dataclass(frozen=True)
class TableBlock:
    """A table.

    Parameters
    ----------
    id : str
        Anchor: ``"table4"``.
    title : str
        What it holds, in a few words.
    headers : sequence of str
        Heads of the columns (Markdown with formulas), with units.
    rows : sequence of sequence
        Cells: text (Markdown), numbers, or None for none.
    caption : str
        What to see in it (Markdown).
    digits : str or sequence of str
        Format of the numbers, for all columns or one each: ``".2f"``.
    highlight : mapping
        ``(row, column)`` of cells that stand out, with the reason, which goes below the table.
    row_heads : bool
        Whether the first column names the rows.
    source : str
        Where it is from: ``"paper, Table 4"``.

    Raises
    ------
    ValueError
        If a row has another number of cells than there are headers, or a highlighted cell is not
        in the table.
    """

    id: str
    title: str
    headers: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    digits: str | Sequence[str] = ".4g"
    highlight: Mapping[tuple[int, int], str] = field(default_factory=dict)
    row_heads: bool = True
    source: str = ""

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
    """A chapter.

    Parameters
    ----------
    id : str
        Anchor.
    title : str
        Its heading.
    blocks : sequence of Block
        What it holds.
    lead : str
        The chapter in two sentences (Markdown), set larger.
    """

    id: str
    title: str
    blocks: Sequence[Block]
    lead: str = ""


@dataclass(frozen=True)
class Report:
    """A whole report.

    Parameters
    ----------
    title : str
        Title.
    subtitle : str
        One line below it.
    lead : str
        What this is, for someone who has just opened it (Markdown).
    version : str
        Version of ambkit that made it.
    chapters : sequence of Chapter
        The chapters.
    summary : sequence of SummaryRow
        The list of verdicts; may be empty.
    facts : mapping
        What it was made from, name to value: bearing, seed, command.
    """

    title: str
    subtitle: str
    lead: str
    version: str
    chapters: Sequence[Chapter]
    summary: Sequence[SummaryRow] = ()
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
