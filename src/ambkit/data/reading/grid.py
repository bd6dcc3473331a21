"""Putting signals on an even grid: samples that are missing, delays, other clocks."""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.arrays import Array, Index
from ambkit.base.units import engineering
from ambkit.data.reading.clock import Clock

HELD = ("u",)
"""Signals that keep their value from one sample to the next: the controller holds its output."""


def insert_missing(clock: Clock) -> tuple[Array, Index]:
    """Make room for the samples that a clock without jumps has missed."""
    # times (n,) [s]
    if clock.gaps.size == 0:
        return clock.times, np.arange(clock.times.size)
    skipped = np.zeros(clock.times.size, dtype=np.intp)
    skipped[clock.gaps] = clock.missing
    place = np.arange(clock.times.size) + np.cumsum(skipped)
    times = np.interp(np.arange(place[-1] + 1), place, clock.times)
    times[place] = clock.times
    return times, place


def spread(values: Array, place: Index, size: int) -> Array:
    """Put samples (n,) in their places of a longer row; NaN between."""
    if size == values.size:
        return values
    row = np.full(size, np.nan)
    row[place] = values
    return row


def even_grid(clock: Clock, step: float) -> Array:
    """Return times every `step` [s] from the clock's first sample to its last."""
    first, last = clock.times[0], clock.times[-1]
    count = math.floor((last - first) / step + 1e-6) + 1
    times: Array = first + step * np.arange(count)
    return times


def resample(values: Array, clock: Clock, times: Array, *, held: bool) -> Array:
    """Give a signal at other times."""
    # Between two samples on a straight line, or as it was at the last sample if it is `held`. There
    # is no low-pass before that: the result is what a sampler of the new rate would have seen.
    # values (n,); times (m,) [s]; returns (m,)
    own = clock.times
    slack = 1e-6 * clock.step  # rounded times must not lose a sample at either end
    left = np.clip(np.searchsorted(own, times + slack, side="right") - 1, 0, own.size - 2)
    width = own[left + 1] - own[left]
    part = (times - own[left]) / width
    part[np.abs(part) < 1e-6] = 0.0
    part[np.abs(part - 1) < 1e-6] = 1.0
    before, after = values[left], values[left + 1]
    if held:
        result = np.where(part >= 1.0, after, before)
        outside = (part < 0) | (part >= 2)
    else:
        result = (1 - part) * before + part * after
        result = np.where(part == 0.0, before, np.where(part == 1.0, after, result))
        outside = (part < 0) | (part > 1)
    gap = np.zeros(own.size, dtype=bool)
    gap[clock.gaps] = True
    within_gap = gap[left + 1] & (part > 0) & (part < 1)
    result[outside | within_gap] = np.nan
    return result


def fraction_weights(fraction: float, *, held: bool) -> dict[int, float]:
    """Weights of the neighbours that give a signal between two samples."""
    # A sampled signal is interpolated by the cubic through four samples (Lagrange); one that is
    # held is averaged over the sample, as the plant averages it.
    f = fraction
    if f == 0.0:
        return {0: 1.0}
    if held:
        return {0: 1 - f, 1: f}
    return {
        -1: -f * (f - 1) * (f - 2) / 6,
        0: (f + 1) * (f - 1) * (f - 2) / 2,
        1: -(f + 1) * f * (f - 2) / 2,
        2: (f + 1) * f * (f - 1) / 6,
    }


def shifted(values: Array, samples: float, *, held: bool) -> Array:
    """Take a delay out of a signal: what stands at k + `samples` comes to k."""
    # values (n,); returns (n,)
    integer_part, fraction = split(samples)
    result: Array = np.zeros(values.size)
    for neighbour, weight in fraction_weights(fraction, held=held).items():
        result += weight * _moved(values, integer_part + neighbour)
    return result


def split(samples: float) -> tuple[int, float]:
    """Split a delay into whole samples and what is left, from 0 to 1."""
    integer_part = round(samples)
    if abs(samples - integer_part) < 1e-6:
        return integer_part, 0.0
    integer_part = math.floor(samples)
    return integer_part, samples - integer_part


def _moved(values: Array, count: int) -> Array:
    """Return the signal `count` samples earlier, NaN where nothing is left."""
    row = np.full(values.size, np.nan)
    if abs(count) < values.size:
        row[max(0, -count) : values.size - max(0, count)] = values[
            max(0, count) : values.size + min(0, count)
        ]
    return row


def describe_shift(name: str, delay: float, step: float) -> str:
    """Say how a delay was taken out of a signal."""
    sample_count, fraction = split(delay / step)
    held = name in HELD
    samples = "1 sample" if sample_count == 1 else f"{sample_count} samples"
    text = f"{name} was logged {engineering(delay, 's')} late: shifted by {samples}"
    if fraction:
        power = sum(weight**2 for weight in fraction_weights(fraction, held=held).values())
        how = "averaged, as it is held" if held else "a cubic through four samples"
        text += (
            f" and {fraction:.3g} of one ({how}; white noise keeps {100 * power:.0f} % of its "
            "variance)"
        )
    return f"{text}; the ends are missing"
