"""Fewer points for a long line, with its picture unchanged."""

import numpy as np
from numpy.typing import NDArray


def decimate(
    x: NDArray[np.float64], y: NDArray[np.float64], buckets: int = 1000
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Keep of each stretch of samples the extremes in x and in y."""
    # For a time series the extremes in x are the first and the last sample, which makes this the M4
    # aggregation (Jugel, Jerzak, Hackenbroich and Markl, 2014): at one stretch a pixel column the
    # drawn line does not change. A curve that turns back has no pixel columns to lean on: it is cut
    # into ten times as many stretches, and its extremes in x are kept likewise. Every kept point is
    # a sample, none is invented; gaps (NaN) stay gaps.
    # x (n,); y (n,)
    if x.size > 4 * buckets and not (np.diff(x) >= 0).all():
        buckets *= 10
    if x.size <= 4 * buckets:
        return x, y
    size = -(-x.size // buckets)
    padding = -x.size % size
    first = np.arange(0, x.size, size)
    # The last stretch is filled up with its own last sample.
    xs, ys = (np.pad(values, (0, padding), mode="edge").reshape(-1, size) for values in (x, y))
    gap = np.isnan(ys)
    low = np.where(gap, np.inf, ys).argmin(axis=1)
    high = np.where(gap, -np.inf, ys).argmax(axis=1)
    index_parts = [first + place for place in (xs.argmin(axis=1), xs.argmax(axis=1), low, high)]
    broken = gap.any(axis=1)
    index_parts.append(first[broken] + gap[broken].argmax(axis=1))
    index = np.unique(np.minimum(np.concatenate(index_parts), x.size - 1))
    return x[index], y[index]
