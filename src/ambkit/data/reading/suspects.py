"""What a log may be and should not: an estimate in the place of the sensor, a rotor that lies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from ambkit.base.units import engineering
from ambkit.data.reading.clock import instant
from ambkit.data.reading.faults import noise
from ambkit.data.signals import TRUTH

Array = NDArray[np.float64]

LIES = 50
"""Samples in a row in which nothing moves, that a rotor in flight does not have."""

MOVES = 20.0
"""Range of a position over its noise, from which on it moves at all."""

RESTS = 6.0
"""Standard deviations of its noise within which a position rests."""


def suspects(t: Array, signals: Mapping[str, Array], units: Mapping[str, str]) -> Iterator[str]:
    """Say what is suspect about the measured position, in sentences.

    Parameters
    ----------
    t : ndarray (n,)
        Times [s].
    signals : mapping of str to ndarray (n,)
        By name, in SI; nothing is said without ``y``.
    units : mapping of str to str
        SI unit of each.
    """
    if "y" not in signals:
        return
    y = signals["y"]
    for name, other in signals.items():
        alike = name not in TRUTH and name != "y" and units.get(name) == units.get("y")
        if alike and _same(y, other):
            yield (
                f"y and {name} hold the same numbers: is y what the sensor shows, or what was made "
                "of it?"
            )
    if "u" in signals:
        yield from _lies(t, y, signals["u"], units.get("y", "m"))


def _same(a: Array, b: Array) -> bool:
    there = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(there) < 2 or np.ptp(a[there]) == 0:
        return False
    return bool(np.abs(a - b)[there].max() <= 1e-9 * np.abs(a[there]).max())


def _lies(t: Array, y: Array, u: Array, unit: str) -> Iterator[str]:
    """Tell of a position that rests at its end while the control signal stands still."""
    there = np.isfinite(y) & np.isfinite(u)
    if np.count_nonzero(there) < LIES:
        return
    rough, seen = noise(y), y[there]
    least, greatest = float(seen.min()), float(seen.max())
    if not greatest - least > MOVES * rough:
        return
    still = np.r_[False, u[1:] == u[:-1]] & there
    for end, near in ((least, y - least), (greatest, greatest - y)):
        start, length = longest_run(still & (near < RESTS * rough))
        if length >= LIES:
            first, last = (
                instant(float(t[k]), float(t[1] - t[0])) for k in (start, start + length - 1)
            )
            yield (
                f"y rests at its end, {engineering(end, unit, digits=3)}, from {first} to {last}, "
                "and u stands still: does the rotor lie on a stop there?"
            )


def longest_run(where: NDArray[np.bool_]) -> tuple[int, int]:
    """Return start and length of the longest stretch that is true (n,); length 0 without one.

    Parameters
    ----------
    where : ndarray (n,)
        Of each sample.
    """
    edges = np.flatnonzero(np.diff(np.r_[False, where, False])).reshape(-1, 2)
    if edges.size == 0:
        return 0, 0
    lengths = edges[:, 1] - edges[:, 0]
    at = int(np.argmax(lengths))
    return int(edges[at, 0]), int(lengths[at])
