"""Output of a command: results on stdout, everything else on stderr, files at the end."""

from __future__ import annotations

import codecs
import io
import json
import logging
import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import escaping
from ambkit.result.result import plain
from ambkit.result.tables import Table

if TYPE_CHECKING:
    from rich.console import Console

    from ambkit.base.errors import AmbkitError
    from ambkit.result.result import Result

File = tuple[Path, Callable[[Path], object]]

written: list[Path] = []  #: Files written so far, for the message of an interrupt.


def deliver(
    data: Any, tables: Iterable[Table | str], files: Sequence[File] = (), *, as_json: bool
) -> None:
    """Write the files, print the results, and report the files."""
    for path, write in files:
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


def deliver_document(result: Any, files: Sequence[File], *, as_json: bool) -> int:
    """Write the files of a result without figures, print it, and return the exit code."""
    sentence = getattr(result, "finding", None)
    deliver(result.to_dict(), [] if sentence is None else [sentence], files, as_json=as_json)
    if not as_json and sentence is None and not files:
        print(str(result), end="")
    for text in getattr(result, "notes", ()):
        note(text)
    return getattr(result, "exit_code", 0)


def draw_refused(error: AmbkitError, plots: Sequence[Path]) -> None:
    """Plot the defects of a rejected log."""
    if not plots:
        return
    from ambkit.data.reading.reading_figure import refused_figure
    from ambkit.data.reading.rejections import RejectedLog

    if not isinstance(error, RejectedLog):
        return
    figure = refused_figure(error)
    for path in plots:
        if figure is None:
            note(f"{path} is not written: there is nothing to be drawn")
            continue
        figure.save(path)
        note(f"wrote {path}: what could be read, and where the trouble is; no record is written")


def on_screen(result: Result, *, verbose: bool) -> Iterator[Table | str]:
    """Yield the content for a terminal: finding, tables, notes."""
    from ambkit.result.tables import remarks, tables

    yield f"{result.finding}\n"
    yield from tables(result, verbose=verbose)
    yield from remarks(result, verbose=verbose)
    hidden = 0 if verbose else sum(row.detail for row in result.rows)
    if hidden:
        yield f"--verbose shows {hidden} more row{'s' * (hidden > 1)}."


def show(tables: Iterable[Table | str]) -> None:
    """Print tables on stdout."""
    console = stdout()
    # rich would exit with 1 when the reader has gone; it flushes stdout with each capture, too.
    with console.capture() as text:
        for item in tables:
            if isinstance(item, str):
                console.print(filled(item), soft_wrap=True)
            else:
                console.print(item, crop=False)
    sys.stdout.write(text.get())


def filled(text: str) -> str:
    """Return a text wrapped to the width of the screen, with complete words."""
    lines = escaping.lines(text).split("\n")
    fill = partial(textwrap.fill, break_long_words=False, break_on_hyphens=False)
    return "\n".join(fill(line, stdout().width) for line in lines)


def stdout() -> Console:
    """Return rich's console for stdout: as wide as the terminal, 80 columns in a pipe."""
    from rich.console import Console

    return Console(width=shutil.get_terminal_size().columns, highlight=False, markup=False)


def say_adequacy(result: Result) -> None:
    """State on stderr why filters are inadequate."""
    from ambkit.judge.adequacy import sentences

    judged = getattr(result, "adequacy", ())
    for name, findings in judged.items() if isinstance(judged, Mapping) else (("", judged),):
        for text in sentences(list(findings)):
            note(f"{name}: {text}" if name else text)


def note(text: str) -> None:
    """Print a note on stderr; if that is closed, do nothing."""
    with suppress(OSError):
        print(escaping.lines(text), file=sys.stderr)


class Notes(logging.Handler):
    """Prints the library's notes."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print it."""
        note(record.getMessage())


def heed_notes() -> None:
    """Print the library's notes on stderr."""
    notes = logging.getLogger("ambkit")
    if not notes.handlers:
        notes.addHandler(Notes())
        notes.propagate = False


_PLAIN = {
    "µ": "u", "μ": "u", "Ω": "Ohm", "°": "deg", "±": "+/-", "²": "^2", "³": "^3", "×": "x",
    "·": " ", "–": "-", "—": "-", "−": "-", "…": "...", "≤": "<=", "≥": ">=", "→": "->",
    "∞": "inf", "√": "sqrt", "σ": "sigma", "\u00a0": " ", "“": '"', "”": '"', "‘": "'", "’": "'",
}  # fmt: skip
"""ASCII notation of engineers; for units as in `ambkit.base.units`."""


def prepare() -> None:
    """Prepare stdin, stdout and stderr."""
    # A closed stream becomes the null device: its output is unwanted, and no file may get its
    # number. Characters that a stream cannot encode are transliterated.
    codecs.register_error("spelt", _spelt)
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:
            null = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115 - as long as we run
            setattr(sys, name, null)
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="spelt")


def _spelt(error: UnicodeError) -> tuple[str, int]:
    """Write characters that an encoding lacks in ASCII; others as TOML and JSON escape them."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letters = error.object[error.start : error.end]
    return "".join(_PLAIN.get(letter) or _escaped(ord(letter)) for letter in letters), error.end


def _escaped(code: int) -> str:
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a file name that is no text
        return f"\\x{code - 0xDC00:02x}"
    return f"\\u{code:04x}" if code <= 0xFFFF else f"\\U{code:08x}"
