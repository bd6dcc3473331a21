"""CSV with units in its header: exact both ways, and clear about what is wrong where.

::

    t [s],y [m],"# {""bearing"": ""zittau_axial"", ""rows"": 2}"
    0.0,1.5e-05
    0.001,

The last cell of the header is no column: it holds what else is known, as JSON. ``pandas.read_csv``
takes such a file without options, with an empty column there. Files of before 0.3 have that in
lines before the header, ``# key: JSON``, and are read as well. An empty cell is a missing
sample. Each number is written with as many digits as it takes to read back exactly the same. That
is what ambkit writes; it reads what other programs write, too (`csv_dialect`).
"""

import csv
import io
import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from typing import Any

import numpy as np

from ambkit.base import memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, shortened
from ambkit.base.escaping import one_line
from ambkit.data.files import csv_dialect
from ambkit.data.files.csv_dialect import MISSING, Dialect, number_of
from ambkit.data.files.log import DamagedLog, Log, column_names, counted_from, too_coarse

_KEY = re.compile(r"[^\w.-]")  # what no key of a note has
_NOTE = re.compile(r"#\s*([\w.-]+):\s(.*)")
_NOTES = re.compile(r'(.+),"# (\{.*\})"')
_UNEVEN_LINE_ENDS = re.compile(r"\r\n?")
_MINUS = re.compile("\N{MINUS SIGN}(?=[\\d.,])")  # as some programs print it
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:[.,' \u00a0\u202f]\d{3})+(?:[.,]\d*)?")
_EITHER_DECIMAL = re.compile(r"[+-]?\d*[.,]\d+(?:[eE][+-]?\d+)?")


def dump(columns: Mapping[str, Array], units: Mapping[str, str], meta: Mapping[str, str]) -> str:
    """Return the text of a CSV."""
    known = {**meta, "rows": len(next(iter(columns.values())))}
    notes = ", ".join(f'"{_KEY.sub("_", key)}": {value}' for key, value in known.items())
    quoted = notes.replace('"', '""')
    header = ",".join(_head(f"{name} [{units[name]}]") for name in columns)
    header += f',"# {{{quoted}}}"'
    cells = [map(_cell, values.tolist()) for values in columns.values()]
    return "\n".join([header, *map(",".join, zip(*cells, strict=True))]) + "\n"


def _head(label: str) -> str:
    """Write a column's name such that it is one: not more columns, nor a note."""
    label = one_line(label)
    quoted = label.replace('"', '""')
    return f'"{quoted}"' if re.search(r'[,;"#]', label) else label


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def read(
    path: str | os.PathLike[str],
    selection: Collection[str | int] | None = None,
    progress: Callable[[str], object] = lambda _: None,
    lenient: bool = False,
    texts: Collection[str | int] = (),
) -> Log:
    """Read a text file with columns; see `ambkit.data.files.formats.read_log`."""
    try:
        content = memory_limit.read_bytes(path, memory_limit.TEXT_SHARE)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    text, encoding = _decode(content, os.fspath(path))
    remarks = [encoding] if encoding else []
    return parse(text, os.fspath(path), selection, remarks, lenient=lenient, texts=texts)


def _decode(content: bytes, name: str) -> tuple[str, str]:
    """Return the text, and its encoding if that is not UTF-8."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", "replace"), "UTF-16"
    head = content[:4096]
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):  # without a mark
        if head[first::2].count(0) > 0.45 * len(head) > 20 * head[1 - first :: 2].count(0):
            return content.decode(encoding, "replace"), "UTF-16"
    if b"\0" in head:
        raise RecordError(f"{name}: is not text; what is it?")
    try:
        return content.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        return content.decode("latin-1"), "Latin-1"


def parse(
    text: str,
    name: str,
    selection: Collection[str | int] | None = None,
    remarks: Collection[str] = (),
    *,
    lenient: bool = False,
    texts: Collection[str | int] = (),
) -> Log:
    """Read the columns of a text."""
    # Not str.splitlines: that also breaks at characters which a note may hold, U+0085 for one.
    text = _UNEVEN_LINE_ENDS.sub("\n", text) if "\r" in text else text
    text = _MINUS.sub("-", text) if "\N{MINUS SIGN}" in text else text
    text, known = _without_notes(text)
    _check_quotes(text, name)
    head = text[: _end_of_line(text, csv_dialect.LOOKED_AT)].split("\n")
    dialect = csv_dialect.find(head)
    if dialect is None:
        raise RecordError(f"{name}: has no header and no samples; is the file cut short?")
    meta = known | dict(_notes(head[: dialect.body]))
    names = _names(dialect)
    chosen = column_names(names, selection, f"{name}:{(dialect.header or 0) + 1}")
    header = f"{name}:{(dialect.header or 0) + 1}"
    stamps = {*(names[k] for k in dialect.stamps), *column_names(names, texts, header)}
    numeric = set(dialect.numeric)
    left = [
        item
        for place, item in enumerate(names)
        if lenient and place not in numeric and item not in stamps
    ]
    if left:
        row = next((dialect.cells(line) for line in head[dialect.body :] if line.strip()), [])
        cells = dict(zip(names, row, strict=False))
        descriptions = [
            f"{item} ({cells.get(item, '')!r}{_hint(cells.get(item, ''))})" for item in left
        ]
        remarks = [*remarks, f"columns without numbers are not read: {', '.join(descriptions)}"]
        dropped = set(left)
        chosen = [item for item in chosen if item not in dropped]
    start = _end_of_line(text, dialect.body) + 1 if dialect.body else 0
    body = text[start:]
    result = _read_fast(body, names, chosen, dialect, stamps)
    problems: dict[int, list[str]] = {}
    early: list[str] = []
    if result is not None:
        columns, early = result
    else:
        place = name, dialect.body + 1
        columns, problems, early = _read_slow(body, names, chosen, dialect, stamps, place)
    rows = len(columns[chosen[0]]) if chosen else 0
    stamped = {item: columns.pop(item) for item in chosen if item in stamps}
    unusual = dialect.in_words()
    if rows and not text.endswith("\n"):
        early.append("the last line has no end: its last number may be cut short")
    log = Log(
        name,
        columns,
        {k: u for k, u in zip(names, dialect.units, strict=True) if u is not None and k in columns},
        meta=meta,
        order=tuple(names),
        remarks=(*remarks, *([unusual] if unusual else []), *early),
        line_of=_lines(body, dialect.body + 1),
        header=0 if dialect.header is None else dialect.header + 1,
        texts=stamped,
    )
    row_count = meta.pop("rows", None)
    if problems:
        listed = [text for problem in problems.values() for text in problem]
        raise DamagedLog(shortened(listed), log, tuple(problems))
    end = f"{name}:{text.count(chr(10)) + (not text.endswith(chr(10)))}: the file is cut short"
    if row_count is not None and row_count != rows:
        short = f"{end}: it has {rows} rows, and says that it has {row_count}"
        raise DamagedLog([short], log, (rows - 1,))
    if row_count is not None and not text.endswith("\n"):
        raise DamagedLog([f"{end}: its last line has no end"], log, (rows - 1,))
    return log


def _without_notes(text: str) -> tuple[str, dict[str, Any]]:
    """Return a text without the notes at the end of its first line, and these."""
    first, end, rest = text.partition("\n")
    match = _NOTES.fullmatch(first)
    if match is None:
        return text, {}
    try:
        return match[1] + end + rest, dict(json.loads(match[2].replace('""', '"')))
    except (ValueError, RecursionError):  # it is a column of such a name
        return text, {}


def _check_quotes(text: str, name: str) -> None:
    """Refuse a cell in quotes that is longer than Python's reader of them takes."""
    limit = csv.field_size_limit()
    if '"' not in text:
        return
    for n, line in enumerate(text.split("\n")):
        if len(line) > limit and any(len(cell) > limit for cell in line.split('"')[1::2]):
            raise RecordError(
                f"{name}:{n + 1}: a cell in quotes has more than {limit} characters; is a quote "
                "missing?"
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
        except (ValueError, RecursionError):  # no JSON, a number too long, or nested too deeply
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
    body: str, names: list[str], chosen: list[str], dialect: Dialect, stamps: Collection[str]
) -> tuple[dict[str, Any], list[str]] | None:
    """Read with Arrow's parser; None where it is missing, or the text is not plain enough."""
    try:
        import pyarrow as pa
        from pyarrow import csv as arrow
    except ModuleNotFoundError:
        return None
    if dialect.separator == " ":
        return None
    # Arrow counts what follows the separator at a line's end as a column.
    places = [f"{name}#{place}" for place, name in enumerate([*names, *[""] * dialect.closed])]
    place_of = dict(zip(names, places, strict=False))
    read = {name: place_of[name] for name in chosen}

    def table(kinds: Mapping[str, Any]) -> Any:
        return arrow.read_csv(
            io.BytesIO(body.encode()),
            arrow.ReadOptions(column_names=places),
            arrow.ParseOptions(delimiter=dialect.separator),
            arrow.ConvertOptions(
                column_types=dict(kinds),
                null_values=sorted(MISSING),
                strings_can_be_null=True,
                include_columns=list(kinds),
                decimal_point=dialect.decimal,
            ),
        )

    kinds = {read[name]: pa.string() if name in stamps else pa.float64() for name in chosen}
    try:
        result = table(kinds)
    except pa.ArrowInvalid:
        return None
    columns: dict[str, Any] = {}
    remarks: list[str] = []
    for name, place in read.items():
        if name in stamps:
            columns[name] = result.column(place).to_pylist()
            continue
        columns[name] = np.asarray(result.column(place).to_numpy(), dtype=np.float64)
        if too_coarse(columns[name]):
            with suppress(pa.ArrowInvalid):  # more digits than that, or an exponent
                exact = table({place: pa.decimal128(37, 9)}).column(place)
                columns[name], remark = _from_first(name, exact.to_pylist())
                remarks.append(remark)
    return columns, remarks


def _from_first(name: str, exact: Sequence[Decimal]) -> tuple[Array, str]:
    """Return exact numbers counted from the first one, and a remark on that."""
    counted = np.array([float(number - exact[0]) for number in exact])
    return counted, counted_from(name, f"{exact[0]:f}".rstrip("0").rstrip("."))


def _read_slow(
    body: str,
    names: list[str],
    chosen: list[str],
    dialect: Dialect,
    stamps: Collection[str],
    place: tuple[str, int],
) -> tuple[dict[str, Any], dict[int, list[str]], list[str]]:
    """Read cell by cell, and say of each sample what is wrong with it."""
    file, first = place
    columns: dict[str, list[Any]] = {name: [] for name in chosen}
    problems: dict[int, list[str]] = {}
    lines = body.removesuffix("\n").split("\n")
    sample = -1
    for n, text in enumerate(lines):
        if not text.strip():
            continue
        sample += 1
        row, line = dialect.cells(text), f"{file}:{first + n}"
        if len(row) != len(names):
            hint = "; is the file cut short?" if n == len(lines) - 1 else ""
            if n == 0 and not dialect.names and dialect.separator == ",":
                hint = "; is the comma the separator and the decimal sign at once?"
            count = f"{len(row)} cell{'s' * (len(row) != 1)}"
            problems[sample] = [f"{line}: has {count} instead of {len(names)}{hint}"]
            row = [""] * len(names)
        cells = dict(zip(names, row, strict=True))
        for name in chosen:
            cell = cells[name]
            if name in stamps:
                columns[name].append(None if cell in MISSING else cell)
                continue
            number = number_of(cell, dialect.decimal)
            if number is None:
                what = f"{line}: column {name}: {cell!r} is not a number{_hint(cell)}"
                problems.setdefault(sample, []).append(what)
            columns[name].append(math.nan if number is None else number)
    results: dict[str, Any] = {}
    remarks: list[str] = []
    for name, values in columns.items():
        results[name] = values if name in stamps else np.array(values)
        if name in stamps or problems or not too_coarse(results[name]):
            continue
        at = names.index(name)
        written = (dialect.cells(text)[at].strip() for text in lines if text.strip())
        with suppress(InvalidOperation):
            exact = [Decimal(cell.replace(dialect.decimal, ".")) for cell in written]
            results[name], remark = _from_first(name, exact)
            remarks.append(remark)
    return results, problems, remarks


def _hint(cell: str) -> str:
    """Say what may be meant by a cell that is no number."""
    if _THOUSANDS.fullmatch(cell):
        return ": are thousands set apart, or does the decimal sign differ?"
    return ": the decimal sign differs" if _EITHER_DECIMAL.fullmatch(cell) else ""
