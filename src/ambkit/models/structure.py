"""Which entries are zero or one by structure."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.models.model import NUMBER, ONE, ZERO, Array, Pattern

Flags = NDArray[np.bool_]
Kinds = tuple[Array, Pattern]
"""Numbers, and their pattern."""


def pattern_of(driven: Flags) -> Pattern:
    """Return the pattern of the exponential of a matrix of this structure."""
    # What something drives, at once or by way of others, has a number; what nothing drives back to
    # itself has a one on the diagonal.
    n = len(driven)
    reachability = driven.copy()
    for k in range(n):  # Warshall 1962
        reachability |= np.outer(reachability[:, k], reachability[k])
    kinds = np.where(reachability, NUMBER, ZERO)
    diagonal = np.diag(reachability)
    kinds[np.diag_indices(n)] = np.where(diagonal, NUMBER, ONE)
    return kinds.astype(np.int8)


def structured(values: Array, kinds: NDArray[np.generic]) -> Kinds:
    """Return numbers with exact zeros and ones where the pattern has them."""
    pattern = np.asarray(kinds).astype(np.int8)
    return np.where(pattern == NUMBER, values, pattern == ONE).astype(float), pattern


def set_one(part: Kinds, i: int, j: int) -> None:
    """Make an entry one by structure."""
    part[0][i, j], part[1][i, j] = 1.0, ONE
