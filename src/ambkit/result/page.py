"""A result as a page, for reading and, if it is judged, for signature."""

import os
from collections.abc import Sequence
from importlib.metadata import version

from ambkit.base import files
from ambkit.base.escaping import markdown
from ambkit.base.units import typeset
from ambkit.result.report.blocks import (
    Block,
    Chapter,
    FigureBlock,
    Remark,
    Report,
    TableBlock,
    Text,
)
from ambkit.result.report.page import illustrated_page
from ambkit.result.row import Part, Stated
from ambkit.result.tables import by_name, remarks

INDENT = "\N{NO-BREAK SPACE}" * 3  #: Indentation of a figure that belongs to the previous one.
Key = tuple[str, tuple[str, ...]]  #: Key of a table: its result, and its section.

SIGNED = (
    "| | name | date | signature |\n|---|---|---|---|\n"
    "| assessed by | | | |\n| reviewed by | | | |\n"
)
"""Signature fields."""


def write_result(results: Sequence[Stated], path: str | os.PathLike[str]) -> None:
    """Write results on one page, with title and facts of the first."""
    first, signed = results[0], any(result.signed for result in results)
    notes = "\n".join(f"- {markdown(typeset(note))}" for one in results for note in remarks(one))
    blocks = {key: of for result in results for key, of in _blocks(result).items()}
    parts = [_chapter(part, blocks) for result in results for part in result.chapters]
    figure_ids = {
        of.figure.id for part in parts for of in part.blocks if isinstance(of, FigureBlock)
    }
    figures = [
        FigureBlock(of) for result in results for of in result.figures() if of.id not in figure_ids
    ]
    page = illustrated_page(Report(
        title=first.title,
        subtitle="",
        lead=markdown(typeset(first.finding)),
        version=version("ambkit"),
        chapters=[
            Chapter("verdict", "Verdict" if signed else "Results", [
                *([Remark("In short", markdown(short(results)))] if limited(results) else []),
                *blocks.values(),
                *([Remark("Notes", notes)] if notes else []),
            ]),
            *parts,
            *([Chapter("figures", "Figures", figures)] if figures else []),
            *([Chapter("signed", "Signed off", [Text(SIGNED)])] if signed else []),
        ],
        facts=dict(first.facts),
    ))  # fmt: skip
    files.write_text(path, page)


def limited(results: Sequence[Stated]) -> bool:
    """Return whether a row has a limit."""
    return any(row.kept is not None for result in results for row in result.rows)


def short(results: Sequence[Stated]) -> str:
    """Return in a sentence which limits are violated."""
    missed = [
        f"{row.name.strip()} ({row.of})" if row.of else row.name.strip()
        for result in results
        for row in result.rows
        if row.kept is False
    ]
    return "All limits are kept." if not missed else f"Not kept: {', '.join(missed)}."


def _chapter(part: Part, tables: dict[Key, TableBlock]) -> Chapter:
    """Return a chapter, and remove its tables from the others."""
    size = len(part.section or ())
    own = [key for key in tables if part.section and key[1][:size] == part.section]
    lead, _, text = part.lead.partition("\n\n")
    blocks: list[Block] = [Text(text)] if text else []
    blocks += [*map(FigureBlock, part.figures), *map(tables.pop, own)]
    return Chapter(part.title.lower().replace(" ", "-"), part.title, blocks, lead=lead)


def _blocks(result: Stated) -> dict[Key, TableBlock]:
    name = type(result).__name__.lower()
    return {
        (name, section): TableBlock(
            id=f"{name}-{place}",
            title=markdown(typeset(of.title)),
            headers=[markdown(typeset(head)) for head in of.headers],
            rows=[
                [
                    f"{INDENT * name.startswith(' ')}{markdown(typeset(name))}",
                    *(markdown(typeset(cell)) for cell in cells),
                ]
                for name, *cells in of.rows
            ],
        )
        for place, (section, of) in enumerate(by_name(result))
    }
