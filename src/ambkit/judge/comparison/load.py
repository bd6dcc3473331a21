"""A disturbance force, as estimates are compared with it lag by lag."""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.arrays import Array


class Load:
    """A load that estimates of it are compared with, lag by lag."""

    # spread, still (furthest + 1,) Root of its variance in the stretch that each lag sees, and
    # where that is but rounding.
    # signal (n,) The load [N].

    def __init__(self, signal: Array) -> None:
        from scipy.fft import next_fast_len, rfft

        n, deviation = signal.size, signal - signal.mean()
        self.furthest = min(n // 8, period_of(signal) // 2)
        self.moves = bool(np.ptp(signal) > 0)
        self.transform_size = next_fast_len(n, real=True)
        self.transform = rfft(deviation, self.transform_size)
        sums, squares = (np.concatenate([[0.0], np.cumsum(deviation**k)]) for k in (1, 2))
        starts = self.furthest - np.arange(self.furthest + 1)
        length = n - self.furthest
        mean = (sums[starts + length] - sums[starts]) / length
        variance = (squares[starts + length] - squares[starts]) / length - mean**2
        self.still = variance <= 1e-9 * variance.max()
        self.spread = np.sqrt(np.where(self.still, 1.0, variance))


def period_of(signal: Array) -> int:
    """Return after how many samples a signal comes again; its length where it does not."""
    # signal (n,)
    from scipy.signal import correlate

    n = signal.size
    s = signal - signal.mean()
    squares = np.concatenate([[0.0], np.cumsum(s**2)])
    if not squares[-1] > 0:
        return n
    lags = np.arange(n // 2)
    energy = np.sqrt((squares[n] - squares[lags]) * squares[n - lags])
    alike = correlate(s, s, method="fft")[n - 1 :][: n // 2] / np.maximum(energy, 1e-300)
    apart = np.flatnonzero(alike < 0.5)
    if apart.size == 0:
        return n
    again = apart[0] + np.flatnonzero(alike[apart[0] :] > 0.95)
    if again.size == 0:
        return n
    end = again[0] + int(np.argmin(np.append(alike[again[0] :], 0.0) > 0.95))
    return int(again[0] + np.argmax(alike[again[0] : max(end, again[0] + 1)]))


def random_walk(rng: np.random.Generator, variance: float, n: int) -> tuple[Array, Array]:
    """Return a random walk's means over the samples, and where it stands at them (n,)."""
    steps, within = rng.normal(0.0, math.sqrt(variance), (2, n))
    walk = np.cumsum(steps) - steps
    return walk + 0.5 * steps + within / math.sqrt(12), walk  # of a Brownian bridge: its mean
