"""Files of labelled columns with units: CSV and Parquet, and the arrays of a ``.mat``."""

import io
import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit import files
from ambkit.errors import RecordError
from ambkit.files import csv_text
from ambkit.signals import UNITS, si_unit

Array = NDArray[np.float64]


class Table(NamedTuple):
    """Columns of equal length in SI, the unit of each, and what else the file says."""

    columns: Mapping[str, Array]
    units: Mapping[str, str]
    meta: dict[str, Any]


def write_table(path: str | os.PathLike[str], table: Table) -> None:
    """Write a table as ``.csv`` or ``.parquet``, through a temporary file.

    Raises
    ------
    RecordError
        Another ending, or ``meta`` that JSON cannot hold.
    AmbkitError
        The file cannot be written; an older one is left as it was.
    """
    try:
        meta = {key: json.dumps(value, ensure_ascii=False) for key, value in table.meta.items()}
    except (TypeError, ValueError) as error:
        raise RecordError(f"{path}: meta cannot be written as JSON: {error}") from None
    match _ending(path):
        case ".csv":
            files.write_text(path, csv_text.dump(table.columns, table.units, meta))
        case ".parquet":
            _write_parquet(path, table, meta)
        case ending:
            raise RecordError(f"{path}: cannot write {ending}, use .csv or .parquet")


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a table whose columns name their units, and convert it to SI.

    Raises
    ------
    RecordError
        The file is damaged, or a column has no unit, or one that is unknown or of another kind
        than its signal; the message names file and line.
    AmbkitError
        The file cannot be read.
    """
    match _ending(path):
        case ".csv":
            csv = csv_text.parse(files.read_text(path), os.fspath(path))
            columns, given, meta, place = csv.columns, csv.units, csv.meta, f"{path}:{csv.line}"
        case ".parquet":
            columns, given, meta = _read_parquet(path)
            place = os.fspath(path)
        case ".mat":
            found = ", ".join(f"{k} {v.shape}" for k, v in _read_mat(path).items())
            raise RecordError(f"{path}: needs a channel map to say what is what; it has {found}")
        case ending:
            raise RecordError(f"{path}: cannot read {ending}, use .csv, .parquet or .mat")
    converted = {name: _to_si(name, given[name], columns[name], place) for name in columns}
    return Table(
        {name: values for name, (values, _) in converted.items()},
        {name: unit for name, (_, unit) in converted.items()},
        meta,
    )


def read_arrays(
    path: str | os.PathLike[str], columns: Collection[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Read the numbers of a file as they stand in it, for a channel map to give them a meaning.

    Parameters
    ----------
    path : path
        A ``.mat`` gives its arrays by name, a ``.csv`` or ``.parquet`` its columns.
    columns : collection of str
        The columns to read; others may hold anything.

    Raises
    ------
    RecordError
        The file is damaged, or lacks a column.
    AmbkitError
        The file cannot be read.
    """
    match _ending(path):
        case ".csv":
            csv = csv_text.parse(files.read_text(path), os.fspath(path), columns)
            return dict(csv.columns)
        case ".parquet":
            return _read_parquet(path, columns)[0]
        case ".mat":
            return _read_mat(path)
        case ending:
            raise RecordError(f"{path}: cannot read {ending}, use .csv, .parquet or .mat")


def _ending(path: str | os.PathLike[str]) -> str:
    return Path(path).suffix.lower() or "a file without ending"


def _read_bytes(path: str | os.PathLike[str]) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error


def _to_si(name: str, unit: str | None, values: Array, place: str) -> tuple[Array, str]:
    if unit is None:
        raise RecordError(
            f"{place}: column {name} has no unit; write it as {name} [{UNITS.get(name, 'm')}], "
            "or give a channel map"
        )
    from ambkit.units import factor

    try:
        target = UNITS.get(name) or si_unit(unit)
        scale = 1.0 if unit == target else factor(unit, target)
    except ValueError as error:
        raise RecordError(f"{place}: column {name}: {error}") from None
    return (values if scale == 1.0 else values * scale), target


def _write_parquet(path: str | os.PathLike[str], table: Table, meta: dict[str, str]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    fields = [
        pa.field(name, pa.float64(), metadata={"unit": table.units[name]}) for name in table.columns
    ]
    schema = pa.schema(fields, metadata={f"ambkit.{key}": text for key, text in meta.items()})
    arrays = [pa.array(values, from_pandas=True) for values in table.columns.values()]
    with files.replacing(path) as temporary:
        parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), temporary)


def _read_parquet(
    path: str | os.PathLike[str], names: Collection[str] = ()
) -> tuple[dict[str, Array], dict[str, str | None], dict[str, Any]]:
    import pyarrow as pa
    from pyarrow import parquet

    content = pa.BufferReader(_read_bytes(path))
    try:
        table = parquet.read_table(content)
    except (pa.ArrowInvalid, OSError) as error:
        raise RecordError(f"{path}: is damaged or cut short: {error}") from error
    columns: dict[str, Array] = {}
    for name in names or table.column_names:
        if name not in table.column_names:
            found = ", ".join(table.column_names)
            raise RecordError(f"{path}: has no column {name}; it has {found}")
        try:
            numbers = table.column(name).cast(pa.float64())
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
            kind = table.column(name).type
            raise RecordError(f"{path}: column {name} holds {kind}, not numbers") from None
        columns[name] = np.asarray(numbers.to_numpy(), dtype=np.float64)
    units = {name: (table.field(name).metadata or {}).get(b"unit") for name in columns}
    own = {k.decode(): v for k, v in (table.schema.metadata or {}).items()}
    meta = {
        k.removeprefix("ambkit."): json.loads(v) for k, v in own.items() if k.startswith("ambkit.")
    }
    return columns, {name: unit and unit.decode() for name, unit in units.items()}, meta


def _read_mat(path: str | os.PathLike[str]) -> dict[str, Array]:
    from scipy.io import loadmat

    file: Any = io.BytesIO(_read_bytes(path))  # SciPy's stubs know of paths alone
    try:
        content = loadmat(file)
    except NotImplementedError:
        raise RecordError(f"{path}: is a MATLAB 7.3 file; save it with -v7 or -v6") from None
    except Exception as error:  # SciPy lets through whatever a damaged file makes it stumble over
        what = str(error).partition(";")[0]  # behind it SciPy gives advice on its own functions
        raise RecordError(f"{path}: is damaged or cut short: {what}") from error
    return {
        name: np.asarray(values, dtype=np.float64)
        for name, values in content.items()
        if isinstance(values, np.ndarray) and values.dtype.kind in "fiub"
    }
