"""Which channels are made of which: copies, differences, filters, and what an estimate is of."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.faults import noise
from ambkit.data.reading.levitation_test import TINY, Band

SAME = 1e-6  #: Standard deviations by which copies of a channel differ at most.
DIFFERENCE = 0.9  #: Correlation with the difference of a channel that makes a velocity.
WHITE = 0.1  #: Logarithm by which the ratio of differences is off at most that white noise has.
AS_ROUGH = 0.2  #: Roughness of a difference, relative to that of its velocity, at least.
SMOOTH = 0.05  #: Ratio of fourth to second differences that only a formula has.
OFTEN = 0.9  #: Quantile of the differences: on a finer grid by straight lines most are 0.
EXACT = 1e-5  #: Part of a channel's changes that is left, where it is a filter of another one.
LOOKED_AT = 4000  #: Samples in which a filter is looked for.
STEADY = 2.0  #: Ratio of the gains from an estimate to its original over all bands.

BANDS = ((0.85, 1.0), (0.5, 0.65))  #: Of the fastest frequency: a filter leaves less in the first.
FALLS = 0.8  #: Ratio of the noise's power in these below which it was filtered; raw ones: 0.88 up.
LEAST_SAMPLES = 2000  #: From which on the ratio is known to 15 %.
CHANCE = 21.0  #: Three of its standard deviations of white noise, times the root of the samples.
COARSE = 0.3  #: Share of samples that repeat the one before, of a converter that is too coarse.


def same_numbers(channels: Array) -> dict[int, int]:
    """Find channels that hold another one's numbers, shifted and scaled perhaps."""
    # channels (m, n)
    results: dict[int, int] = {}
    unit = standardised(channels)
    for k, values in enumerate(unit):
        for first in range(k):
            if first not in results and _same(unit[first], values):
                results[k] = first
                break
    return results


def _same(a: Array, b: Array) -> bool:
    ends = a[0] * b[0] + a[-1] * b[-1] + a[a.size // 2] * b[a.size // 2]  # quick, for most
    return bool(np.abs(a - (1 if ends >= 0 else -1) * b).max() < SAME)


def standardised(channels: Array) -> Array:
    """Return channels (m, n) with mean 0 and standard deviation 1; what is constant is 0."""
    moved = channels - channels.mean(axis=1, keepdims=True)
    size = moved.std(axis=1, keepdims=True)
    return np.asarray(np.divide(moved, size, out=np.zeros_like(moved), where=size > 0))


def velocities(unit: Array) -> set[int]:
    """Find channels that are another one's difference from sample to sample."""
    # unit (m, n)
    change, level = _clipped(np.diff(unit, axis=1)), _clipped(unit[:, 1:])
    alike = abs(change @ level.T)
    hiss = np.array([noise(values) for values in unit])
    alike[hiss[:, None] >= hiss[None, :]] = 0.0  # a difference is rougher than what it is of
    # Of a sine everything is the difference; but what has noise is none of what has less of it.
    differences = np.diff(unit, axis=1)
    size = differences.std(axis=1)
    hiss_of = np.array([noise(values) for values in differences])
    alike[hiss_of[:, None] < AS_ROUGH * hiss[None, :] * size[:, None]] = 0.0
    return set(np.flatnonzero((alike > DIFFERENCE).any(axis=0)).tolist())


def _clipped(values: Array) -> Array:
    """Cut what leaps, take the mean off, and make it of length 1."""
    values = values - np.median(values, axis=1, keepdims=True)
    most = np.quantile(abs(values), 0.99, axis=1, keepdims=True)
    values = np.clip(values, -most, most)
    values = values - values.mean(axis=1, keepdims=True)
    size = np.linalg.norm(values, axis=1, keepdims=True)
    return np.asarray(np.divide(values, size, out=np.zeros_like(values), where=size > 0))


def colour(values: Array) -> float:
    """Return the logarithm by which the noise of a channel (n,) is off white noise; 0 of white."""
    # Its fourth differences then have 70 times its variance, its second ones 6 times.
    second, fourth = (float(np.median(abs(np.diff(values, order)))) for order in (2, 4))
    return float(np.log(fourth**2 / second**2 * 6 / 70)) if second > 0 < fourth else np.inf


def is_filtered(values: Array) -> bool:
    """Whether the noise of a channel (n,) falls towards the fastest frequencies."""
    # Power in two bands, of second differences: slow motion is not in them, and their own spectrum
    # is known. A converter whose steps are coarser than the noise does not tell.
    bent = np.diff(values, 2)
    size = np.median(abs(bent))
    if bent.size < LEAST_SAMPLES or np.mean(np.diff(values) == 0) > COARSE:
        return False
    power = abs(np.fft.rfft(np.clip(bent, -6 * size, 6 * size) * np.hanning(bent.size))) ** 2
    at = np.linspace(0, 1, power.size)
    power[1:] /= np.sin(np.pi * at[1:] / 2) ** 4
    fast, slower = (power[(low < at) & (at < high)].mean() for low, high in BANDS)
    return bool(fast < min(FALLS, np.exp(-CHANCE / bent.size**0.5)) * slower)


def rough(values: Array) -> float:
    """Return the noise of a signal (n,) by fourth differences, in which no slow sine is left."""
    return noise(np.diff(values, 2)) * math.sqrt(6 / 70)


def is_formula(values: Array) -> bool:
    """Whether a signal (n,) is computed, such as a sine: of noise fourth differences are larger."""
    second, fourth = (float(np.quantile(abs(np.diff(values, order)), OFTEN)) for order in (2, 4))
    return fourth < SMOOTH * second


def filters_of_others(unit: Array, raw: Sequence[bool]) -> set[int]:
    """Find channels that a low-pass of first or second order makes of a rougher one."""
    # unit (m, n)
    part = unit[:, :LOOKED_AT]
    hiss = [noise(values) for values in unit]
    return {
        k for k in range(len(unit)) if not raw[k]
        and any(_is_filter(part[k], part[j]) for j in range(len(unit)) if hiss[j] > hiss[k])
    }  # fmt: skip


def _is_filter(made: Array, of: Array) -> bool:
    """Whether one channel follows from its last two samples and three of another one, exactly."""
    # A filter passes what is slow, once. A PID controller's inverse, by which a position follows
    # from the control, does not; nor does a sum, by which it follows from its difference.
    ago = np.column_stack([made[1:-1], made[:-2]])
    both = np.column_stack([ago, of[2:], of[1:-1], of[:-2], np.ones(of.size - 2)])
    own_residual, _ = _left(ago, made[2:])
    left, (last, before, *passed, _) = _left(both, made[2:])
    slow = abs(sum(passed)) > 1e-3 * sum(map(abs, passed)) and abs(1 - last - before) > 1e-4
    return bool(slow and left < EXACT * np.diff(made).std() and left < 0.01 * own_residual)


def _left(regressors: Array, values: Array) -> tuple[float, list[float]]:
    """Return the standard deviation of what regressors (n, k) leave, and their coefficients."""
    result = np.linalg.lstsq(regressors, values, rcond=None)[0]
    return float((values - regressors @ result).std()), result.tolist()


def raw_counterparts(
    unit: Array, listed: Sequence[Band], estimate: int, others: Sequence[int]
) -> list[int]:
    """Return the rougher channels in which an estimate is with one gain, whether fast or slow."""
    # It may be the estimate of these. A control goes with the position too, but the faster, the
    # more of it.
    # unit (m, n)
    own = [float(band.ss[:, estimate, estimate].sum()) for band in listed]
    hiss, result = noise(unit[estimate]), []
    for k in others:
        slope = [
            float(band.ss[:, k, estimate].sum()) / max(size, TINY)
            for band, size in zip(listed, own, strict=True)
        ]
        least, most = min(slope, key=abs), max(slope, key=abs)
        steady = most * min(slope) > 0 < most * max(slope) and abs(most) < STEADY * abs(least)
        if steady and noise(unit[k]) > abs(most) * hiss:
            result.append(k)
    return result
