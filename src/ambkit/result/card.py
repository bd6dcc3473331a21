"""A small table and a figure, as HTML for a notebook."""

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

LONGEST = 300  #: Maximum characters of a cell or a note; a description may have thousands.
MOST_ROWS = 24  #: Maximum rows of a table; the number of the others is stated.
LIGHT = 110  #: Pixels per inch of a figure that is stored in a notebook.

_LEFT = ' style="text-align:left"'


@dataclass(frozen=True)
class Card:
    """Content of an object's card in a notebook."""

    title: str  #: Title; like all texts here not yet escaped.
    rows: Sequence[Sequence[str]]  #: The table, each row with its name first.
    figure: Figure | None  #: The figure.
    headers: Sequence[str] = ()  #: Column heads; none if rows are names and values.
    notes: Sequence[str] = ()  #: Sentences below the table.

    def html(self) -> str:
        """Return table and figure as HTML that loads and runs nothing."""
        # The classes keep MathJax from reading names as formulas.
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
    """Return a figure as an HTML image, with its description as alternative text."""
    from PIL import Image  # used by matplotlib for PNGs

    image = Image.open(BytesIO(figure.image(".png", LIGHT))).convert("RGB")
    light = BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(light, "PNG", optimize=True)
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
    """Format a value with its unit for a table; a dash if there is none."""
    return typeset(figure(number, unit, digits))


SPAN = ("from", "to", "rms")  #: Heads of the columns of `spread`.


def spread(values: Any, unit: str) -> list[str]:
    """Return minimum and maximum of the known values of a signal, and its root mean square."""
    known = values[np.isfinite(values)]
    if not known.size:
        return ["–"] * len(SPAN)
    ends = (known.min(), known.max(), np.sqrt(np.mean(known**2)))
    return [value(float(end), unit) for end in ends]


def settings_card(
    of: Any, more: Sequence[Sequence[str]] = (), figure: Figure | None = None
) -> Card:
    """Describe a file's object by its settings, part by part."""
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
