"""What a loop asks of its machine: room that is moved in, copper loss, and the load it can bear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.machine.magnets import magnet_of
from ambkit.models.linear import Complex

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.simulation.linear.closed import Loop
    from ambkit.simulation.linear.pieces import WorkPoint

Array = NDArray[np.float64]

ROOM = (("A", 0.3), ("B", 0.4), ("C", 0.5))
"""Zones of ISO 14839-2, and the shares of the least clearance below which the displacement is."""

HIGHEST = 0.8
"""Of half the sampling rate, up to where loads are looked at."""

SIGMAS = 3.0
"""Of noise, what a peak is taken for."""


@dataclass(frozen=True, eq=False)
class Capacity:
    """The harmonic load that a loop bears at a frequency before something is at its limit.

    Attributes
    ----------
    frequency : ndarray (k,)
        Frequencies [Hz].
    current : ndarray (k,)
        Amplitude of the load at which the current comes to its limit [N], with what holds the rotor
        and noise in it.
    displacement : ndarray (k,)
        At which the rotor leaves zone A of ISO 14839-2 [N].
    voltage : ndarray (k,) or None
        At which the amplifier's voltage is at its limit [N]; None where there is none.
    static : tuple of float
        Least and greatest constant load that a current within the range holds [N].
    """

    frequency: Array
    current: Array
    displacement: Array
    voltage: Array | None
    static: tuple[float, float]

    @property
    def least(self) -> tuple[float, float]:
        """The smallest load that brings something to its limit [N], and its frequency [Hz]."""
        all_ = [self.current, self.displacement]
        worst = np.min([*all_, *([] if self.voltage is None else [self.voltage])], axis=0)
        at = int(np.argmin(worst))
        return float(worst[at]), float(self.frequency[at])


@dataclass(frozen=True, eq=False)
class Demands:
    """What a stable loop asks of its machine at its work point.

    Attributes
    ----------
    displacement : float
        Greatest displacement from the centre: where the rotor is held, runout at all its orders,
        and three times the noise's rms [m].
    clearance : float
        To the stops [m].
    current : float
        Greatest control current, likewise [A].
    copper_loss : float or None
        In the coils [W]; None where the resistance is not known.
    capacity : Capacity
        What load it bears beside.

    References
    ----------
    ISO 14839-2, Mechanical vibration: Vibration of rotating machinery equipped with active magnetic
    bearings, Part 2: Evaluation of vibration.
    """

    displacement: float
    clearance: float
    current: float
    copper_loss: float | None
    capacity: Capacity

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-2, A to D."""
        share = self.displacement / self.clearance
        return next((name for name, limit in ROOM if share < limit), "D")


def demands(
    loop: Loop, bearing: Bearing, point: WorkPoint, current_noise: float, position_noise: float
) -> Demands:
    """Return what a stable loop of one axis asks of its machine.

    Linear, and of the ideal coil: the voltage is that of its resistance and of its flux
    ``2 k i/s``, which current and motion change.

    Parameters
    ----------
    loop : Loop
        Stable.
    bearing : Bearing
        Gives limits, resistance and runout.
    point : WorkPoint
        Where it is.
    current_noise, position_noise : float
        Standard deviations of the demanded current [A] and of the position [m].
    """
    x_of_runout, i_of_runout = _of_runout(loop, bearing)
    displacement = abs(point.x) + float(x_of_runout.sum()) + SIGMAS * position_noise
    swing = float(i_of_runout.sum()) + SIGMAS * current_noise
    square = point.iu**2 + current_noise**2 + float((i_of_runout**2).sum()) / 2
    i0, R = bearing.magnet.bias_current, bearing.amplifier.resistance
    two = bearing.magnet.type == "two-sided"
    whole = 2 * (i0**2 + square) if two else (i0 + point.iu) ** 2 + square - point.iu**2
    return Demands(
        displacement, bearing.rotor.travel_limit, abs(point.iu) + swing,
        None if R is None else R * whole,
        _capacity(loop, bearing, point, displacement, swing),
    )  # fmt: skip


def _of_runout(loop: Loop, bearing: Bearing) -> tuple[Array, Array]:
    """Return amplitudes of position [m] and demanded current [A] by each order of the runout."""
    lines = bearing.sensor.runout if bearing.speed else ()
    if not lines:
        return np.zeros(1), np.zeros(1)
    f = np.array([line.order * (bearing.speed or 0.0) / (2 * math.pi) for line in lines])
    size = np.array([line.amplitude for line in lines]) * bearing.sensor.gain
    size = size / np.abs(1 + 2j * math.pi * f * bearing.sensor_lag)
    x = np.abs(loop.noise_to_position(f)[:, 0, 0]) * size
    u = np.abs(loop.noise_to_control(f)[:, 0, 0]) * size
    return x, bearing.amplifier.gain * u


def _capacity(
    loop: Loop, bearing: Bearing, point: WorkPoint, displacement: float, swing: float
) -> Capacity:
    f = np.geomspace(1e-3 * loop.nyquist, HIGHEST * loop.nyquist, 400)
    x = loop.compliance(f)[:, 0, 0]
    i = bearing.amplifier.gain * loop.control_by_load(f)[:, 0, 0]
    room = min(bearing.current_max - point.iu, point.iu - bearing.current_min) - swing
    way = ROOM[0][1] * bearing.rotor.travel_limit - displacement
    law = magnet_of(bearing)
    ends = [
        -float(law.force(iu, point.x)) - bearing.weight
        for iu in (bearing.current_max, bearing.current_min)
    ]
    return Capacity(
        f, max(room, 0.0) / np.abs(i), max(way, 0.0) / np.abs(x),
        _by_voltage(bearing, point, f, i, x), (min(ends), max(ends)),
    )  # fmt: skip


def _by_voltage(
    bearing: Bearing, point: WorkPoint, f: Array, i: Complex, x: Complex
) -> Array | None:
    """Return the load at which a coil's voltage is at its limit [N], by i [A/N] and x [m/N]."""
    amplifier, magnet = bearing.amplifier, bearing.magnet
    limit, R, bandwidth = amplifier.voltage_limit, amplifier.resistance, amplifier.bandwidth
    if limit is None or R is None or bandwidth is None:  # they come together
        return None
    s = 2j * math.pi * f
    flowing = i / (1 + 1j * f / bandwidth)
    loads = []
    for side in (1.0, -1.0) if magnet.type == "two-sided" else (1.0,):
        gap, current = magnet.air_gap - side * point.x, magnet.bias_current + side * point.iu
        flux = 2 * magnet.magnet_constant / gap * (flowing + current / gap * x)
        room = limit - R * current
        loads.append(room / np.abs(R * flowing + s * flux))
    return np.asarray(np.min(loads, axis=0), float)
