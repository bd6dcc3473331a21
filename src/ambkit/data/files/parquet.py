"""Parquet: columns with their units and notes, read column by column to limit the memory."""

import os
from collections import Counter
from collections.abc import Collection, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambkit.base import files, memory_limit
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, library
from ambkit.base.escaping import one_line
from ambkit.data.files.log import (
    Log,
    Request,
    check_readable,
    column_names,
    integers,
    library_errors,
    noted,
)
from ambkit.data.files.timestamps import layouts_of, unwrapped

if TYPE_CHECKING:
    from pyarrow import ChunkedArray, DataType, Field, Schema
    from pyarrow.parquet import FileMetaData, ParquetFile


_LESS = " a channel map that names fewer columns takes less;"


def _arrow(path: str | os.PathLike[str]) -> tuple[Any, Any]:
    """Return the modules that read and write Parquet."""
    pyarrow = library("pyarrow", f"{path}: a Parquet file", "parquet")
    return pyarrow, import_module("pyarrow.parquet")


def write(
    path: str | os.PathLike[str],
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    meta: Mapping[str, str],
) -> None:
    """Write columns (n,), the unit of each, and JSON by key, through a temporary file."""
    pa, parquet = _arrow(path)
    fields = [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns]
    schema = pa.schema(fields, metadata={f"ambkit.{key}": text for key, text in meta.items()})
    arrays = [pa.array(values, from_pandas=True) for values in columns.values()]
    with files.replacing(path) as temporary:
        parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), temporary)


def read(path: str, request: Request) -> Log:
    """Read the columns; see `ambkit.data.files.tables.read_log`."""
    check_readable(path)
    pa, parquet = _arrow(path)
    columns: dict[str, Array] = {}
    remarks: list[str] = []
    stamped: dict[str, Any] = {}
    with library_errors(path), parquet.ParquetFile(path, memory_map=True) as file:
        schema = file.schema_arrow
        places = _places(schema.names)
        duplicates = sorted({*places} - {*map(one_line, schema.names)})
        if duplicates and request.columns is None and not request.lenient:
            raise RecordError(
                f"{path}: columns share a name, so that a channel map must say which is meant: "
                f"{', '.join(duplicates)}"
            )
        texts = column_names(tuple(places), request.texts, path)
        chosen = column_names(tuple(places), request.columns, path)
        read = {schema.names[places[name].column] for name in chosen}
        memory_limit.check(path, _memory_of(file.metadata, read), _LESS)
        for name in chosen:
            request.progress(f"reading column {name}")
            column = _column(file, path, places[name])
            head = column.slice(0, 200).to_pylist()
            if _is_text(column.type) and (name in texts or layouts_of(head)):
                stamped[name] = column.to_pylist()
                continue
            try:
                columns[name], remark = _numbers(column, f"{path}: column {name}")
            except RecordError:
                if not request.lenient:
                    raise
                remark = [f"column {name} holds no numbers: not read"]
            remarks += remark
    fields = {name: schema.field(places[name].column) for name in columns}
    units, meta = _about(schema, fields)
    units |= {name: "s" for name, field in fields.items() if pa.types.is_temporal(field.type)}
    return Log(
        path, columns, units, meta=meta, order=tuple(places), remarks=tuple(remarks), texts=stamped
    )


class _Place(NamedTuple):
    """Place of a column: in the file, and among columns with its name."""

    column: int
    twin: int


def _places(names: list[str]) -> dict[str, _Place]:
    """Return the place of each column, by its name here."""
    # Columns with the same name have their index appended, ``y#2``, as in a text file.
    count = Counter(map(one_line, names))
    before: Counter[str] = Counter()
    places: dict[str, _Place] = {}
    for column, name in enumerate(names):
        label = one_line(name)
        known = label if count[label] == 1 else f"{label}#{column}"
        places[known] = _Place(column, before[name])
        before[name] += 1
    return places


def _memory_of(about: "FileMetaData", selection: Collection[str]) -> int:
    """Return the memory of columns as they are and as float64 [byte], as declared by the file."""
    parts = (
        about.row_group(group).column(place)
        for group in range(about.num_row_groups)
        for place in range(about.num_columns)
    )
    return sum(
        part.total_uncompressed_size + 16 * part.num_values
        for part in parts
        if any(f"{part.path_in_schema}.".startswith(f"{name}.") for name in selection)
    )


def _column(file: "ParquetFile", path: str, place: _Place) -> "ChunkedArray":
    """Read a column; the length of text is checked first: a few bytes may represent any length."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import parquet

    field = file.schema_arrow.field(place.column)
    name = field.name
    if not _is_text(field.type):
        return file.read([name], use_threads=True).column(place.twin)
    with parquet.ParquetFile(path, memory_map=True, read_dictionary=[name]) as packed:
        column = packed.read([name], use_threads=True).column(place.twin)
    words = (pc.max(pc.binary_length(chunk.dictionary)).as_py() for chunk in column.chunks)
    longest = max((length or 0 for length in words), default=0)
    memory_limit.check(path, len(column) * longest, _LESS)
    return column.cast(pa.string())


def _is_text(kind: "DataType") -> bool:
    import pyarrow as pa

    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _numbers(column: "ChunkedArray", place: str) -> tuple[Array, list[str]]:
    """Return a column as numbers; a date and time in seconds from the first one."""
    import pyarrow as pa

    kind = column.type
    try:
        if pa.types.is_temporal(kind) and hasattr(kind, "unit"):
            return _seconds(column, place)
        if pa.types.is_integer(kind) and column.null_count == 0:
            return integers(place.rpartition(": column ")[2], column.to_numpy())
        numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64())
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        raise RecordError(f"{place} holds {kind}, not numbers") from None
    return np.asarray(numbers.to_numpy(), dtype=np.float64), []


def _seconds(column: "ChunkedArray", place: str) -> tuple[Array, list[str]]:
    """Return dates, times of day and durations in seconds from the first one."""
    import pyarrow as pa

    kind = column.type
    there = np.asarray(column.is_valid().to_numpy(), dtype=bool)
    integer_type = pa.int32() if pa.types.is_time32(kind) else pa.int64()
    ticks = np.asarray(column.cast(integer_type).drop_null().to_numpy(), dtype=np.int64)
    a_second = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}[kind.unit]
    seconds = np.full(len(column), np.nan)
    if not ticks.size:
        return seconds, []
    label, first = place.rpartition(": ")[2], column.drop_null()[0]
    remarks = [f"{label}: seconds from {first.cast(pa.string()).as_py()}"]
    if pa.types.is_time(kind):
        ticks, times = unwrapped(ticks, 86_400 * a_second)
        remarks += [f"{label} goes past midnight: carried on"] if times else []
    seconds[there] = (ticks - ticks[0]) / a_second
    return seconds, remarks


def _about(
    schema: "Schema", fields: Mapping[str, "Field"]
) -> tuple[dict[str, str], dict[str, Any]]:
    """Return the units of the columns, and ambkit's own notes."""
    raw_units = {name: (field.metadata or {}).get(b"unit") for name, field in fields.items()}
    units = {
        name: one_line(unit.decode(errors="replace"))
        for name, unit in raw_units.items()
        if unit is not None
    }
    notes = {key.decode(errors="replace"): text for key, text in (schema.metadata or {}).items()}
    meta = {
        key.removeprefix("ambkit."): noted(text.decode(errors="replace"))
        for key, text in notes.items()
        if key.startswith("ambkit.")
    }
    return units, meta
