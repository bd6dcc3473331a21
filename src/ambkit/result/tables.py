"""Tables of a result, for terminal, LaTeX, card and page."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ambkit.base import escaping
from ambkit.base.escaping import one_line
from ambkit.base.units import typeset
from ambkit.result.row import Row, Section, Stated, singles

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

Key = TypeVar("Key")

MISSED = "✗"  #: Mark of a value beyond its limit.


def tables(result: Stated, *, verbose: bool = True) -> Iterator[Table]:
    """Yield the table of each section, without rows that are unknown throughout."""
    for _, of in by_name(result, verbose=verbose):
        yield of


def by_name(result: Stated, *, verbose: bool = True) -> Iterator[tuple[tuple[str, ...], Table]]:
    """Yield each section and its table."""
    all_rows = [row for row in singles(result.rows) if verbose or not row.detail]
    known = {(row.section, row.name) for row in all_rows if row.known}
    visible_rows = [row for row in all_rows if (row.section, row.name) in known]
    for name, rows in _grouped(visible_rows, lambda row: row.section):
        section = result.sections.get(name, Section(" ".join(name)))
        lines = _lines(rows, across=section.across)
        if len(lines) > 1:
            texts = any(len(cells[-1]) > LINE for cells in lines)
            yield name, table(section.title, lines[0], lines[1:], wide=texts)


def remarks(result: Stated, *, verbose: bool = True) -> list[str]:
    """Return the notes of the rows, then those of the result."""
    own = [
        f"{row.name.strip()}: {row.note}"
        for row in result.rows
        if row.note and (verbose or not row.detail)
    ]
    return [*dict.fromkeys(own), *result.notes]


def _lines(rows: Sequence[Row], *, across: bool) -> list[list[str]]:
    """Return head and lines: figures as rows and objects as columns, or the other way across."""
    of_line, of_column = map(attrgetter, ("of", "name") if across else ("name", "of"))
    columns = list(dict.fromkeys(map(of_column, rows)))
    more = _more(rows)
    lines = [["", *map(str.strip, columns), *(head for head, _ in more)]]
    for head, of in _grouped(rows, of_line):
        by = {of_column(row): row for row in of}
        cells = [_cell(by[c]) if c in by else "–" for c in columns]
        lines.append([head, *cells, *(_all(tell, of) for _, tell in more)])
        if not across and any(row.place() for row in of):
            at = [by[c].place() if c in by else "" for c in columns]
            lines.append(["  at", *(text or "–" for text in at), *([""] * len(more))])
    return lines


def _more(rows: Sequence[Row]) -> list[tuple[str, Callable[[Row], str]]]:
    """Return head and text of optional columns."""
    known = (("95 % interval", Row.confidence), ("limit", Row.limit))
    return [(head, tell) for head, tell in known if any(map(tell, rows))]


def _all(tell: Callable[[Row], str], rows: Sequence[Row]) -> str:
    return "; ".join(dict.fromkeys(filter(None, map(tell, rows))))


def _cell(row: Row) -> str:
    return f"{row.text()} {MISSED}" if row.kept is False else row.text()


def _grouped(rows: Sequence[Row], key: Callable[[Row], Key]) -> Iterator[tuple[Key, list[Row]]]:
    """Yield the rows of each key, in order of first occurrence."""
    for name in dict.fromkeys(map(key, rows)):
        yield name, [row for row in rows if key(row) == name]


GAP = 3  #: Characters between two columns of a table, and at its sides.
LINE = 24  #: Minimum characters for names and sentences in a table, if they need as many.


class Table(NamedTuple):
    """A table as wide as the terminal; no name or number is truncated."""

    title: str
    headers: list[str]
    rows: list[list[str]]
    wide: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
        """Print it, in several parts if its columns need more than the width."""
        from rich.text import Text

        if self.title:
            yield Text(self.title, style="bold", overflow="ignore")
        columns = list(zip(self.headers, *self.rows, strict=True))
        widths = [
            _widths(cells, words=place == 0 or (self.wide and place == len(columns) - 1))
            for place, cells in enumerate(columns)
        ]
        for part in _parts([least for least, _ in widths], options.max_width):
            spread = _spread([widths[place] for place in part], options.max_width)
            yield self._printed({place: columns[place] for place in part}, spread)

    def _printed(self, columns: dict[int, tuple[str, ...]], widths: list[int]) -> Any:
        """Print some of the columns, by index, with these widths."""
        from rich import box, table
        from rich.text import Text

        rich_table = table.Table(
            width=sum(widths) + GAP * len(widths) - 1,
            box=box.SIMPLE_HEAD,
            show_header=any(self.headers),
            pad_edge=False,
        )
        lines = []
        for (place, cells), width in zip(columns.items(), widths, strict=True):
            left = place == 0 or (self.wide and place == len(self.headers) - 1)
            head = Text(cells[0], overflow="fold")
            rich_table.add_column(head, justify="left" if left else "right", width=width)
            lines.append([cell if left else _broken(cell, width) for cell in cells[1:]])
        for row in zip(*lines, strict=True):
            rich_table.add_row(*(Text(cell, overflow="fold") for cell in row))
        return rich_table


def table(
    title: str, headers: Sequence[str], rows: Iterable[Sequence[str]], *, wide: bool = False
) -> Table:
    """Build a table with row names in the first column."""
    cells = [[escaping.lines(cell) for cell in row] for row in rows]
    return Table(escaping.lines(title), [escaping.lines(head) for head in headers], cells, wide)


def _widths(cells: Sequence[str], *, words: bool) -> tuple[int, int]:
    """Return the minimum width of a column without truncation, and that of its longest cell."""
    # A number stays with its unit; lines of `words` break between any two, but not too early.
    from rich.cells import cell_len

    least = [1]
    for cell in cells:
        number = not words and cell[:1] in set("0123456789+-−±–")
        least += map(cell_len, _broken(cell, 0).split("\n") if number else cell.split())
    full_width = max(1, *map(cell_len, cells))
    return max(*least, min(full_width, LINE) if words else 1), full_width


def _broken(cell: str, width: int) -> str:
    """Break a cell that is longer than its column after each semicolon."""
    return cell if len(cell) <= width else cell.replace("; ", ";\n")


def _parts(least: Sequence[int], room: int) -> list[list[int]]:
    """Return groups of columns that fit the width, each with the first column."""
    parts = [[0]]
    for place in range(1, len(least)):
        part = [*parts[-1], place]
        if len(parts[-1]) > 1 and sum(least[of] + GAP for of in part) - 1 > room:
            parts.append([0, place])
        else:
            parts[-1] = part
    return parts


def _spread(widths: Sequence[tuple[int, int]], room: int) -> list[int]:
    """Distribute the width over the columns, between minimum and full width."""
    sizes = [least for least, _ in widths]
    lacks = [full_width - least for least, full_width in widths]
    for _ in range(min(sum(lacks), room + 1 - sum(sizes) - GAP * len(sizes))):
        most = max(range(len(lacks)), key=lacks.__getitem__)
        sizes[most] += 1
        lacks[most] -= 1
    return sizes


_WRITTEN = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#",
    "%": r"\%", "_": r"\_", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}", "<": "$<$",
    ">": "$>$", "|": r"$\vert$", "\u00a0": "~", "°": r"\textdegree{}", "−": "$-$", "±": r"$\pm$",
    "²": r"\textsuperscript{2}", "✗": r"$\times$", "µ": r"\textmu{}", "–": "--", "∞": r"$\infty$",
    "Ω": r"$\Omega$", "√": r"$\surd$",
}  # fmt: skip


def latex(result: Stated) -> str:
    """Return the tables in sequence; they need the packages booktabs and textcomp."""
    return "\n\n".join(map(_tabular, tables(result)))


def _tabular(of: Table) -> str:
    head, *rows = [" & ".join(map(escaped, cells)) + r" \\" for cells in (of.headers, *of.rows)]
    return "\n".join([
        f"% {one_line(of.title)}", rf"\begin{{tabular}}{{l{'r' * (len(of.headers) - 1)}}}",
        r"\toprule", head, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}",
    ])  # fmt: skip


def escaped(text: str) -> str:
    """Escape a text for LaTeX."""
    line = one_line(text).replace("  ", "\N{NO-BREAK SPACE}" * 2)
    line = typeset(line) if line[:1].isdigit() or line[:1] == "-" else line
    return re.sub(".", lambda at: _WRITTEN.get(at[0], at[0]), line)
