"""The rotor's position and its current, among channels without a name: physics, then rawness.

Prediction alone is a trap: what a rig's own filter made of its measurements moves as the rotor
does, and predicts better than they do. So of channels that tell the same motion the rawest is
taken: what a converter measured comes in steps, and what was computed from it hardly ever repeats a
value; where that does not tell them apart, the one with more noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.data.reading.faults import noise
from ambkit.data.reading.instruments import instrumented
from ambkit.data.reading.levitation import TINY, Band, Levitated, bands, levitated, turning

Array = NDArray[np.float64]

SAME = 1e-6
"""Standard deviations within which two channels, shifted and scaled, hold the same numbers."""

REPEATS = 0.6
"""Different values in parts of the samples: a channel with fewer comes from a converter."""

NO_NOISE = 1e-6
"""Noise in parts of the standard deviation below which a channel is computed, such as a sine."""

DIFFERENCE = 0.9
"""Correlation with another channel's difference from which on a channel is its velocity."""

TRIED = 12
"""Channels that are tried with instruments, where plain regression tells nothing."""

CLOSE = 0.98
"""Correlation of a channel and an estimate of it, where slow bands have no noise."""

SAME_POLE = 2.0
"""Ratio of the poles that a channel and an estimate of it tell; noise moves them."""

SAME_GAIN = 1.25
"""Ratio within which the gain between a channel and an estimate of it is the same in all bands."""


@dataclass(frozen=True)
class Rotor:
    """Which channels are the position and the current of a levitated rotor.

    Attributes
    ----------
    position, control : int
        Rows of the array that was searched.
    fit : Levitated
        What told them; of an estimate perhaps, in whose place they are.
    gain : float
        Acceleration of the position per control [units / sample²]: negative where a greater control
        moves the rotor towards smaller positions.
    positions, controls : tuple of int
        Further rows that tell the same motion, and the same current: estimates, the rawest first.
    others : tuple of (int, int)
        Further positions with their controls, that move by themselves: another axis.
    """

    position: int
    control: int
    fit: Levitated
    gain: float
    positions: tuple[int, ...]
    controls: tuple[int, ...]
    others: tuple[tuple[int, int], ...]

    @property
    def turned(self) -> bool:
        """Whether a greater control moves the rotor towards smaller positions."""
        return self.gain < 0

    def renumbered(self, places: Sequence[int]) -> Rotor:
        """Return the same with other numbers for the rows.

        Parameters
        ----------
        places : sequence of int
            The new number of each row.
        """
        return Rotor(
            places[self.position], places[self.control], self.fit, self.gain,
            tuple(places[k] for k in self.positions), tuple(places[k] for k in self.controls),
            tuple((places[a], places[b]) for a, b in self.others),
        )  # fmt: skip


def same_numbers(channels: Array) -> dict[int, int]:
    """Find channels that hold another one's numbers, shifted and scaled perhaps.

    Parameters
    ----------
    channels : ndarray (m, n)
        Finite samples.

    Returns
    -------
    dict
        The row of each copy, with the first row that holds the same.
    """
    found: dict[int, int] = {}
    unit = standardised(channels)
    for k, values in enumerate(unit):
        for first in range(k):
            if first not in found and _same(unit[first], values):
                found[k] = first
                break
    return found


def _same(a: Array, b: Array) -> bool:
    ends = a[0] * b[0] + a[-1] * b[-1] + a[a.size // 2] * b[a.size // 2]  # quick, for most
    return bool(np.abs(a - (1 if ends >= 0 else -1) * b).max() < SAME)


def standardised(channels: Array) -> Array:
    """Return channels (m, n) with mean 0 and standard deviation 1; what is constant is 0."""
    moved = channels - channels.mean(axis=1, keepdims=True)
    size = moved.std(axis=1, keepdims=True)
    return np.asarray(np.divide(moved, size, out=np.zeros_like(moved), where=size > 0))


def in_steps(values: Array) -> bool:
    """Whether a channel (n,) repeats its values, as what a converter measured does."""
    return bool(np.unique(values).size < REPEATS * values.size)


def rotor(channels: Array, position: int | None = None, control: int | None = None) -> Rotor | None:
    """Find the position and the current of a levitated rotor.

    Parameters
    ----------
    channels : ndarray (m, n)
        Finite samples, no two rows with the same numbers (`same_numbers`), none constant.
    position, control : int, optional
        Rows that are known already.

    Returns
    -------
    Rotor or None
        None where no pair of channels moves so.
    """
    unit = standardised(channels)
    listed = list(bands(unit))
    hiss = [noise(values) for values in unit]
    raw = [in_steps(v) and h > NO_NOISE for v, h in zip(channels, hiss, strict=True)]
    rates = velocities(unit)
    rates -= {position, control}

    def fitting(listed: list[Levitated]) -> list[Levitated]:
        return [
            f for f in listed
            if not {f.position, f.control} & rates
            and position in (None, f.position) and control in (None, f.control)
        ]  # fmt: skip

    found = fitting(levitated(listed))
    usable = [f for f in found if f.sure or raw[f.position] or raw[f.control]]
    if not usable:
        tried = sorted((k for k in range(len(unit)) if k not in rates), key=lambda k: not raw[k])
        usable = found = fitting(instrumented(unit, sorted(tried[:TRIED])))
    if not usable:
        return None
    close = np.array([turning(band) for band in listed[-3:]]).max(0) > CLOSE

    def same(f: Levitated, g: Levitated) -> bool:
        return bool(
            close[f.position, g.position] and close[f.control, g.control]
            and f.pole / SAME_POLE < g.pole < f.pole * SAME_POLE
        )  # fmt: skip

    both = [f for f in usable if raw[f.position] and raw[f.control]]
    best = max(both or usable, key=lambda f: (f.sure, sum(g.evidence for g in found if same(f, g))))
    motion = [best, *(f for f in found if same(best, f))]
    controls = list(dict.fromkeys(f.control for f in motion if f.control != best.position))
    positions = [f.position for f in motion if f.position not in controls]
    positions = list(dict.fromkeys(positions))
    positions += [
        k for k in estimates(listed, best.position, best.box)
        if k not in {*positions, *controls, *rates}
    ]  # fmt: skip

    def rawest(members: list[int], chosen: int) -> list[int]:
        gain = gains(listed, chosen, best.box)
        known = {position, control}
        return sorted(
            members, key=lambda k: (k in known, raw[k], hiss[k] / abs(gain[k])), reverse=True
        )

    positions, controls = rawest(positions, best.position), rawest(controls, best.control)
    taken = {*positions, *controls}
    others: dict[int, int] = {}
    for each in found:
        if each.sure and not taken & {each.position, each.control}:
            others.setdefault(each.position, each.control)
    gain = best.gain * gains(listed, best.position, best.box)[positions[0]]
    gain /= gains(listed, best.control, best.box)[controls[0]]
    gain *= channels[positions[0]].std() / channels[controls[0]].std()
    return Rotor(
        positions[0], controls[0], best, float(gain),
        tuple(positions[1:]), tuple(controls[1:]), tuple(others.items()),
    )  # fmt: skip


def velocities(unit: Array) -> set[int]:
    """Find channels that are another one's difference from sample to sample.

    Parameters
    ----------
    unit : ndarray (m, n)
        Channels of about unit size.
    """
    change, level = _clipped(np.diff(unit, axis=1)), _clipped(unit[:, 1:])
    alike = abs(change @ level.T)
    hiss = np.array([noise(values) for values in unit])
    alike[hiss[:, None] >= hiss[None, :]] = 0.0  # a difference is rougher than what it is of
    return set(np.flatnonzero((alike > DIFFERENCE).any(axis=0)).tolist())


def _clipped(values: Array) -> Array:
    """Cut what leaps, take the mean off, and make it of length 1."""
    values = values - np.median(values, axis=1, keepdims=True)
    most = np.quantile(abs(values), 0.99, axis=1, keepdims=True)
    values = np.clip(values, -most, most)
    values = values - values.mean(axis=1, keepdims=True)
    size = np.linalg.norm(values, axis=1, keepdims=True)
    return np.asarray(np.divide(values, size, out=np.zeros_like(values), where=size > 0))


def gains(listed: Sequence[Band], of: int, box: int) -> Array:
    """Return how much each channel moves where one of them does, in the band nearest to `box` (m,).

    Instruments tell a pair in a short record's slow bands too, which are not all among the listed.
    """
    return _ratios(_nearest(listed, box), of)


def _nearest(listed: Sequence[Band], box: int) -> Band:
    return min(listed, key=lambda band: abs(np.log(band.box / box)))


def _ratios(band: Band, of: int) -> Array:
    own = np.maximum(band.ss[:, of, of], TINY)
    found = np.median(band.ss[:, :, of] / own[:, None], axis=0)
    return np.asarray(np.where(found == 0, TINY, found))


def estimates(listed: Sequence[Band], of: int, box: int) -> list[int]:
    """Find channels that move as one of them does, with the same gain at all speeds.

    A current goes with its position too; but the faster, the more of it.
    """
    near = [band for band in listed if box / 2 <= band.box <= 4 * box]
    near = near or [_nearest(listed, box)]
    ratio = np.array([_ratios(band, of) for band in near])
    steady = abs(ratio).max(0) < SAME_GAIN * abs(ratio).min(0)
    steady &= abs(np.sign(ratio).sum(0)) == len(near)
    close = np.array([turning(band)[of] for band in near]).max(0) > CLOSE
    return [k for k in np.flatnonzero(steady & close).tolist() if k != of]
