"""Sensor noise of first order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class ColouredNoise:
    """Noise on a reading, white noise behind a first-order low pass; stationary."""

    variance: float  #: Variance of the reading's error [m^2].
    bandwidth: float  #: Corner frequency [Hz].
    name: str = "n_y"  #: Name of the state.
    measurement: str = "y"  #: The measurement it is on.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[ColouredNoise]:
        """Return that of each reading that has any."""
        return [
            cls(noise.variance, noise.bandwidth, signal("n_y", r.name), signal("y", r.name))
            for r in machine.readings
            if (noise := r.sensor.coloured_noise)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the state, its noise, and its share of the reading."""
        corner, size = 2 * math.pi * self.bandwidth, math.sqrt(self.variance)
        plan.state(self.name, "m", size, "noise")
        plan.rate(self.name, self.name, -corner)
        plan.noise(self.name, "m", size, {self.name: 2 * corner}, walk=False)
        plan.add_to_reading(self.measurement, {self.name: UNIT})
