"""The paper's own figures: Tables 2 to 6, in SI, as printed.

The CSV files beside this module are the tables in the paper's units (A, mm, N/A, N/mm).
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Final, NamedTuple

import numpy as np

from ambkit.base.arrays import Array

MAGNET_CONSTANT: Final = 6.7e-6
"""Identified magnet constant [N m^2/A^2] (below eq. 31)."""

CURRENTS: Final = (-1.5, -0.75, 0.0, 0.75, 1.5)
"""Nodes of the control current [A] (Table 2)."""

DISPLACEMENTS: Final = (-0.5e-3, -0.25e-3, 0.0, 0.25e-3, 0.5e-3)
"""Nodes of the rotor displacement [m] (Table 3)."""

INITIAL_WIDTH: Final = 0.4
"""Width of every rule before training, an ampere weighing as much as a millimetre (Table 6)."""


class Misprint(NamedTuple):
    """An entry of a table that the table itself contradicts."""

    table: str
    row: int
    column: int
    printed: float
    meant: float
    why: str


MISPRINTS: Final = (
    Misprint(
        table="table4",
        row=4,
        column=3,
        printed=8.45,
        meant=8.47,
        why="the force law is symmetric: F(-iu, -x) = -F(iu, x), so (0.5 mm, 0.75 A) has the "
        "k_i of its mirror image (-0.5 mm, -0.75 A), 8.47 N/A",
    ),
)


def table4() -> Array:
    """Return the current stiffness k_i [N/A] (5, 5) of Table 4."""
    # Rows are `DISPLACEMENTS`, columns `CURRENTS`; `MISPRINTS` lists the entry that is not right.
    return _table("table4_ki.csv")[:, 1:].copy()


def table5() -> Array:
    """Return the position stiffness k_s [N/m] (5, 5) of Table 5; rows and columns as `table4`."""
    return 1e3 * _table("table5_ks.csv")[:, 1:]


def table6() -> Array:
    """Return the trained widths (2, 25) of Table 6: of the 25 rules for k_i, and for k_s."""
    # In units of 1 A and 1 mm. Rules go through the currents first, then the displacements.
    return _table("table6_widths.csv")[:, 4:].T.copy()


@cache
def _table(name: str) -> Array:
    source = files(__name__) / name
    with source.open(encoding="utf-8") as lines:
        return np.loadtxt(lines, delimiter=",", skiprows=1)
