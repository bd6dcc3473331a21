"""What a command prints and writes: results on stdout, all else on stderr, files at the end."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import escaping
from ambkit.base.progress import progress as progress

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from ambkit.judge.adequacy import Finding

File = tuple[Path | None, Callable[[Path], object]]

written: list[Path] = []
"""The files that this call has written so far, for the message when it is interrupted."""

_said: list[str] = []


@contextmanager
def interrupted_says(text: str) -> Iterator[None]:
    """Where a command is interrupted within this, let it say so.

    Parameters
    ----------
    text : str
        What is left, and how it goes on.
    """
    _said.append(text)
    yield
    _said.pop()


def left_by_interrupt() -> str | None:
    """Return what an interrupted command said that it leaves; None where it said nothing."""
    return _said.pop() if _said else None


def deliver(
    data: Any, tables: Iterable[Table | str], files: Sequence[File] = (), *, as_json: bool
) -> None:
    """Write the files, print the results, and say where the files are.

    Parameters
    ----------
    data : Any
        The results as plain data, in SI; a mapping is printed with its ``files``.
    tables : iterable of Table or str
        The same for humans; only drawn if they are to be seen.
    files : sequence of (Path or None, callable)
        Each path that the user asked for, and what writes it.
    as_json : bool
        Print `data` and not `tables`.
    """
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
            console.print(table)


def stdout() -> Console:
    """Return rich's view of stdout, such that a pipe gets whole lines."""
    from rich.console import Console

    # A pipe has no width; rich would fold tables at 80 columns.
    return Console(width=None if sys.stdout.isatty() else 160, highlight=False, markup=False)


def say_adequacy(found: Iterable[Finding], name: str = "") -> list[dict[str, Any]]:
    """Say on stderr what is wrong with a filter, and return all findings as plain data.

    Parameters
    ----------
    found : iterable of Finding
        From :func:`ambkit.judge.adequacy.judge_adequacy`.
    name : str
        Of the filter; empty where there is but one.
    """
    from ambkit.judge.adequacy import sentences

    found = list(found)
    for text in sentences(found):
        note(f"{name}: {text}" if name else text)
    return [each.to_dict() for each in found]


def note(text: str) -> None:
    """Say something on stderr; where nobody can hear it, nothing is left to be done."""
    with suppress(OSError):
        print(escaping.lines(text), file=sys.stderr)


def table(
    title: str, headers: Sequence[str], rows: Iterable[Sequence[str]], *, wide: bool = False
) -> Table:
    """Build a table whose first column names its rows.

    Parameters
    ----------
    title : str
        Heading.
    headers : sequence of str
        Heads of the columns.
    rows : iterable of sequence of str
        The cells.
    wide : bool
        The last column holds sentences.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    drawn = Table(
        title=Text(escaping.lines(title), style="bold"),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_header=any(headers),
        pad_edge=False,
    )
    for place, header in enumerate(headers):
        words = wide and place == len(headers) - 1
        drawn.add_column(
            Text(escaping.lines(header)), justify="left" if place == 0 or words else "right"
        )
    for row in rows:
        drawn.add_row(*(Text(escaping.lines(cell)) for cell in row))
    return drawn


def value(number: float | None, unit: str, digits: int = 4, like: float | None = None) -> str:
    """Print a value in SI as an engineer writes it; a dash where there is none.

    The error of a value, or what it is compared with, takes the value's prefix: `like`.
    """
    from ambkit.base.units import engineering

    if number is None or not math.isfinite(number):
        return "–"
    return engineering(number, unit, digits=digits, like=like)


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
