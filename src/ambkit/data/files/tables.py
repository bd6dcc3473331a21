"""Tables: columns of equal length with units, in all file formats."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.files import csv_text, parquet, timestamps
from ambkit.data.files.log import Log, Request
from ambkit.data.signals import UNITS, to_si

_READERS = {
    ".csv": "csv_text",
    ".txt": "csv_text",
    ".tsv": "csv_text",
    ".asc": "csv_text",
    ".dat": "csv_text",
    ".lvm": "csv_text",
    ".parquet": "parquet",
    ".mat": "mat",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".mf4": "mdf",
    ".mdf": "mdf",
    ".xlsx": "xlsx",
}
ENDINGS = tuple(_READERS)  #: Suffixes of the files for `read_log`.


def read_log(
    path: str | os.PathLike[str],
    selection: Collection[str | int] | None = None,
    progress: Callable[[str], object] = lambda _: None,
    *,
    lenient: bool = False,
    texts: Collection[str | int] = (),
) -> Log:
    """Read the numbers of a log."""
    ending = Path(path).suffix.lower()
    if ending not in _READERS:
        known = f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        raise RecordError(f"{path}: cannot read {ending or 'a file without ending'}, use {known}")
    reader = import_module(f"ambkit.data.files.{_READERS[ending]}")
    progress(f"reading {Path(path).name}")
    log: Log = reader.read(os.fspath(path), Request(selection, progress, lenient, texts))
    return log


class Table(NamedTuple):
    """Columns of equal length in SI, with units and other content of the file."""

    columns: Mapping[str, Array]
    units: Mapping[str, str]
    meta: dict[str, Any]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as ``.csv`` or ``.parquet``, through a temporary file."""
        try:
            meta = {key: json.dumps(value, ensure_ascii=False) for key, value in self.meta.items()}
        except (TypeError, ValueError, RecursionError) as error:
            raise RecordError(f"{path}: meta cannot be written as JSON: {error}") from None
        match Path(path).suffix.lower():
            case ".csv":
                files.write_text(path, csv_text.dump(self.columns, self.units, meta))
            case ".parquet":
                parquet.write(path, self.columns, self.units, meta)
            case ending:
                what = ending or "a file without ending"
                raise RecordError(f"{path}: cannot write {what}, use .csv or .parquet")


def read_table(path: str | os.PathLike[str]) -> Table:
    """Read a table whose columns name their units, and convert it to SI."""
    return to_table(read_log(path))


def to_table(log: Log) -> Table:
    """Convert the columns of a file with units to SI; see `read_table`."""
    if not log.order:
        raise RecordError(
            f"{log.name}: needs a channel map to say what is what, which 'ambkit read guess' "
            f"proposes; it has {log.contents}"
        )
    if log.line_of and not log.header:
        place = log.place(0) if log.arrays else log.name
        raise RecordError(f"{place}: has numbers where the header should be, such as t [s],y [mm]")
    if log.line_of and any(re.search(r"#\d+$", name) for name in log.arrays):
        raise RecordError(f"{log.head}: two columns have the same name, or one has none")
    problems: list[str] = []
    columns: dict[str, Array] = {}
    units: dict[str, str] = {}
    for name, cells in log.texts.items():
        if name != "t":
            problems.append(f"{log.head}: column {name} holds times as text: give a channel map")
            continue
        columns["t"], units["t"] = timestamps.read(cells, "", name, log.place).seconds, "s"
    for name, values in log.arrays.items():
        unit = log.units.get(name)
        if unit is None:
            example = f"{name} [{UNITS[name]}]" if name in UNITS else "y [m]"
            problems.append(
                f"{log.head}: column {name} has no unit; write one, as in {example}, or give a "
                "channel map, which 'ambkit read guess' proposes"
            )
            continue
        try:
            columns[name], units[name] = to_si(name, unit, values)
        except ValueError as error:
            problems.append(f"{log.head}: column {name}: {error}")
    if problems:
        raise RecordError(problems, log.name)
    return Table(columns, units, log.meta)
