"""A measured or computed force of the magnet, read from a file."""

from __future__ import annotations

import os

from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.files.tables import read_table
from ambkit.machine.forces.points import ForcePoints

COLUMNS = ("iu", "x", "f_mag")


def load_force_points(path: str | os.PathLike[str]) -> ForcePoints:
    """Read measured points of the force: a row each, anywhere and in any order.

    ::

        iu [A],x [mm],f_mag [N],f_std [N]
        -1.5,-0.48,-11.9,0.2
        -1.2,0.05,-11.6,0.1

    Parameters
    ----------
    path : path
        A ``.csv`` or ``.parquet`` with control current ``iu``, displacement ``x`` and whole magnet
        force ``f_mag``, with units; and, if it is known, the force's standard error ``f_std``.

    Raises
    ------
    RecordError
        The file is damaged or lacks a column.
    AmbkitError
        The file cannot be read, or a value is not finite; the message names the point.
    """
    columns = read_table(path).columns
    for name in COLUMNS:
        if name not in columns:
            raise RecordError(f"{path}: has no column {name}; it has {', '.join(columns)}")
    try:
        return ForcePoints(columns["iu"], columns["x"], columns["f_mag"], columns.get("f_std"))
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None
