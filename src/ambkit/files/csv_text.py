"""CSV with units in its header: exact both ways, and clear about what is wrong where.

::

    # bearing: "zittau_axial"
    # rows: 2
    t [s],y [m]
    0.0,1.5e-05
    0.001,

Lines that start with ``#`` hold what else is known, ``# key: JSON``. An empty cell is a missing
sample. Each number is written with as many digits as it takes to read back exactly the same.
"""

import csv
import io
import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.errors import RecordError

Array = NDArray[np.float64]

_MISSING = ("", "nan", "NaN", "NA")
_NOTE = re.compile(r"#\s*([\w.-]+):\s(.*)")
_LINE_END = re.compile(r"\r\n|\r|\n")
_LABEL = re.compile(r"(.*?)\s*(?:[\[(]([^\])]*)[\])])?")


class CsvText(NamedTuple):
    """What a CSV says; `line` (from 1) is that of its header."""

    columns: dict[str, Array]
    units: dict[str, str | None]
    meta: dict[str, Any]
    line: int


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


def parse(text: str, name: str, wanted: Collection[str] = ()) -> CsvText:
    """Read a CSV with comma, semicolon or tab between its cells.

    Parameters
    ----------
    text : str
        The text.
    name : str
        What the messages call the file.
    wanted : collection of str
        Read these columns alone; the others may then hold anything.

    Raises
    ------
    RecordError
        A cell is not a number, a line has too few or too many cells, a column is there twice or
        not at all, or the file is shorter than it says itself.
    """
    # Not str.splitlines: that also breaks at characters which a note may hold, U+0085 for one.
    lines = _LINE_END.split(text.removesuffix("\n"))
    start = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), None)
    if start is None:
        raise RecordError(f"{name}: has no header and no samples; is the file cut short?")
    meta = dict(_notes(lines[:start]))
    delimiter = max(",;\t", key=lines[start].count)
    labels = next(csv.reader([lines[start]], delimiter=delimiter))
    units = dict(map(_label, labels))
    chosen = list(wanted or units)
    _check_header(labels, units, chosen, f"{name}:{start + 1}")
    body = lines[start + 1 :]
    columns = _read_fast(body, list(units), chosen, delimiter)
    if columns is None:
        columns = _read_slow(body, list(units), chosen, delimiter, (name, start + 2))
    rows = len(columns[chosen[0]])
    said = meta.pop("rows", None)
    end = f"{name}:{len(lines)}: the file is cut short"
    if said is not None and said != rows:
        raise RecordError(f'{end}: it has {rows} rows, and says "# rows: {said}"')
    if said is not None and not text.endswith("\n"):
        raise RecordError(f"{end}: its last line has no end")
    return CsvText(columns, {key: units[key] for key in chosen}, meta, start + 1)


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _notes(lines: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield key and value of each note; a program that does not write JSON means its text."""
    for match in filter(None, map(_NOTE.fullmatch, lines)):
        key, text = match.groups()
        try:
            yield key, json.loads(text)
        except json.JSONDecodeError:
            yield key, text


def _label(label: str) -> tuple[str, str | None]:
    """Split ``"y [mm]"`` into the name and the unit, None without one."""
    match = _LABEL.fullmatch(label.strip())
    return (match[1], match[2]) if match else (label.strip(), None)


def _check_header(
    labels: list[str], units: dict[str, str | None], chosen: list[str], place: str
) -> None:
    if all(_is_number(label) for label in labels):
        raise RecordError(f"{place}: has numbers where the header should be, such as t [s],y [mm]")
    if len(units) != len(labels) or "" in units:
        raise RecordError(f"{place}: two columns have the same name, or one has none")
    lacking = [name for name in chosen if name not in units]
    if lacking:
        raise RecordError(f"{place}: has no column {lacking[0]}; it has {', '.join(units)}")


def _read_fast(
    body: list[str], names: list[str], chosen: list[str], delimiter: str
) -> dict[str, Array] | None:
    """Read with Arrow's parser; None where the text is not plain enough for it."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    try:
        table = arrow.read_csv(
            io.BytesIO("\n".join(body).encode()),
            arrow.ReadOptions(column_names=names),
            arrow.ParseOptions(delimiter=delimiter),
            arrow.ConvertOptions(
                column_types=dict.fromkeys(chosen, pa.float64()),
                null_values=_MISSING,
                include_columns=chosen,
            ),
        )
    except pa.ArrowInvalid:
        return None
    return {name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in chosen}


def _read_slow(
    body: list[str], names: list[str], chosen: list[str], delimiter: str, place: tuple[str, int]
) -> dict[str, Array]:
    """Read cell by cell, and say where one is wrong."""
    file, first = place
    columns: dict[str, list[float]] = {name: [] for name in chosen}
    reader = csv.reader(body, delimiter=delimiter)
    for row in filter(None, reader):
        line = f"{file}:{first + reader.line_num - 1}"
        if len(row) != len(names):
            hint = "; is the file cut short?" if reader.line_num == len(body) else ""
            raise RecordError(f"{line}: has {len(row)} cells instead of {len(names)}{hint}")
        cells = dict(zip(names, map(str.strip, row), strict=True))
        for name in chosen:
            if cells[name] not in _MISSING and not _is_number(cells[name]):
                raise RecordError(f"{line}: column {name}: {cells[name]!r} is not a number")
            columns[name].append(math.nan if cells[name] in _MISSING else float(cells[name]))
    return {name: np.array(values) for name, values in columns.items()}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
