"""The paper's Tables 2 to 6, in SI, as printed.

The CSV files beside this module are the tables in the paper's units (A, mm, N/A, N/mm).
"""

from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np

from ambkit.base.arrays import Array

CURRENTS: Final = (-1.5, -0.75, 0.0, 0.75, 1.5)  #: Nodes of the control current [A] (Table 2).

DISPLACEMENTS: Final = (-0.5e-3, -0.25e-3, 0.0, 0.25e-3, 0.5e-3)
"""Nodes of the rotor displacement [m] (Table 3)."""


def table4() -> Array:
    """Return the current stiffness k_i [N/A] (5, 5) of Table 4."""
    # Rows are `DISPLACEMENTS`, columns `CURRENTS`; one entry is a misprint, see ``docs/paper``.
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
