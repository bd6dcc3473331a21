"""Sensor noise of first order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Plan


@dataclass(frozen=True)
class ColouredNoise:
    """Noise on a reading, white noise behind a first-order low pass; stationary."""

    variance: float
    """Variance of the reading's error [m^2]."""
    bandwidth: float
    """Corner frequency [Hz]."""
    name: str = "n_y"
    """Name of the state."""
    measurement: str = "y"
    """The measurement it is on."""

    @classmethod
    def of_axis(cls, bearing: Any, typical: Typical) -> list[ColouredNoise]:
        """Return the sensor's, if it has any."""
        noise = getattr(bearing.sensor, "coloured_noise", None)
        return [cls(noise.variance, noise.bandwidth)] if noise else []

    def declare(self, plan: Plan) -> None:
        """Add the state, its noise, and its share of the reading."""
        corner, size = 2 * math.pi * self.bandwidth, math.sqrt(self.variance)
        plan.state(self.name, "m", size, "noise")
        plan.rate(self.name, self.name, -corner)
        plan.noise(self.name, "m", size, {self.name: 2 * corner}, walk=False)
        plan.add_to_reading(self.measurement, {self.name: UNIT})
