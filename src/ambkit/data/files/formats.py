"""Which module reads which format; each is loaded when a file of its kind comes."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from importlib import import_module
from pathlib import Path

from ambkit.base.errors import RecordError
from ambkit.data.files.log import Log, Request

_READERS = {
    ".csv": "csv_text",
    ".txt": "csv_text",
    ".tsv": "csv_text",
    ".asc": "csv_text",
    ".parquet": "parquet",
    ".mat": "mat",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".mf4": "mdf",
    ".mdf": "mdf",
}
ENDINGS = tuple(_READERS)  #: Endings of the files that `read_log` reads.


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
