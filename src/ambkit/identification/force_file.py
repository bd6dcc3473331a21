"""A measured or computed force of the magnet, read from a file."""

from __future__ import annotations

import os

import numpy as np

from ambkit.errors import AmbkitError, RecordError
from ambkit.files.tables import read_table
from ambkit.identification.force_table import ForceTable

COLUMNS = ("iu", "x", "f_mag")


def load_force_table(path: str | os.PathLike[str]) -> ForceTable:
    """Read a force table: a row for each node of a grid, in any order.

    ::

        iu [A],x [mm],f_mag [N]
        -1.5,-0.5,-11.9
        -1.5,-0.25,-13.0

    Parameters
    ----------
    path : path
        A ``.csv`` or ``.parquet`` with control current ``iu``, displacement ``x`` and whole magnet
        force ``f_mag``, with units; and, if it is known, the force's standard error ``f_std``.

    Raises
    ------
    RecordError
        The file is damaged, lacks a column, or its rows are not the nodes of a grid; the message
        names the first node that is missing or there twice.
    AmbkitError
        The file cannot be read, or holds too few nodes.
    """
    columns = read_table(path).columns
    for name in COLUMNS:
        if name not in columns:
            raise RecordError(f"{path}: has no column {name}; it has {', '.join(columns)}")
    iu, x, force = (columns[name] for name in COLUMNS)
    (currents, column), (displacements, row) = (
        np.unique(nodes, return_inverse=True) for nodes in (iu, x)
    )
    values = np.full((displacements.size, currents.size), np.nan)
    count = np.zeros(values.shape, dtype=int)
    values[row, column] = force
    np.add.at(count, (row, column), 1)
    for wrong, complaint in ((count == 0, "is missing"), (count > 1, "is there twice")):
        if wrong.any():
            k, i = np.argwhere(wrong)[0]
            raise RecordError(
                f"{path}: the rows must be the nodes of a grid, {displacements.size} displacements "
                f"times {currents.size} currents; {currents[i]:g} A, {displacements[k]:g} m "
                f"{complaint}"
            )
    errors = None
    if "f_std" in columns:
        errors = np.full(values.shape, np.nan)
        errors[row, column] = columns["f_std"]
    try:
        return ForceTable(currents, displacements, values, errors)
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None
