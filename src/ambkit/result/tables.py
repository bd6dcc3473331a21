"""The tables of a result, as the terminal, LaTeX, the card and the page show them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from ambkit.result.row import Row, singles
from ambkit.result.sections import Section, Stated, by_section
from ambkit.result.table import LINE, Table, table

MISSED = "✗"
"""Stands behind what does not keep its limit."""


def tables(result: Stated, *, verbose: bool = True) -> Iterator[Table]:
    """Yield the table of each section, without what is not known of anything."""
    for _, of in by_name(result, verbose=verbose):
        yield of


def by_name(result: Stated, *, verbose: bool = True) -> Iterator[tuple[tuple[str, ...], Table]]:
    """Yield each section and its table."""
    all_rows = [row for row in singles(result.rows) if verbose or not row.detail]
    known = {(row.section, row.name) for row in all_rows if row.known}
    visible_rows = [row for row in all_rows if (row.section, row.name) in known]
    for name, rows in by_section(visible_rows):
        section = result.sections.get(name, Section(" ".join(name)))
        lines = _across(rows) if section.across else _down(rows)
        if len(lines) > 1:
            texts = any(len(cells[-1]) > LINE for cells in lines)
            yield name, table(section.title, lines[0], lines[1:], wide=texts)


def remarks(result: Stated, *, verbose: bool = True) -> list[str]:
    """Return the notes of the rows, and then those of the result."""
    own = [
        f"{row.name.strip()}: {row.note}"
        for row in result.rows
        if row.note and (verbose or not row.detail)
    ]
    return [*dict.fromkeys(own), *result.notes]


def _down(rows: Sequence[Row]) -> list[list[str]]:
    """Return head and lines: figures below each other, what they are of beside each other."""
    columns = list(dict.fromkeys(row.of for row in rows))
    more = _more(rows)
    lines = [["", *columns, *(head for head, _ in more)]]
    for name, of in _grouped(rows, lambda row: row.name):
        by = {row.of: row for row in of}
        lines.append([
            name, *(_cell(by[c]) if c in by else "–" for c in columns),
            *(_all(tell, of) for _, tell in more),
        ])  # fmt: skip
        if any(row.place() for row in of):
            at = [by[c].place() if c in by else "" for c in columns]
            lines.append(["  at", *(text or "–" for text in at), *([""] * len(more))])
    return lines


def _across(rows: Sequence[Row]) -> list[list[str]]:
    """Return head and lines: one line for each thing, its figures beside each other."""
    names = list(dict.fromkeys(row.name for row in rows))
    more = _more(rows)
    lines = [["", *map(str.strip, names), *(head for head, _ in more)]]
    for thing, of in _grouped(rows, lambda row: row.of):
        by = {row.name: row for row in of}
        cells = [_cell(by[name]) if name in by else "–" for name in names]
        lines.append([thing, *cells, *(_all(tell, of) for _, tell in more)])
    return lines


def _more(rows: Sequence[Row]) -> list[tuple[str, Callable[[Row], str]]]:
    """Return head and text of the further columns that some row has."""
    known = (("95 % interval", Row.confidence), ("limit", Row.limit))
    return [(head, tell) for head, tell in known if any(map(tell, rows))]


def _all(tell: Callable[[Row], str], rows: Sequence[Row]) -> str:
    return "; ".join(dict.fromkeys(filter(None, map(tell, rows))))


def _cell(row: Row) -> str:
    return f"{row.text()} {MISSED}" if row.kept is False else row.text()


def _grouped(rows: Sequence[Row], key: Callable[[Row], str]) -> Iterator[tuple[str, list[Row]]]:
    for name in dict.fromkeys(map(key, rows)):
        yield name, [row for row in rows if key(row) == name]
