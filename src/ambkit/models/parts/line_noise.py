"""Line noise of a reading: mains, resonance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.coloured_noise import first_order
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class Hum:
    """A stationary oscillator with two states whose amplitude and phase vary."""

    # Both states have the variance amplitude^2 / 2; the first is added to the reading.

    frequency: float  #: Frequency of the line [Hz].
    amplitude: float  #: Amplitude of the reading's error [m], root of twice its variance.
    bandwidth: float  #: Half width of the line [Hz], by which it varies.
    name: str = "hum"  #: Name of the states, with _c and _s for cosine and sine.
    measurement: str = "y"  #: Name of the measurement.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Hum]:
        """Return the lines of each reading: the first is ``hum``, others are ``hum2``, ``hum3``."""
        return [
            cls(
                line.frequency, line.amplitude, line.bandwidth,
                signal(f"hum{k if k > 1 else ''}", r.name), signal("y", r.name),
            )
            for r in machine.readings
            for k, line in enumerate(r.sensor.hum, 1)
        ]  # fmt: skip

    def declare(self, plan: Plan) -> None:
        """Add both states, their noise, and their contribution to the reading."""
        turn, decay = 2 * math.pi * self.frequency, 2 * math.pi * self.bandwidth
        cosine, sine, size = f"{self.name}_c", f"{self.name}_s", self.amplitude / math.sqrt(2)
        for name, role in ((cosine, "noise"), (sine, "noise in quadrature")):
            plan.state(name, "m", size, role)
            plan.rate(name, name, -decay)
        plan.rate(cosine, sine, -turn)
        plan.rate(sine, cosine, turn)
        plan.noise(self.name, "m", size, dict.fromkeys((cosine, sine), 2 * decay), walk=False)
        plan.add_to_reading(self.measurement, {cosine: UNIT})

    def draw(self, T: float, n: int, stream: Any) -> Array:
        """Return n samples of it [m]."""
        # Without a bandwidth, a sine with random phase. Else a stationary phasor ``z(k+1) = exp((j
        # omega - alpha) T) z(k) + noise`` with ``alpha = 2 pi bandwidth``, of the same power.
        phase_step = 2j * math.pi * self.frequency * T
        if self.bandwidth == 0:
            phase = 2 * math.pi * stream.share()
            return np.asarray(self.amplitude * np.cos(phase_step.imag * np.arange(n) + phase))
        pairs = stream.normal(self.amplitude / math.sqrt(2), 2 * n)
        white = pairs[0::2] + 1j * pairs[1::2]
        rate = 2 * math.pi * self.bandwidth * T
        white[1:] *= math.sqrt(-math.expm1(-2 * rate))
        return first_order(np.exp(phase_step - rate), white).real
