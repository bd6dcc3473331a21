"""Figures, tables and verdicts of `ambkit reproduce` on a page, computed while the pages are built.

:::{reproduced} adaptive fig15
:::

shows figure ``fig15`` of the chapter ``adaptive``; so do the ids of its tables, and ``verdicts``
shows its lines of ``summary.json``.
"""

import re
from functools import cache
from importlib import import_module
from pathlib import Path

from docutils import nodes
from docutils.statemachine import StringList
from paper.study import Part, Study
from paper.verdicts import SummaryRow, ours, runs, verdict_of
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from ambkit.result.report import Figure
from ambkit.result.report.blocks import FigureBlock, TableBlock, number

FOLDER = "_build/figures"
PAPER = Path(__file__).parent.parent / "paper"


@cache
def _study() -> Study:
    return Study()


@cache
def _chapter(name: str) -> Part:
    """Compute a chapter of the reproduction; module and function have its name."""
    part: Part = getattr(import_module(f"paper.{name}"), name)(_study())
    return part


class Reproduced(SphinxDirective):
    """``{reproduced} CHAPTER ID...``."""

    required_arguments = 2
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """Write the parts as MyST and let it be parsed in place."""
        chapter, wanted = _chapter(self.arguments[0]), self.arguments[1].split()
        blocks = {b.figure.id: b.figure for b in chapter.chapter.blocks
                  if isinstance(b, FigureBlock)}  # fmt: skip
        blocks |= {b.id: b for b in chapter.chapter.blocks if isinstance(b, TableBlock)}
        lines: list[str] = []
        for name in wanted:
            if name == "verdicts":
                lines += _verdicts(chapter.rows)
            elif name not in blocks:
                raise self.error(f"{self.arguments[0]} has no {name}; it has {', '.join(blocks)}")
            elif isinstance(blocks[name], Figure):
                lines += _figure(blocks[name], Path(self.env.srcdir))
            else:
                lines += _table(blocks[name])
        lines = [re.sub(r"\]\(#(\w+)\)", _link, line) for line in lines]
        holder = nodes.container()
        self.state.nested_parse(StringList(lines, source="reproduced"), self.content_offset, holder)
        return holder.children


def _link(to: re.Match[str]) -> str:
    """Return the link to a chapter, which has a page of its own here, as one to that page."""
    name = to[1]
    return f"](/paper/{name}.md)" if (PAPER / f"{name}.md").exists() else to[0]


def _figure(figure: Figure, source: Path) -> list[str]:
    (source / FOLDER).mkdir(parents=True, exist_ok=True)
    figure.save(source / FOLDER / f"{figure.id}.svg")
    origin = f" *({figure.source}.)*" if figure.source else ""
    return [
        f":::{{figure}} /{FOLDER}/{figure.id}.svg",
        f":name: {figure.id}",
        f":alt: {figure.description()}",
        "",
        f"**{figure.title}.** {figure.caption}{origin}",
        ":::",
        "",
    ]


def _table(table: TableBlock) -> list[str]:
    digits = table.digits
    formats = [digits] * len(table.headers) if isinstance(digits, str) else list(digits)

    def cell(row: int, column: int) -> str:
        value = table.rows[row][column]
        text = value if isinstance(value, str) else number(value, formats[column])
        return f"**{text}** †" if (row, column) in table.highlight else text

    cells = [[cell(r, c) for c in range(len(table.headers))] for r in range(len(table.rows))]
    notes = [f"† {reason}" for reason in dict.fromkeys(table.highlight.values())]
    below = " ".join([table.caption, *notes]).strip()
    return [*_grid(table.title, table.id, table.headers, cells), below, ""]


def _verdicts(rows: list[SummaryRow]) -> list[str]:
    cells = [
        [
            row["what"],
            number(row["paper"]),
            f"{ours(row)} {row['unit']}",
            runs(row),
            f"{verdict_of(row).sign} {row['verdict']}",
        ]
        for row in rows
    ]
    return _grid("What came out", "", ["", "paper", "ambkit", "runs", "verdict"], cells)


def _grid(title: str, name: str, headers: list[str], cells: list[list[str]]) -> list[str]:
    """Write a table; a bar within a cell would end it."""
    rows = [headers, ["---"] * len(headers), *cells]
    options = [f":name: {name}"] if name else []
    return [
        f":::{{table}} {title}",
        *options,
        "",
        *("| " + " | ".join(text.replace("|", "\\|") for text in row) + " |" for row in rows),
        ":::",
        "",
    ]


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive."""
    app.add_directive("reproduced", Reproduced)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
