"""Which module reads which format; each is loaded when a file of its kind comes."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from importlib import import_module
from pathlib import Path

from ambkit.base.errors import RecordError
from ambkit.data.files.log import Log

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
ENDINGS = tuple(_READERS)
"""Endings of the files that `read_log` reads."""


def read_log(
    path: str | os.PathLike[str],
    wanted: Collection[str | int] | None = None,
    progress: Callable[[str], object] = lambda _: None,
    *,
    lenient: bool = False,
    texts: Collection[str | int] = (),
) -> Log:
    """Read the numbers of a log.

    Parameters
    ----------
    path : path
        A text file with columns (``.csv``, ``.txt``, ``.tsv``, ``.asc``), ``.parquet``, ``.mat``,
        ``.h5`` or ``.hdf5``, ``.mf4`` or ``.mdf``.
    wanted : collection of str or int, optional
        Read these alone; in a text file or a Parquet the others may then hold anything, and a
        number is the place of a column.
    progress : callable
        Called with what is being done, where that takes long.
    lenient : bool
        Leave out what holds no numbers, and say so, where it would be refused.
    texts : collection of str or int
        Read these as times in text, whatever they look like.

    Raises
    ------
    RecordError
        The file is damaged or cut short, or of another kind, or lacks what is wanted.
    ExtraMissing
        The library for such files is not installed; the message names the command.
    AmbkitError
        The file cannot be read.
    """
    ending = Path(path).suffix.lower()
    if ending not in _READERS:
        known = f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        raise RecordError(f"{path}: cannot read {ending or 'a file without ending'}, use {known}")
    reader = import_module(f"ambkit.data.files.{_READERS[ending]}")
    progress(f"reading {Path(path).name}")
    log: Log = reader.read(path, wanted, progress, lenient, texts)
    return log
