"""Typical sizes of an axis's quantities, from its bearing."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self


class Typical(NamedTuple):
    """What the descriptors of an axis's parts give as typical sizes."""

    displacement: float  #: Up to where the rotor may go [m].
    velocity: float  #: To which half of the force brings the rotor over that way [m/s].
    force: float  #: Of the magnets at twice the bias current [N].
    current: float  #: Bias current [A].

    @classmethod
    def of(cls, machine: Any) -> Self:
        """Return those of a bearing of one axis."""
        magnet, clearance = machine.magnet, machine.clearance
        force = 4 * magnet.magnet_constant * (magnet.bias_current / magnet.air_gap) ** 2
        speed = math.sqrt(force * clearance / machine.rotor.mass)
        return cls(clearance, speed, force, magnet.bias_current)
