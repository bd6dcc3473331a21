"""CSV with units in its header: lossless, and with precise error messages.

    t [s],y [m],"# {""bearing"": ""zittau_axial"", ""rows"": 2}"

The last cell of the header is metadata in JSON; lines ``# key: JSON`` above it are also read. An
empty cell is a missing sample. Numbers are written with as many digits as reading back exactly
requires.
"""

import csv
import io
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from decimal import Decimal, InvalidOperation
from typing import Any, NamedTuple

import numpy as np

from ambkit.base import memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, shortened
from ambkit.base.escaping import one_line
from ambkit.data.files import csv_dialect
from ambkit.data.files.csv_dialect import MISSING, Dialect, number_of
from ambkit.data.files.log import (
    DamagedLog,
    Log,
    Request,
    column_names,
    counted_from,
    noted,
    too_coarse,
)

_KEY = re.compile(r"[^\w.-]")  # characters that no key of a note has
_NOTE = re.compile(r"#\s*([\w.-]+):\s(.*)")
_NOTES = re.compile(r'(.+),"# (\{.*\})"')
_COMMENTS_AT_END = re.compile(r"(?:\n+[#%].*)+\n*\Z")
_UNEVEN_LINE_ENDS = re.compile(r"\r\n?")
_MINUS = re.compile("\N{MINUS SIGN}(?=[\\d.,])")  # as printed by some programs
_LABEL = re.compile(r"(?:^|(?<=[,;|\s]))([^\W\d][^,;|:=\t]*?)[ \t]*[:=][ \t]*(?=[-+.\d])")
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:[.,' \u00a0\u202f]\d{3})+(?:[.,]\d*)?")
_EITHER_DECIMAL = re.compile(r"[+-]?\d*[.,]\d+(?:[eE][+-]?\d+)?")


def dump(columns: Mapping[str, Array], units: Mapping[str, str], meta: Mapping[str, str]) -> str:
    """Return the text of a CSV."""
    known = {**meta, "rows": len(next(iter(columns.values())))}
    notes = ", ".join(f'"{_KEY.sub("_", key)}": {value}' for key, value in known.items())
    quoted = notes.replace('"', '""')
    header = ",".join(_head(f"{name} [{units[name]}]") for name in columns)
    header += f',"# {{{quoted}}}"'
    cells = [
        ["" if math.isnan(value) else repr(value) for value in values.tolist()]
        for values in columns.values()
    ]
    return "\n".join([header, *map(",".join, zip(*cells, strict=True))]) + "\n"


def _head(label: str) -> str:
    """Escape a column's name, so that it is neither several columns nor a note."""
    label = one_line(label)
    quoted = label.replace('"', '""')
    return f'"{quoted}"' if re.search(r'[,;"#]', label) else label


def read(path: str, request: Request) -> Log:
    """Read a text file with columns; see `ambkit.data.files.tables.read_log`."""
    try:
        content = memory_limit.read_bytes(path, memory_limit.TEXT_SHARE)
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    text, encoding = _decode(content, path)
    return parse(text, path, request, [encoding] if encoding else [])


def _decode(content: bytes, name: str) -> tuple[str, str]:
    """Return the text, and its encoding if that is not UTF-8."""
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", "replace"), "UTF-16"
    head = content[:4096]
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):  # without a byte order mark
        if head[first::2].count(0) > 0.45 * len(head) > 20 * head[1 - first :: 2].count(0):
            return content.decode(encoding, "replace"), "UTF-16"
    if b"\0" in head:
        raise RecordError(f"{name}: is not text; what is it?")
    try:
        return content.decode("utf-8-sig"), ""
    except UnicodeDecodeError:
        encoding, name = _national(content)
        return content.decode(encoding), name


def _national(content: bytes) -> tuple[str, str]:
    """Return codec and name of an encoding older than Unicode."""
    # Accents stand between ASCII letters, those of other scripts next to each other.
    letters = b"".join(re.findall(rb"[\x80-\xff][\x40-\xff]*[\x80-\xff]", content[:65536]))
    others = [("gb2312", "GB 2312"), ("cp932", "Shift JIS")]
    if min((letter for letter in letters if letter > 0x7F), default=0) >= 0xC0:
        is_cyrillic = re.search(rb"[\xc0-\xff]{4}", content)
        others = [("cp1251", "Windows-1251")] if is_cyrillic else []
    for codec, name in others if letters else ():
        with suppress(UnicodeDecodeError):
            if not re.search(r"[A-Za-z][^\x00-\x7f][a-z]|[\ue000-\uf8ff]", content.decode(codec)):
                return codec, name
    if re.search(rb"[\x80-\x9f]", content):  # no letters of Latin-1
        with suppress(UnicodeDecodeError):
            content.decode("cp1252")
            return "cp1252", "Windows-1252"
    return "latin-1", "Latin-1"


_Columns = tuple[dict[str, Any], list[str], dict[int, list[str]]]
"""Columns, remarks on their reading, and errors by sample."""


class _Body(NamedTuple):
    """The lines with the samples, and their columns."""

    text: str
    first: int  #: First line in the file, from 1.
    dialect: Dialect
    names: list[str]  #: Of all columns.
    chosen: list[str]  #: Columns to read.
    stamps: Collection[str]  #: Columns with times as text.


def parse(
    text: str,
    name: str,
    request: Request,
    remarks: list[str],
    separators: Sequence[str] = tuple(csv_dialect.SEPARATORS),
) -> Log:
    """Parse the columns of a text."""
    # Not str.splitlines, which also splits at characters of notes, such as U+0085.
    text = _UNEVEN_LINE_ENDS.sub("\n", text) if "\r" in text else text
    text = _MINUS.sub("-", text) if "\N{MINUS SIGN}" in text else text
    text, known = _without_notes(text)
    text = _COMMENTS_AT_END.sub("\n", text)
    text, labels = _without_labels(text)
    _check_quotes(text, name)
    head = text[: _end_of_line(text, csv_dialect.LOOKED_AT)].split("\n")
    dialect = csv_dialect.find(head, separators)
    if dialect is None:
        raise RecordError(f"{name}: has no header and no samples; is the file cut short?")
    if len(labels) == dialect.width:
        names_, units = zip(*map(csv_dialect.label, labels), strict=True)
        dialect = dialect._replace(names=names_, units=units)
    notes = filter(None, map(_NOTE.fullmatch, head[: dialect.body]))
    meta = known | {note[1]: noted(note[2]) for note in notes}
    names = _names(dialect)
    header = f"{name}:{(dialect.header or 0) + 1}"
    chosen = column_names(names, request.columns, header)
    stamps = {*(names[k] for k in dialect.stamps), *column_names(names, request.texts, header)}
    if request.lenient and (left := _without_numbers(names, stamps, dialect, head)):
        remarks.append(f"columns without numbers are not read: {', '.join(left.values())}")
        chosen = [item for item in chosen if item not in left]
    start = _end_of_line(text, dialect.body) + 1 if dialect.body else 0
    body = _Body(text[start:], dialect.body + 1, dialect, names, chosen, stamps)
    columns, counted, problems = _read_fast(body) or _read_slow(body, name)
    rows = len(columns[chosen[0]]) if chosen else 0
    stamped = {item: columns.pop(item) for item in chosen if item in stamps}
    if unusual := dialect.describe():
        remarks.append(unusual)
    remarks += counted
    is_cut = not text.endswith("\n")
    if rows and is_cut:
        remarks.append("the last line has no end: its last number may be cut short")
    row_count = meta.pop("rows", None)
    log = Log(
        name,
        columns,
        {k: u for k, u in zip(names, dialect.units, strict=True) if u is not None and k in columns},
        meta=meta,
        order=tuple(names),
        remarks=tuple(remarks),
        line_of=_lines(body.text, body.first),
        head_text="\n".join(head[: dialect.body]),
        header=0 if dialect.header is None else dialect.header + 1,
        texts=stamped,
    )
    if problems:
        listed = [text for problem in problems.values() for text in problem]
        raise DamagedLog(shortened(listed), log, tuple(problems))
    if row_count is not None and (row_count != rows or is_cut):
        short = f"{name}:{text.count(chr(10)) + is_cut}: the file is cut short: "
        short += (
            f"it has {rows} rows, and says that it has {row_count}"
            if row_count != rows
            else "its last line has no end"
        )
        raise DamagedLog([short], log, (rows - 1,))
    return log


def _without_numbers(
    names: list[str], stamps: Collection[str], dialect: Dialect, head: list[str]
) -> dict[str, str]:
    """Return the columns with neither numbers nor times, each with its first cell."""
    row = next((dialect.cells(line) for line in head[dialect.body :] if line.strip()), [])
    cells = dict(zip(names, row, strict=False))
    numeric = {names[k] for k in dialect.numeric} | {*stamps}
    return {
        item: f"{item} ({cells.get(item, '')!r}{_hint(cells.get(item, ''))})"
        for item in names
        if item not in numeric
    }


def _without_notes(text: str) -> tuple[str, dict[str, Any]]:
    """Return a text without the notes at the end of its first line, and these."""
    first, end, rest = text.partition("\n")
    match = _NOTES.fullmatch(first)
    if match is None:
        return text, {}
    try:
        return match[1] + end + rest, dict(json.loads(match[2].replace('""', '"')))
    except (ValueError, RecursionError):  # a column with such a name
        return text, {}


def _without_labels(text: str) -> tuple[str, list[str]]:
    """Return lines such as ``pos:1.2,cur:3`` of a microcontroller without labels, and these."""
    lines = text.split("\n", 30)[:-1]
    labels: list[str] = _LABEL.findall(lines[-1]) if lines else []
    if len({*labels}) < max(2, len(labels)) or _LABEL.match(lines[-1]) is None:
        return text, []
    # What is above the numbers becomes a comment.
    count = next(n for n, line in enumerate(lines) if _LABEL.findall(line) == labels)
    *above, rest = text.split("\n", count)
    of_data = re.compile(rf"^{re.escape(labels[0])}[ \t]*[:=].*$", re.MULTILINE)
    rest = of_data.sub(lambda line: _LABEL.sub("", line[0]), rest)
    return "\n".join([*(f"# {line}" for line in above), rest]), labels


def _check_quotes(text: str, name: str) -> None:
    """Reject a quoted cell that is too long for Python's reader."""
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
    """Return the end of the line number `count`, from 1."""
    end = -1
    for _ in range(count):
        end = text.find("\n", end + 1)
        if end < 0:
            return len(text)
    return end


def _lines(body: str, first: int) -> Callable[[int], int]:
    """Return a function for the line of a sample: empty lines have none."""

    def line_of(sample: int) -> int:
        if "\n\n" not in body and not body.startswith("\n"):
            return first + sample
        filled = (n for n, line in enumerate(body.split("\n")) if line.strip())
        return first + next(n for k, n in enumerate(filled) if k == sample)

    return line_of


def _names(dialect: Dialect) -> list[str]:
    """Return a unique name for each column; by default its index from 0."""
    if not dialect.names:
        return [str(place) for place in range(dialect.width)]
    count = Counter(dialect.names)
    return [
        name if name and count[name] == 1 else f"{name}#{place}"
        for place, name in enumerate(dialect.names)
    ]


def _read_fast(body: _Body) -> _Columns | None:
    """Read with Arrow's parser; None if it is missing, or the text is not plain enough."""
    try:
        import pyarrow as pa
        from pyarrow import csv as arrow
    except ModuleNotFoundError:
        return None
    dialect = body.dialect
    if dialect.separator == " ":
        return None
    # Arrow counts the rest after a separator at a line's end as a column.
    places = [f"{name}#{place}" for place, name in enumerate([*body.names, *[""] * dialect.closed])]
    place_of = dict(zip(body.names, places, strict=False))
    read = {name: place_of[name] for name in body.chosen}

    def table(kinds: Mapping[str, Any]) -> Any:
        return arrow.read_csv(
            io.BytesIO(body.text.encode()),
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

    kinds = {
        place: pa.string() if name in body.stamps else pa.float64() for name, place in read.items()
    }
    try:
        result = table(kinds)
    except pa.ArrowInvalid:
        return None
    columns: dict[str, Any] = {}
    remarks: list[str] = []
    for name, place in read.items():
        if name in body.stamps:
            columns[name] = result.column(place).to_pylist()
            continue
        columns[name] = np.asarray(result.column(place).to_numpy(), dtype=np.float64)
        if too_coarse(columns[name]):
            with suppress(pa.ArrowInvalid):  # more digits than that, or an exponent
                exact = table({place: pa.decimal128(37, 9)}).column(place)
                columns[name], remark = _from_first(name, exact.to_pylist())
                remarks.append(remark)
    return columns, remarks, {}


def _from_first(name: str, exact: Sequence[Decimal]) -> tuple[Array, str]:
    """Return exact numbers relative to the first one, and a remark on that."""
    counted = np.array([float(number - exact[0]) for number in exact])
    return counted, counted_from(name, f"{exact[0]:f}".rstrip("0").rstrip("."))


def _read_slow(body: _Body, file: str) -> _Columns:
    """Read cell by cell, and report errors by sample."""
    _, first, dialect, names, chosen, stamps = body
    columns: dict[str, list[Any]] = {name: [] for name in chosen}
    problems: dict[int, list[str]] = {}
    lines = body.text.removesuffix("\n").split("\n")
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
    return results, remarks, problems


def _hint(cell: str) -> str:
    """Suggest the meaning of a cell that is no number."""
    if _THOUSANDS.fullmatch(cell):
        return ": are thousands set apart, or does the decimal sign differ?"
    return ": the decimal sign differs" if _EITHER_DECIMAL.fullmatch(cell) else ""
