"""What a command prints and writes: results on stdout, all else on stderr, files at the end."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ambkit.base import escaping
from ambkit.base.progress import progress as progress

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

    from ambkit.judge.adequacy_criteria import Finding

File = tuple[Path | None, Callable[[Path], object]]

GAP = 3
"""Columns of the screen between two columns of a table, and beside them."""

LINE = 24
"""Columns of the screen that names and sentences have in a table, if they need as many."""

written: list[Path] = []
"""The files that this call has written so far, for the message when it is interrupted."""

_said: list[str] = []


@contextmanager
def interrupted_says(text: str) -> Iterator[None]:
    """Where a command is interrupted within this, let it say so."""
    _said.append(text)
    yield
    _said.pop()


def left_by_interrupt() -> str | None:
    """Return what an interrupted command said that it leaves; None where it said nothing."""
    return _said.pop() if _said else None


def deliver(
    data: Any, tables: Iterable[Table | str], files: Sequence[File] = (), *, as_json: bool
) -> None:
    """Write the files, print the results, and say where the files are."""
    for path, write in files:
        if path is not None:
            write(path)
            written.append(path)
    if as_json:
        if isinstance(data, dict) and files:
            data = data | {"files": [str(path) for path in written]}
        text = escaping.json_text(plain(data), indent=2, allow_nan=False)
        if not sys.stdout.encoding.lower().startswith("utf"):
            text = "".join(c if c.isascii() else json.dumps(c)[1:-1] for c in text)
        print(text)
    else:
        show(tables)
    for path in written:
        note(f"wrote {path}")


def show(tables: Iterable[Table | str]) -> None:
    """Print tables on stdout."""
    console = stdout()
    for table in tables:
        if isinstance(table, str):
            console.print(escaping.lines(table), soft_wrap=True)
        else:
            console.print(table, crop=False)


def stdout() -> Console:
    """Return rich's view of stdout, such that a pipe gets whole lines."""
    from rich.console import Console

    # A pipe has no width; rich would fold tables at 80 columns.
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False, markup=False)


def say_adequacy(found: Iterable[Finding], name: str = "") -> list[dict[str, Any]]:
    """Say on stderr what is wrong with a filter, and return all findings as plain data."""
    from ambkit.judge.adequacy import sentences

    found = list(found)
    for text in sentences(found):
        note(f"{name}: {text}" if name else text)
    return [each.to_dict() for each in found]


def note(text: str) -> None:
    """Say something on stderr; where nobody can hear it, nothing is left to be done."""
    with suppress(OSError):
        print(escaping.lines(text), file=sys.stderr)


class Table(NamedTuple):
    """A table for humans, drawn as wide as there is room; no name and no number is cut."""

    title: str
    headers: list[str]
    rows: list[list[str]]
    wide: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
        """Draw it, in parts one below the other where its columns need more than the width."""
        from rich.text import Text

        yield Text(self.title, style="bold", overflow="ignore")
        columns = list(zip(self.headers, *self.rows, strict=True))
        widths = [
            _widths(cells, words=place == 0 or (self.wide and place == len(columns) - 1))
            for place, cells in enumerate(columns)
        ]
        for part in _parts([least for least, _ in widths], options.max_width):
            spread = _spread([widths[place] for place in part], options.max_width)
            yield self._drawn({place: columns[place] for place in part}, spread)

    def _drawn(self, columns: dict[int, tuple[str, ...]], widths: list[int]) -> Any:
        """Draw some of the columns, by their places, with these widths."""
        from rich import box, table
        from rich.text import Text

        drawn = table.Table(
            width=sum(widths) + GAP * len(widths) - 1,
            box=box.SIMPLE_HEAD,
            show_header=any(self.headers),
            pad_edge=False,
        )
        for (place, cells), width in zip(columns.items(), widths, strict=True):
            left = place == 0 or (self.wide and place == len(self.headers) - 1)
            head = Text(cells[0], overflow="fold")
            drawn.add_column(head, justify="left" if left else "right", width=width)
        for row in zip(*(cells[1:] for cells in columns.values()), strict=True):
            drawn.add_row(*(Text(cell, overflow="fold") for cell in row))
        return drawn


def table(
    title: str, headers: Sequence[str], rows: Iterable[Sequence[str]], *, wide: bool = False
) -> Table:
    """Build a table whose first column names its rows."""
    cells = [[escaping.lines(cell) for cell in row] for row in rows]
    return Table(escaping.lines(title), [escaping.lines(head) for head in headers], cells, wide)


def _widths(cells: Sequence[str], *, words: bool) -> tuple[int, int]:
    """Return the least width of a column that cuts nothing, and the width of its longest cell."""
    # A number stays with its unit; lines of `words` end between any two, but not too early.
    from rich.cells import cell_len

    least = [1]
    for cell in cells:
        number = not words and cell[:1] in set("0123456789+-−±–")
        least += map(cell_len, [cell] if number else cell.split())
    whole = max(1, *map(cell_len, cells))
    return max(*least, min(whole, LINE) if words else 1), whole


def _parts(least: Sequence[int], room: int) -> list[list[int]]:
    """Return the columns that fit beside each other, the first one in each part."""
    parts = [[0]]
    for place in range(1, len(least)):
        part = [*parts[-1], place]
        if len(parts[-1]) > 1 and sum(least[of] + GAP for of in part) - 1 > room:
            parts.append([0, place])
        else:
            parts[-1] = part
    return parts


def _spread(widths: Sequence[tuple[int, int]], room: int) -> list[int]:
    """Return each column's width between its least and its whole: those that lack most get more."""
    given = [least for least, _ in widths]
    lacks = [whole - least for least, whole in widths]
    for _ in range(min(sum(lacks), room + 1 - sum(given) - GAP * len(given))):
        most = max(range(len(lacks)), key=lacks.__getitem__)
        given[most] += 1
        lacks[most] -= 1
    return given


def value(number: Any, unit: str, digits: int = 4, like: float | None = None) -> str:
    """Print a value in SI as an engineer writes it; a dash where there is none."""
    from ambkit.base.units import figure

    return figure(number, unit, digits, like)


def plain(data: Any) -> Any:
    """Turn results into what JSON knows; what is not a finite number becomes null."""
    if isinstance(data, dict):
        return {str(key): plain(item) for key, item in data.items()}
    if isinstance(data, list | tuple):
        return [plain(item) for item in data]
    if hasattr(data, "tolist"):  # of NumPy, array or scalar
        return plain(data.tolist())
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    return str(data) if isinstance(data, Path) else data
