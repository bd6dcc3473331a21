"""Typical sizes of an axis's quantities."""

import math
from typing import Any, NamedTuple, Self


class Typical(NamedTuple):
    """Typical sizes for the descriptors of an axis's parts."""

    displacement: float  #: Clearance [m].
    velocity: float  #: Velocity after accelerating with half of the force over that distance [m/s].
    force: float  #: Magnet force at twice the bias current [N].
    current: float  #: Bias current [A].

    @classmethod
    def of(cls, machine: Any) -> Self:
        """Return those of a machine with one axis."""
        magnet, clearance = machine.magnet, machine.clearance
        force = 4 * magnet.magnet_constant * (magnet.bias_current / magnet.air_gap) ** 2
        speed = math.sqrt(force * clearance / machine.rotor.mass)
        return cls(clearance, speed, force, magnet.bias_current)
