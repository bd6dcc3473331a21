"""Spikes of a channel: a few distant samples between neighbours that agree."""

from __future__ import annotations

import numpy as np

from ambkit.base.arrays import Array, Bools, Index

LONGEST = 3  #: Maximum length of a spike; more samples are a movement, or another defect.
#: Minimum distance from the neighbours, in standard deviations of the noise or steps of the sensor.
FAR = 10.0
AROUND = 10  #: Neighbours on each side for the comparison.
RARE = 0.01  #: Maximum share of spikes; beyond it they are a property of the signal.


def spikes(values: Array, rough: float, step: float) -> tuple[Index, Index]:
    """Find the spikes of a signal."""
    # A spike leaves the range of its 20 neighbours by `FAR` times their noise and by twice that
    # range, on one side, for at most three samples. Signals that leap as much elsewhere, such as
    # binary ones and references, have none. values (n,); starts (m,); lengths (m,)
    least = FAR * max(rough, step)
    if values.size < 2 * AROUND + LONGEST:
        return _none()
    padded = np.pad(values, AROUND, mode="reflect")  # so that the first sample may be one
    change = np.diff(padded)
    leaps = np.flatnonzero(np.abs(change) > least)
    starts, lengths = _there_and_back(change, leaps)
    starts, lengths = _within(starts, lengths, values.size)
    if starts.size == 0 or starts.size > RARE * values.size:
        return _none()
    height = _height(padded, starts, lengths, least)
    spike_mask = height > 0
    starts, lengths, height = starts[spike_mask], lengths[spike_mask], height[spike_mask]
    if starts.size == 0:
        return _none()
    # Leaps that belong to no spike, and have at least half the height of the lowest one.
    own = np.zeros(change.size, dtype=bool)
    for k in range(-1, LONGEST):
        own[starts[k < lengths] + k] = True
    others = np.abs(change[AROUND - 1 : change.size - AROUND + 1])
    others = np.sort(others[~own[AROUND - 1 : change.size - AROUND + 1]])
    alike = others.size - np.searchsorted(others, 0.5 * height)
    spike_mask = alike <= 2
    return starts[spike_mask] - AROUND, lengths[spike_mask]


def without(values: Array, starts: Index, lengths: Index) -> Array:
    """Return a signal with each spike interpolated linearly."""
    if starts.size == 0:
        return values
    fine, at = is_valid(values.size, starts, lengths), np.arange(values.size)
    return np.where(fine, values, np.interp(at, at[fine], values[fine]))


def is_valid(size: int, starts: Index, lengths: Index) -> Bools:
    """Return which of so many samples are in no spike."""
    fine = np.ones(size, dtype=bool)
    for k in range(LONGEST):
        fine[starts[k < lengths] + k] = False
    return fine


def _none() -> tuple[Index, Index]:
    nothing = np.array([], dtype=np.intp)
    return nothing, nothing


def _there_and_back(change: Array, leaps: Index) -> tuple[Index, Index]:
    """Find leaps that are reversed within three samples."""
    first, second = leaps[:-1], leaps[1:]
    lengths = second - first
    back = change[first] * change[second] < 0
    alike = np.abs(change[first] + change[second]) < 0.5 * np.abs(change[first])
    result = back & alike & (lengths <= LONGEST)
    # Of two with a common leap the first one.
    result[1:] &= ~(result[:-1] & (first[1:] == second[:-1]))
    return first[result] + 1, lengths[result]


def _within(starts: Index, lengths: Index, size: int) -> tuple[Index, Index]:
    """Clip spikes at the ends, where the signal was continued by reflection."""
    stops = np.minimum(starts + lengths, AROUND + size)
    starts = np.maximum(starts, AROUND)
    inside = stops > starts
    return starts[inside], (stops - starts)[inside]


def _height(padded: Array, starts: Index, lengths: Index, least: float) -> Array:
    """Return the distance of each spike from the range of its neighbours; 0 if that is small."""
    # The three most distant neighbours are excluded: another spike may be among them.
    before = starts[:, None] - 1 - np.arange(AROUND)
    after = (starts + lengths)[:, None] + np.arange(AROUND)
    near = padded[np.clip(np.concatenate([before, after], axis=1), 0, padded.size - 1)]
    middle = np.median(near, axis=1)
    farness = np.sort(np.abs(near - middle[:, None]), axis=1)
    max_deviation = farness[:, -1 - LONGEST]
    inside = np.arange(LONGEST) < lengths[:, None]
    spike = padded[np.minimum(starts[:, None] + np.arange(LONGEST), padded.size - 1)]
    off = np.where(inside, spike - middle[:, None], np.nan)
    lowest, highest = np.nanmin(off, axis=1), np.nanmax(off, axis=1)
    one_side = np.maximum(lowest, -highest)  # negative if it is on both sides
    far = one_side - max_deviation > np.maximum(least, 4 * max_deviation)
    return np.where(far, one_side, 0.0)
