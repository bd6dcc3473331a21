"""From a measured impulse response to a linear system of least order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambkit.models.linear import LinearSystem, Signal

Array = NDArray[np.float64]

KNOWN = 1e-8
"""Singular values below this part of the greatest are rounding."""


def realised(
    response: Array, T: float, inputs: Sequence[Signal], outputs: Sequence[Signal], blocks: int
) -> LinearSystem:
    """Return the system of an impulse response (n, outputs, inputs); Juang and Pappa 1985."""
    # Inputs and outputs are scaled to alike sizes first: the order is told by ratios.
    out = np.sqrt((response**2).sum(axis=(0, 2)).max(initial=0)) or 1.0
    rows = np.sqrt((response**2).sum(axis=(0, 2))) / out
    rows = np.where(rows > 0, rows, 1.0)
    columns = np.sqrt(((response / rows[:, None]) ** 2).sum(axis=(0, 1)))
    columns = np.where(columns > 0, columns, 1.0)
    h = response / rows[:, None] / columns
    p, m = h.shape[1:]
    at = np.add.outer(np.arange(blocks), np.arange(blocks))
    first, shifted = (
        h[at + k].transpose(0, 2, 1, 3).reshape(blocks * p, blocks * m) for k in (1, 2)
    )
    U, s, Vt = np.linalg.svd(first, full_matrices=False)
    order = int((s > KNOWN * s[0]).sum())
    root = np.sqrt(s[:order])
    A = (U[:, :order] / root).T @ shifted @ (Vt[:order].T / root)
    B, C = (root[:, None] * Vt[:order])[:, :m], (U[:, :order] * root)[:p]
    states = tuple(Signal(f"s{k}", "1") for k in range(order))
    return LinearSystem(
        A, B * columns, C * rows[:, None], response[0], T, states, tuple(inputs), tuple(outputs)
    )
