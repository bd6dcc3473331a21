"""Whirl of a free rotor with its gyroscopics: with all of its modes, and with those that are kept.

Bending modes at rest are exact; with the speed gyroscopics couple them, those that are left out
too. So a kept set is compared with the full matrices at speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ambkit.machine.rotors.modes import Bending

Array = NDArray[np.float64]

RANGE = 2000.0
"""Up to there ISO 14839-3 looks at least [Hz], or up to three times the speed."""

BEYOND = 1.15
"""Up to which multiple of its speed a machine is compared, as it is run in a test [1]."""

SPARE = 1.25
"""Up to which multiple of the range modes are kept: their tails reach into it [1]."""

SHARP = 0.01
"""Of the tolerance, the share that a whirl may be off: a regulator that knows a mode is as sharp as
the mode is damped, and near it the sensitivity is off by many times the whirl's share [1]."""

STEPS = 3
"""Speeds at which whirls are compared: errors grow with the speed."""

STILL = 1e-6
"""Of the first bending mode, below which a whirl is a rigid translation."""


class OfRotor(Protocol):
    """What is used of a rotor by its matrices."""

    @property
    def mass(self) -> float:
        """Mass [kg]."""

    @property
    def transverse_inertia(self) -> float:
        """About the centre of mass [kg m^2]."""

    @property
    def every_mode(self) -> Bending:
        """All bending modes of the matrices."""


class WhirlError(NamedTuple):
    """Where the whirl of the kept modes is farthest from that of the full matrices."""

    share: float = 0.0
    """Of the frequency [1]."""
    kept: float = math.nan
    """Frequency with the modes kept [rad/s]."""
    full: float = math.nan
    """Frequency with the full matrices, negative backwards [rad/s]."""
    speed: float = 0.0
    """At which speed of rotation [rad/s]."""
    left_out: float = math.nan
    """Whirl within the range that the kept modes do not have, negative backwards [rad/s]; NaN:
    there is none."""
    left_out_at: float = 0.0
    """At which speed of rotation [rad/s]."""

    @property
    def error(self) -> float:
        """The share [1]; infinite where a whirl is left out."""
        return self.share if math.isnan(self.left_out) else math.inf


def end_of_range(T: float, speed: float | None = None) -> float:
    """Return up to where the standard looks at a loop [Hz]."""
    return min(max(RANGE, 3 * abs(speed or 0.0) / (2 * math.pi)), 0.5 / T)


def speeds_of(speed: float) -> Array:
    """Return the speeds at which a machine of a speed is compared, but for rest [rad/s]."""
    return np.linspace(0.0, BEYOND * abs(speed), STEPS + 1)[1:] if speed else np.zeros(0)


def whirl(rotor: OfRotor, bending: Bending, speed: float, modes: int | None = None) -> Array:
    """Return the whirl frequencies of the free, undamped rotor, ascending [rad/s]."""
    # returns (2 (2 + modes),)
    n = len(bending.frequency) if modes is None else modes
    mass = np.concatenate([[rotor.mass, rotor.transverse_inertia], bending.mass[:n]])
    gyroscopic = np.zeros((n + 2, n + 2))
    gyroscopic[1:, 1:] = speed * bending.polar[: n + 1, : n + 1]
    gyroscopic /= np.sqrt(np.outer(mass, mass))
    own = np.diag(np.concatenate([[0.0, 0.0], bending.frequency[:n]]))
    return np.linalg.eigvalsh(np.block([[np.zeros_like(own), own], [own, gyroscopic]]))


def whirl_error(
    rotor: OfRotor, reduced_bending: Bending, highest: float, speeds: Sequence[float] | Array,
    modes: int | None = None,
) -> WhirlError:  # fmt: skip
    """Return where the whirl of kept modes is farthest from that of the full matrices."""
    worst, still = WhirlError(), STILL * float(reduced_bending.frequency[0])
    for speed in map(float, speeds):
        full, some = (
            whirl(rotor, bending, speed, count)
            for bending, count in ((rotor.every_mode, None), (reduced_bending, modes))
        )
        for way in (1.0, -1.0):
            right, result = (np.sort(way * item[way * item > still]) for item in (full, some))
            right = right[right <= 2 * math.pi * highest]
            n = min(len(right), len(result))
            if n < len(right):
                worst = worst._replace(left_out=way * float(right[n]), left_out_at=speed)
            shares = np.abs(result[:n] / right[:n] - 1)
            if n and shares.max() > worst.share:
                k = int(np.argmax(shares))
                worst = worst._replace(
                    share=float(shares[k]), kept=float(result[k]), full=way * float(right[k]),
                    speed=speed,
                )  # fmt: skip
    return worst


def enough(rotor: OfRotor, T: float, speed: float, tolerance: float) -> float:
    """Return up to which frequency to keep modes, so that whirls and sensitivity are right [Hz]."""
    # All modes within the range of ISO 14839-3 and a quarter beyond are kept, and so many more that
    # every whirl in that range is right up to `BEYOND` times the speed, to the share `SHARP` of the
    # tolerance; none is faster than half the sampling rate.
    every = rotor.every_mode
    f = every.frequency / (2 * math.pi)
    highest, speeds = end_of_range(T, speed), speeds_of(speed)
    seen = max(1, int(np.count_nonzero(f < 0.5 / T)))
    n = min(seen, max(1, int(np.count_nonzero(f <= SPARE * highest))))
    sharp = SHARP * tolerance
    while n < seen and whirl_error(rotor, every, highest, speeds, n).error > sharp:
        n += 1
    return above(f, n)


def above(f: Array, n: int) -> float:
    """Return a round frequency between the n-th of these and the next [Hz]."""
    if n == len(f):
        return 1.01 * float(f[-1])
    between = math.sqrt(f[n - 1] * f[n])
    rounded = float(f"{between:.3g}")
    return rounded if f[n - 1] < rounded < f[n] else between
