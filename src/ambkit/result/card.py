"""A small table and a picture, as HTML of a notebook; the picture also as a plot."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from io import BytesIO
from typing import Any

import numpy as np
from pydantic import BaseModel

from ambkit.base.config.problems import settings_of
from ambkit.base.escaping import one_line
from ambkit.base.units import figure, typeset
from ambkit.result.report.figure import WIDTH, Figure
from ambkit.result.row import Stated
from ambkit.result.tables import table, tables

LONGEST = 300  #: Characters of a cell or a note; a description may have thousands.
MOST_ROWS = 24  #: Rows of a table; of more it says how many there are.
LIGHT = 110  #: Pixels per inch of a picture that stands in a notebook, and is kept with it.

_LEFT = ' style="text-align:left"'


@dataclass(frozen=True)
class Card:
    """What a notebook shows of an object."""

    title: str  #: What it is; like all texts here as it stands, not yet escaped.
    rows: Sequence[Sequence[str]]  #: The table: in each row first what it tells.
    figure: Figure | None  #: The picture.
    headers: Sequence[str] = ()  #: Over the columns; none where a row is a name and a value.
    notes: Sequence[str] = ()  #: Sentences below the table.

    def html(self) -> str:
        """Return table and picture as HTML that loads and runs nothing."""
        # The classes keep MathJax from reading other people's names as formulas.
        return "\n".join(
            [
                '<div class="tex2jax_ignore mathjax_ignore">',
                self._table(),
                *(f"<p>{_text(note)}</p>" for note in self.notes),
                *([] if self.figure is None else [image(self.figure)]),
                "</div>",
            ]
        )

    def _table(self) -> str:
        head = "".join(f"<th{_LEFT}>{_text(name)}</th>" for name in self.headers)
        title = _text(self.title)
        lines = [
            "<table>",
            f'<caption style="caption-side:top;text-align:left"><b>{title}</b></caption>',
            *([f"<thead><tr>{head}</tr></thead>"] if head else []),
            "<tbody>",
        ]
        for name, *values in self.rows[:MOST_ROWS]:
            cells = "".join(f"<td{_LEFT}>{_text(value)}</td>" for value in values)
            lines.append(f"<tr><th{_LEFT}>{_text(name)}</th>{cells}</tr>")
        left = len(self.rows) - MOST_ROWS
        if left > 0:
            lines.append(f"<tr><th{_LEFT}>and {left} more</th></tr>")
        return "\n".join([*lines, "</tbody>", "</table>"])


def image(figure: Figure) -> str:
    """Return a figure as an image of HTML, with its description for those who do not see it."""
    from PIL import Image  # which matplotlib writes its PNGs with

    drawn = Image.open(BytesIO(figure.image(".png", LIGHT))).convert("RGB")
    light = BytesIO()
    drawn.quantize(256, dither=Image.Dither.NONE).save(light, "PNG", optimize=True)
    picture = base64.b64encode(light.getvalue()).decode()
    return (
        f'<img style="max-width:100%;width:{100 * WIDTH:.0f}px;background:#fff"'
        f' alt="{escape(one_line(figure.description()))}"'
        f' src="data:image/png;base64,{picture}">'
    )


def _text(text: str) -> str:
    line = one_line(text)
    return escape(line if len(line) <= LONGEST else f"{line[: LONGEST - 3]}...")


def value(number: Any, unit: str, digits: int = 4) -> str:
    """Print a value with its unit for a table; a dash where there is none."""
    return typeset(figure(number, unit, digits))


SPAN = ("from", "to", "rms")  #: Heads of what `spread` returns.


def spread(values: Any, unit: str) -> list[str]:
    """Return least and greatest of what is known of a signal, and its root mean square."""
    known = values[np.isfinite(values)]
    if not known.size:
        return ["–"] * len(SPAN)
    ends = (known.min(), known.max(), np.sqrt(np.mean(known**2)))
    return [value(float(end), unit) for end in ends]


def settings_card(
    of: Any, more: Sequence[Sequence[str]] = (), figure: Figure | None = None
) -> Card:
    """Describe what stands in a file by what it sets, its parts one below the other."""
    rows = [("", ", ".join(settings_of(of, value)))]
    for name, values in of.tables().items():
        part = getattr(of, name, values)
        for item in part if isinstance(part, tuple) else (part,):
            if isinstance(item, BaseModel):
                label = " ".join(filter(None, (name.replace("_", " "), getattr(item, "name", ""))))
                rows.append((label, ", ".join(settings_of(item, value))))
    title = getattr(of, "name", "") or type(of).__name__
    notes = [text for text in (getattr(of, "description", ""),) if text]
    return Card(title, [*(row for row in rows if row[1]), *more], figure, notes=notes)


def card_of(result: Stated) -> Card:
    """Describe a result by its first table."""
    first = next(tables(result, verbose=False), table("", [], []))
    rows = [[*map(typeset, cells)] for cells in first.rows]
    return Card(result.finding, rows, next(iter(result.figures()), None), first.headers)
