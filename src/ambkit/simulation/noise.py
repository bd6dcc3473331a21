"""Noise of a simulated bearing: on the control signal, and on the measured position.

The one is white, the other white, coloured and narrow lines. Each source has a random stream of its
own, so that one does not change another.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing, Sensor
    from ambkit.machine.parts import ColouredNoise, Hum
    from ambkit.simulation.scenario import Scenario

Array = NDArray[np.float64]


def drawn(bearing: Bearing, scenario: Scenario, n: int) -> tuple[Array, Array]:
    """Return the noise on the control signal [V] and on the measurement [m], n samples each."""
    if not scenario.noise:
        return np.zeros(n), np.zeros(n)
    sensor, T = bearing.sensor, bearing.sampling_time
    streams = np.random.SeedSequence([scenario.seed, scenario.run]).spawn(3 + len(sensor.hum))
    on_u, *on_y = (np.random.default_rng(stream) for stream in streams)
    noise_u = on_u.normal(0.0, np.sqrt(bearing.amplifier.noise_variance), n)
    return noise_u, of_sensor(sensor, T, n, on_y)


def of_sensor(sensor: Sensor, T: float, n: int, streams: list[np.random.Generator]) -> Array:
    """Return n samples of the noise of a sensor [m].

    Parameters
    ----------
    sensor : Sensor
        What noise it has.
    T : float
        Sampling time [s].
    n : int
        Samples.
    streams : list of numpy.random.Generator
        Of the white noise, of the coloured one, and of each line.
    """
    on_y, on_coloured, *on_hum = streams
    noise = on_y.normal(0.0, np.sqrt(sensor.noise_variance), n)
    if sensor.coloured_noise is not None:
        noise += coloured(sensor.coloured_noise, T, n, on_coloured)
    for line, on_line in zip(sensor.hum, on_hum, strict=True):
        noise += hum(line, T, n, on_line)
    return noise


def coloured(noise: ColouredNoise, T: float, n: int, rng: np.random.Generator) -> Array:
    """Return n samples of stationary first-order noise, exact at every T [m].

    ``z(k+1) = a z(k) + sqrt((1 - a^2) variance) w(k)`` with ``a = exp(-2 pi bandwidth T)``.

    Parameters
    ----------
    noise : ColouredNoise
        Variance and corner frequency.
    T : float
        Sampling time [s].
    n : int
        Samples.
    rng : numpy.random.Generator
        The random stream.
    """
    white = rng.normal(0.0, math.sqrt(noise.variance), n)
    rate = 2 * math.pi * noise.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(math.exp(-rate), white)


def hum(line: Hum, T: float, n: int, rng: np.random.Generator) -> Array:
    """Return n samples of a narrow line [m].

    Without a bandwidth, a sine of random phase. Else a phasor ``z(k+1) = exp((j omega - alpha) T)
    z(k) + noise`` with ``alpha = 2 pi bandwidth``, stationary and of the same power.

    Parameters
    ----------
    line : Hum
        Frequency, amplitude and bandwidth.
    T : float
        Sampling time [s].
    n : int
        Samples.
    rng : numpy.random.Generator
        The random stream.
    """
    turning = 2j * math.pi * line.frequency * T
    if line.bandwidth == 0:
        phase = rng.uniform(0, 2 * math.pi)
        return np.asarray(line.amplitude * np.cos(turning.imag * np.arange(n) + phase))
    spread = line.amplitude / math.sqrt(2)
    white = rng.normal(0.0, spread, n) + 1j * rng.normal(0.0, spread, n)
    rate = 2 * math.pi * line.bandwidth * T
    white[1:] *= math.sqrt(-math.expm1(-2 * rate))
    return _first_order(np.exp(turning - rate), white).real


def _first_order(pole: complex, white: NDArray[Any]) -> NDArray[Any]:
    """Return ``z(k) = pole z(k-1) + white(k)``."""
    from scipy.signal import lfilter  # most of what a start of ambkit would take, and rarely needed

    return np.asarray(lfilter([1.0], [1.0, -pole], white))
