"""The acting control signal: after dead time, current lag and limits."""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.arrays import Array, interpolated
from ambkit.base.errors import AmbkitError
from ambkit.machine.accessories import SHORTEST_LAG
from ambkit.machine.machine import Machine


def lag_of(machine: Machine) -> float:
    """Return the time constant of a machine's current [s]; 0 if it has none."""
    bandwidth = machine.amplifier.bandwidth
    return 0.0 if bandwidth is None else 1 / (2 * math.pi * bandwidth)


def acting(machine: Machine, u: Array) -> Array:
    """Return the mean acting control over each sample, for the control signal u (n,) [V]."""
    T = machine.sampling_time
    return delayed(lagged(u, T, lag_of(machine)), (machine.delay or 0.0) / T)


def delayed(u: Array, samples: float) -> Array:
    """Return the acting control in each sample of a held signal with a delay."""
    # u (n,)
    if abs(samples) > u.size - 2:
        raise AmbkitError(f"a delay of {samples:.3g} samples is longer than the record, {u.size}")
    integer_part = math.floor(samples)
    part = samples - integer_part
    if integer_part == 0 and part == 0:
        return u
    last = u.size - 1
    now = u[np.clip(np.arange(u.size) - integer_part, 0, last)]
    if part == 0:  # a missing neighbour has no effect
        return now
    before = u[np.clip(np.arange(u.size) - integer_part - 1, 0, last)]
    return np.asarray((1 - part) * now + part * before)


def lagged(u: Array, T: float, lag: float) -> Array:
    """Return the mean over each sample of a held signal behind a first-order lag."""
    # u (n,)
    if lag < SHORTEST_LAG * T:
        return u
    from scipy.signal import lfilter

    good = interpolated(u)
    keep = math.exp(-T / lag)
    # State at the start of each sample: w[k] = keep w[k-1] + (1 - keep) u[k-1], w[0] = u[0].
    follow, _ = lfilter([0.0, 1 - keep], [1.0, -keep], good, zi=[good[0]])
    return np.asarray(good + (follow - good) * (lag / T) * (1 - keep))


FAR = 9.0
"""Distance from a limit in standard deviations beyond which the mean changes by less than 1e-20."""


def limited(mean: Array, std: float, low: float, high: float) -> Array:
    """Return the mean of a normal variable clipped to limits."""
    # ``low + s (g(a) - g(b))`` with ``g(z) = z Phi(z) + phi(z)``, ``a = (mean - low)/s`` and ``b =
    # (mean - high)/s`` (Tobin 1958, for both sides).
    if not std > 0:
        return np.clip(mean, low, high)
    near = (mean < low + FAR * std) | (mean > high - FAR * std)
    if not near.any():
        return mean
    if not near.all():
        out = mean.copy()
        out[near] = limited(mean[near], std, low, high)
        return out
    from scipy.special import ndtr

    def ramp(z: Array) -> Array:
        return np.asarray(z * ndtr(z) + np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi))

    return np.asarray(low + std * (ramp((mean - low) / std) - ramp((mean - high) / std)))
