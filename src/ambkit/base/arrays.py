"""Types of arrays, and conversion of callers' arrays."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from ambkit.base.errors import AmbkitError

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.intp]
Complex = NDArray[np.complex128]


def real(name: str, values: ArrayLike, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return an array of real numbers; NumPy itself would drop imaginary parts with a warning."""
    array = np.asarray(values)
    if np.iscomplexobj(array):
        raise ValueError(f"{name} must hold real numbers, holds {array.dtype}; give its real part")
    return np.asarray(array, dtype)


def check_finite(**values: ArrayLike) -> None:
    """Reject values that are not finite, with their name."""
    for name, value in values.items():
        array = real(name, value)
        wrong = array[~np.isfinite(array)]
        if wrong.size:
            raise AmbkitError(f"{name} must be finite, has {wrong[0]}")


def rms(values: Array) -> float:
    """Return the root mean square; NaN if any value is."""
    return float(np.sqrt(np.mean(values**2)))


def interpolated(values: Array) -> Array:
    """Return samples (n,) with missing ones interpolated linearly; zeros if all are missing."""
    known = np.isfinite(values)
    if known.all():
        return values
    at = np.arange(values.size)
    return np.interp(at, at[known], values[known]) if known.any() else np.zeros(values.size)


def block_means(values: Array, size: int, first: int = 0) -> Array:
    """Return means over blocks of samples, from the second on; an incomplete block is omitted."""
    count = (values.size - first) // size
    return np.asarray(values[first : first + count * size].reshape(count, size).mean(axis=1))


def period_of(signal: Array, same: float) -> int | None:
    """Return the period of a signal (n,) in samples, to a relative power; None if it has none."""
    n, deviation = len(signal), signal - signal.mean()
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(deviation, size)
    common = np.fft.irfft(np.abs(spectrum) ** 2, size)[: n // 2 + 1]
    power = np.concatenate([[0.0], np.cumsum(deviation**2)])
    lag = np.arange(len(common))
    both = (power[n] - power[lag]) + power[n - lag]  # of the overlap
    with np.errstate(invalid="ignore", divide="ignore"):
        differs = 1 - 2 * common / both
    apart = np.flatnonzero(differs > 0.5)
    if not len(apart):
        return None
    again = np.flatnonzero(differs[apart[0] :] < same)
    if not len(again):
        return None
    # For a smooth signal the neighbouring lags are nearly as good.
    start = int(apart[0] + again[0])
    return start + int(np.argmin(differs[start : start + int(apart[0]) + 1]))


def stretches(where: Bools) -> list[tuple[int, int]]:
    """Return start and end of each interval in which an array (n,) is true."""
    edges = np.flatnonzero(np.diff(np.r_[False, where, False]))
    return [(a, b) for a, b in edges.reshape(-1, 2).tolist()]


def grouped(count: int, alike: Callable[[int, int], bool]) -> list[list[int]]:
    """Return the numbers below a count in groups, each with its predecessors of equal key."""
    results: list[list[int]] = []
    for k in range(count):
        same = next((of for of in results if alike(k, of[0])), None)
        if same is None:
            results.append([k])
        else:
            same.append(k)
    return results
