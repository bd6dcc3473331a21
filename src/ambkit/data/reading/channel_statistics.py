"""Statistics of a channel of a log that do not mind noise, gaps and its length."""

from __future__ import annotations

import numpy as np

from ambkit.base.arrays import Array, block_means

LOOKED_AT = 50_000  #: Samples that the statistics are made of.
COMPARED = 40  #: Channels that are compared, each with each.


def seen(values: Array) -> Array:
    """Return the finite samples (n,), at most `LOOKED_AT` of them; a zero if there is none."""
    there = values[np.isfinite(values)][:LOOKED_AT]
    return there if there.size else np.zeros(1)


def is_few(values: Array) -> bool:
    """Whether a channel takes few values, as a set point or a status does."""
    there = seen(values)
    seldom = np.count_nonzero(np.diff(there)) < 0.1 * there.size
    return bool(seldom and np.unique(there).size < 0.01 * there.size)


def slow(values: Array) -> Array:
    """Return means of 20 samples each, of fewer in a short record, which are hardly noise."""
    return block_means(values, 20 if values.size >= 400 else max(1, values.size // 60))


def correlation(a: Array, b: Array) -> float:
    """Correlation without the first tenth, where a rig is often still starting; 0 if undefined."""
    for first in (a.size // 10, 0):  # the step of a reference may be in that tenth
        rows = np.array([a[first : first + LOOKED_AT], b[first : first + LOOKED_AT]])
        rows = rows[:, np.isfinite(rows).all(axis=0)]
        if rows.shape[1] > 2 and np.ptp(rows, axis=1).all():
            return float(np.corrcoef(rows)[0, 1])
    return 0.0
