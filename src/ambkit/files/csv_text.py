"""CSV with units in its header: exact both ways, and clear about what is wrong where.

::

    # bearing: "zittau_axial"
    # rows: 2
    t [s],y [m]
    0.0,1.5e-05
    0.001,

Lines that start with ``#`` hold what else is known, ``# key: JSON``. An empty cell is a missing
sample. Each number is written with as many digits as it takes to read back exactly the same. That
is what ambkit writes; it reads what other programs write, too (`csv_dialect`).
"""

import io
import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.errors import RecordError, shortened
from ambkit.files import csv_dialect
from ambkit.files.csv_dialect import MISSING, Dialect, number_of
from ambkit.files.log import Log, column_names

Array = NDArray[np.float64]

_NOTE = re.compile(r"#\s*([\w.-]+):\s(.*)")
_UNEVEN_LINE_ENDS = re.compile(r"\r\n?")


def dump(columns: Mapping[str, Array], units: Mapping[str, str], meta: Mapping[str, str]) -> str:
    """Return the text of a CSV.

    Parameters
    ----------
    columns : mapping of str to ndarray (n,)
        The columns; NaN becomes an empty cell.
    units : mapping of str to str
        The unit of each.
    meta : mapping of str to str
        JSON by key. The number of rows is added, so that a file cut short is noticed.
    """
    rows = len(next(iter(columns.values())))
    notes = [f"# {key}: {value}" for key, value in {**meta, "rows": rows}.items()]
    header = ",".join(f"{name} [{units[name]}]" for name in columns)
    cells = [map(_cell, values.tolist()) for values in columns.values()]
    return "\n".join([*notes, header, *map(",".join, zip(*cells, strict=True))]) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def read(
    path: str | os.PathLike[str],
    wanted: Collection[str | int] | None = None,
    told: Callable[[str], object] = lambda _: None,
    lenient: bool = False,
) -> Log:
    """Read a text file with columns; see `ambkit.files.log.read_log`."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    text, encoding = _decode(content, os.fspath(path))
    return parse(text, os.fspath(path), wanted, [encoding] if encoding else [], lenient=lenient)


def _decode(content: bytes, name: str) -> tuple[str, str]:
    """Return the text, and its encoding if that is not UTF-8."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", "replace"), "UTF-16"
    if b"\0" in content[:4096]:
        raise RecordError(f"{name}: is not text; what is it?")
    try:
        return content.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def parse(
    text: str,
    name: str,
    wanted: Collection[str | int] | None = None,
    remarks: Collection[str] = (),
    *,
    lenient: bool = False,
) -> Log:
    """Read the columns of a text.

    Parameters
    ----------
    text : str
        The text.
    name : str
        What the messages call the file.
    wanted : collection of str or int, optional
        Read these columns alone, by name or place; the others may then hold anything.
    remarks : collection of str
        What is known about the file already.
    lenient : bool
        Leave out columns that hold no numbers.

    Raises
    ------
    RecordError
        Cells are no numbers, lines have too few or too many cells, a column is not there, or the
        file is shorter than it says itself; the message has each with its line.
    """
    # Not str.splitlines: that also breaks at characters which a note may hold, U+0085 for one.
    text = _UNEVEN_LINE_ENDS.sub("\n", text) if "\r" in text else text
    head = text[: _end_of_line(text, csv_dialect.LOOKED_AT)].split("\n")
    dialect = csv_dialect.find(head)
    if dialect is None:
        raise RecordError(f"{name}: has no header and no samples; is the file cut short?")
    meta = dict(_notes(head[: dialect.body]))
    names = _names(dialect)
    chosen = column_names(names, wanted, f"{name}:{(dialect.header or 0) + 1}")
    if lenient and len(dialect.numeric) < len(names):
        left = [each for place, each in enumerate(names) if place not in dialect.numeric]
        remarks = [*remarks, f"columns without numbers are not read: {', '.join(left)}"]
        chosen = [each for each in chosen if each not in left]
    start = _end_of_line(text, dialect.body) + 1 if dialect.body else 0
    body = text[start:]
    columns = _read_fast(body, names, chosen, dialect)
    if columns is None:
        columns = _read_slow(body, names, chosen, dialect, (name, dialect.body + 1))
    rows = len(columns[chosen[0]]) if chosen else 0
    said = meta.pop("rows", None)
    end = f"{name}:{text.count(chr(10)) + (not text.endswith(chr(10)))}: the file is cut short"
    if said is not None and said != rows:
        raise RecordError(f'{end}: it has {rows} rows, and says "# rows: {said}"')
    if said is not None and not text.endswith("\n"):
        raise RecordError(f"{end}: its last line has no end")
    unusual = dialect.in_words()
    return Log(
        name,
        columns,
        {k: u for k, u in zip(names, dialect.units, strict=True) if u is not None and k in columns},
        meta=meta,
        order=tuple(names),
        remarks=(*remarks, *([unusual] if unusual else [])),
        line_of=_lines(body, dialect.body + 1),
        header=0 if dialect.header is None else dialect.header + 1,
    )


def _end_of_line(text: str, count: int) -> int:
    """Return where the line number `count`, from 1, ends."""
    end = -1
    for _ in range(count):
        end = text.find("\n", end + 1)
        if end < 0:
            return len(text)
    return end


def _notes(lines: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield key and value of each note; a program that does not write JSON means its text."""
    for match in filter(None, map(_NOTE.fullmatch, lines)):
        key, text = match.groups()
        try:
            yield key, json.loads(text)
        except json.JSONDecodeError:
            yield key, text


def _lines(body: str, first: int) -> Callable[[int], int]:
    """Return what gives the line of a sample: empty lines hold none."""

    def line_of(sample: int) -> int:
        if "\n\n" not in body and not body.startswith("\n"):
            return first + sample
        filled = (n for n, line in enumerate(body.split("\n")) if line.strip())
        return first + next(n for k, n in enumerate(filled) if k == sample)

    return line_of


def _names(dialect: Dialect) -> list[str]:
    """Return a name for each column: where it has none, or shares it, its place from 0."""
    if not dialect.names:
        return [str(place) for place in range(dialect.width)]
    count = Counter(dialect.names)
    return [
        name if name and count[name] == 1 else f"{name}#{place}"
        for place, name in enumerate(dialect.names)
    ]


def _read_fast(
    body: str, names: list[str], chosen: list[str], dialect: Dialect
) -> dict[str, Array] | None:
    """Read with Arrow's parser; None where the text is not plain enough for it."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    if dialect.separator == " ":
        return None
    # Arrow counts what follows the separator at a line's end as a column.
    places = [f"{name}#{place}" for place, name in enumerate([*names, *[""] * dialect.closed])]
    read = {name: places[names.index(name)] for name in chosen}
    missing = [cell for cell in MISSING if cell]
    try:
        table = arrow.read_csv(
            io.BytesIO(body.encode()),
            arrow.ReadOptions(column_names=places),
            arrow.ParseOptions(delimiter=dialect.separator),
            arrow.ConvertOptions(
                column_types=dict.fromkeys(read.values(), pa.float64()),
                null_values=["", *missing],
                include_columns=list(read.values()),
                decimal_point=dialect.decimal,
            ),
        )
    except pa.ArrowInvalid:
        return None
    return {
        name: np.asarray(table.column(place).to_numpy(), dtype=np.float64)
        for name, place in read.items()
    }


def _read_slow(
    body: str, names: list[str], chosen: list[str], dialect: Dialect, place: tuple[str, int]
) -> dict[str, Array]:
    """Read cell by cell, and say where one is wrong."""
    file, first = place
    columns: dict[str, list[float]] = {name: [] for name in chosen}
    problems: list[str] = []
    lines = body.removesuffix("\n").split("\n")
    for n, text in enumerate(lines):
        if not text.strip():
            continue
        row, line = dialect.cells(text), f"{file}:{first + n}"
        if len(row) != len(names):
            hint = "; is the file cut short?" if n == len(lines) - 1 else ""
            problems.append(f"{line}: has {len(row)} cells instead of {len(names)}{hint}")
            continue
        cells = dict(zip(names, row, strict=True))
        for name in chosen:
            number = number_of(cells[name], dialect.decimal)
            if number is None:
                problems.append(f"{line}: column {name}: {cells[name]!r} is not a number")
            columns[name].append(math.nan if number is None else number)
    if problems:
        raise RecordError(shortened(problems), file)
    return {name: np.array(values) for name, values in columns.items()}
