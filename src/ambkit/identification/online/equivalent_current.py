"""The control signal by which ideal iron would pull as a bearing's own magnet does.

ADALINE and least squares learn the constant of the ideal law (paper, eq. 25). A magnet with another
law, or a force map, is put into its words: what is learned is then by how much the magnet is
stronger than described, times the constant of the description.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.machine.magnets import magnet_of

if TYPE_CHECKING:
    from ambkit.machine.machine import Bearing


def is_ideal(bearing: Bearing) -> bool:
    """Whether a bearing's magnet is the ideal law itself."""
    return magnet_of(bearing).ideal


def as_ideal(bearing: Bearing, y: ArrayLike, u: ArrayLike) -> Array:
    """Return the control signal with which ideal iron of the same constant pulls as the magnet."""
    # y (n,) [m]; u (n,) [V]
    m, amplifier, travel = bearing.magnet, bearing.amplifier, bearing.rotor.clearance
    iu = np.clip(amplifier.gain * np.asarray(u), bearing.current_min, bearing.current_max)
    x = np.clip(np.asarray(y) / bearing.sensor.gain, -travel, travel)
    i0, s0 = m.bias_current, m.air_gap
    pull = np.asarray(magnet_of(bearing).force(iu, x)) / m.magnet_constant
    if m.type == "one-sided":
        ideal = (s0 - x) * np.sqrt(np.maximum(pull, 0.0)) - i0
    else:
        # 4 (i0 s0 + i x)(i0 x + i s0) = pull (s0^2 - x^2)^2, of its two roots the one near zero.
        right = pull * (s0**2 - x**2) ** 2 / 4
        root = np.sqrt(np.maximum((i0 * (s0**2 - x**2)) ** 2 + 4 * x * s0 * right, 0.0))
        ideal = 2 * (right - i0**2 * s0 * x) / (i0 * (s0**2 + x**2) + root)
    return np.asarray(ideal / amplifier.gain)
