"""Parquet: columns with their units and notes, a column at a time so that long logs fit."""

import json
import os
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit import files
from ambkit.errors import RecordError
from ambkit.files.log import Log, check_readable, column_names, damaged

if TYPE_CHECKING:
    from pyarrow import ChunkedArray, Schema

Array = NDArray[np.float64]


def write(
    path: str | os.PathLike[str],
    columns: Mapping[str, Array],
    units: Mapping[str, str],
    meta: Mapping[str, str],
) -> None:
    """Write columns (n,), the unit of each, and JSON by key; through a temporary file."""
    import pyarrow as pa
    from pyarrow import parquet

    fields = [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns]
    schema = pa.schema(fields, metadata={f"ambkit.{key}": text for key, text in meta.items()})
    arrays = [pa.array(values, from_pandas=True) for values in columns.values()]
    with files.replacing(path) as temporary:
        parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), temporary)


def read(
    path: str | os.PathLike[str],
    wanted: Collection[str | int] | None = None,
    told: Callable[[str], object] = lambda _: None,
    lenient: bool = False,
) -> Log:
    """Read the columns; see `ambkit.files.log.read_log`."""
    import pyarrow as pa
    from pyarrow import parquet

    check_readable(path)
    columns: dict[str, Array] = {}
    remarks: list[str] = []
    try:
        with parquet.ParquetFile(path, memory_map=True) as file:
            schema = file.schema_arrow
            for name in column_names(schema.names, wanted, os.fspath(path)):
                told(f"reading column {name}")
                column = file.read([name], use_threads=True).column(name)
                try:
                    columns[name], remark = _numbers(column, f"{path}: column {name}")
                except RecordError:
                    if not lenient:
                        raise
                    remark = [f"column {name} holds no numbers: not read"]
                remarks += remark
    except (pa.ArrowException, OSError) as error:
        raise damaged(path, error) from error
    units, meta = _about(schema, columns)
    units |= {name: "s" for name in columns if pa.types.is_temporal(schema.field(name).type)}
    order = tuple(schema.names)
    return Log(os.fspath(path), columns, units, meta=meta, order=order, remarks=tuple(remarks))


def _numbers(column: "ChunkedArray", place: str) -> tuple[Array, list[str]]:
    """Return a column as numbers; a date and time as seconds from the first one."""
    import pyarrow as pa

    kind = column.type
    try:
        if pa.types.is_timestamp(kind):
            ticks = column.cast(pa.int64()).to_numpy()
            scale = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
            if column.null_count == 0 and len(ticks):
                remark = f"{place.rpartition(': ')[2]}: seconds from {column[0].as_py()}"
                return (ticks - ticks[0]) * scale, [remark]
        numbers = column if pa.types.is_float64(kind) else column.cast(pa.float64())
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
        raise RecordError(f"{place} holds {kind}, not numbers") from None
    return np.asarray(numbers.to_numpy(), dtype=np.float64), []


def _about(schema: "Schema", columns: Collection[str]) -> tuple[dict[str, str], dict[str, Any]]:
    """Return the units of the columns, and ambkit's own notes."""
    given = {name: (schema.field(name).metadata or {}).get(b"unit") for name in columns}
    units = {name: unit.decode() for name, unit in given.items() if unit is not None}
    notes = {key.decode(errors="replace"): text for key, text in (schema.metadata or {}).items()}
    meta = {
        key.removeprefix("ambkit."): json.loads(text)
        for key, text in notes.items()
        if key.startswith("ambkit.")
    }
    return units, meta
