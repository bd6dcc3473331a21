"""First-order sensor noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class ColouredNoise:
    """Noise on a reading, white noise behind a first-order low pass; stationary."""

    variance: float  #: Variance of the reading's error [m^2].
    bandwidth: float  #: Corner frequency [Hz].
    name: str = "n_y"  #: Name of the state.
    measurement: str = "y"  #: Name of the measurement.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[ColouredNoise]:
        """Return that of each reading that has coloured noise."""
        return [
            cls(noise.variance, noise.bandwidth, signal("n_y", r.name), signal("y", r.name))
            for r in machine.readings
            if (noise := r.sensor.coloured_noise)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the state, its noise, and its contribution to the reading."""
        corner, size = 2 * math.pi * self.bandwidth, math.sqrt(self.variance)
        plan.state(self.name, "m", size, "noise")
        plan.rate(self.name, self.name, -corner)
        plan.noise(self.name, "m", size, {self.name: 2 * corner}, walk=False)
        plan.add_to_reading(self.measurement, {self.name: UNIT})

    def draw(self, T: float, n: int, stream: Any) -> Array:
        """Return n samples, exact at every T [m]."""
        # ``z(k+1) = a z(k) + sqrt((1 - a^2) variance) w(k)`` with ``a = exp(-2 pi bandwidth T)``.
        white = stream.normal(math.sqrt(self.variance), n)
        rate = 2 * math.pi * self.bandwidth * T
        white[1:] *= math.sqrt(-math.expm1(-2 * rate))
        return first_order(math.exp(-rate), white)


def first_order(pole: complex, white: NDArray[Any]) -> NDArray[Any]:
    """Return ``z(k) = pole z(k-1) + white(k)``."""
    from scipy.signal import lfilter  # dominates the start of ambkit, and is rarely needed

    return np.asarray(lfilter([1.0], [1.0, -pole], white))
