"""Noise of a simulated bearing: on the control signal, and on the measured position.

The one is white, the other white, coloured and narrow lines. Each source has a random stream of its
own, so that one does not change another. Streams are counters (``sim/noise.h``): a sample of it
is a function of seed, run, stream and its own number, whoever draws it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.machine.magnets import core_module

if TYPE_CHECKING:
    from ambkit.machine.accessories import ColouredNoise, Hum
    from ambkit.machine.bearing import Sensor
    from ambkit.machine.machine import Bearing, Machine
    from ambkit.simulation.scenario import Scenario


CONTROL, SENSOR = 0, 1
"""Streams of an axis and its reading: of the control signal, and of the sensor from here on."""

STREAMS = 64
"""Of each axis and its reading."""


@dataclass(frozen=True)
class Stream:
    """One stream of random numbers."""

    seed: int  #: From 0 to below 2^64.
    run: int = 0
    number: int = 0  #: Of the stream.

    def next(self, by: int = 1) -> Stream:
        """Return the stream that is so many farther."""
        return replace(self, number=self.number + by)

    def normal(self, std: float, n: int) -> Array:
        """Return the first n normal numbers of this standard deviation."""
        return np.asarray(std * core_module().normal_noise(self.seed, self.run, self.number, n))

    def share(self) -> float:
        """Return one number from 0 to below 1."""
        low, high = (item % 2**32 for item in (self.run, self.run >> 32))
        key = [self.seed % 2**32, self.seed >> 32]
        return int(core_module().philox([0, self.number, low, high], key)[0]) / 2**32


def drawn(machine: Machine, scenario: Scenario, n: int) -> tuple[Array, Array]:
    """Return the noise on the control signals (n, p) [V] and on the readings (n, m) [m]."""
    axes, readings = machine.axes, machine.readings
    noise_u, noise_y = np.zeros((n, len(axes))), np.zeros((n, len(readings)))
    if not scenario.noise:
        return noise_u, noise_y
    stream = Stream(scenario.seed, scenario.run, CONTROL)
    for k, axis in enumerate(axes):
        std = math.sqrt(axis.bearing.amplifier.noise_variance)
        noise_u[:, k] = stream.next(STREAMS * k).normal(std, n)
    for k, reading in enumerate(readings):
        own = stream.next(STREAMS * k + SENSOR)
        noise_y[:, k] = of_sensor(reading.sensor, machine.sampling_time, n, own)
    return noise_u, noise_y


def white(bearing: Bearing, scenario: Scenario) -> tuple[float, float] | None:
    """Return the standard deviations of the noise on control signal [V] and measurement [m]."""
    # They are all that there is to know of `drawn`; None where the sensor has noise that is not
    # white.
    if not scenario.noise:
        return 0.0, 0.0
    sensor = bearing.sensor
    if sensor.coloured_noise is not None or sensor.hum:
        return None
    return math.sqrt(bearing.amplifier.noise_variance), math.sqrt(sensor.noise_variance)


def of_sensor(sensor: Sensor, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of the noise of a sensor [m]."""
    noise = stream.normal(math.sqrt(sensor.noise_variance), n)
    if sensor.coloured_noise is not None:
        noise += coloured(sensor.coloured_noise, T, n, stream.next())
    for place, line in enumerate(sensor.hum):
        noise += hum(line, T, n, stream.next(2 + place))
    return noise


def coloured(noise: ColouredNoise, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of stationary first-order noise, exact at every T [m]."""
    # ``z(k+1) = a z(k) + sqrt((1 - a^2) variance) w(k)`` with ``a = exp(-2 pi bandwidth T)``.
    white = stream.normal(math.sqrt(noise.variance), n)
    rate = 2 * math.pi * noise.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(math.exp(-rate), white)


def hum(line: Hum, T: float, n: int, stream: Stream) -> Array:
    """Return n samples of a narrow line [m]."""
    # Without a bandwidth, a sine of random phase. Else a phasor ``z(k+1) = exp((j omega - alpha) T)
    # z(k) + noise`` with ``alpha = 2 pi bandwidth``, stationary and of the same power.
    phase_step = 2j * math.pi * line.frequency * T
    if line.bandwidth == 0:
        phase = 2 * math.pi * stream.share()
        return np.asarray(line.amplitude * np.cos(phase_step.imag * np.arange(n) + phase))
    pairs = stream.normal(line.amplitude / math.sqrt(2), 2 * n)
    white = pairs[0::2] + 1j * pairs[1::2]
    rate = 2 * math.pi * line.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(np.exp(phase_step - rate), white).real


def _first_order(pole: complex, white: NDArray[Any]) -> NDArray[Any]:
    """Return ``z(k) = pole z(k-1) + white(k)``."""
    from scipy.signal import lfilter  # most of what a start of ambkit would take, and rarely needed

    return np.asarray(lfilter([1.0], [1.0, -pole], white))
