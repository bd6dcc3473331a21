"""Demands of a loop on its machine: displacement, copper loss, load capacity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Complex
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint, unbalance_columns
from ambkit.machine.accessories import REFERENCE, Coil
from ambkit.machine.axes import isolated_axes, weights_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of


@dataclass(frozen=True)
class Heating:
    """Hottest coil of an axis in continuous operation at its operating point."""

    # Incropera, DeWitt, Fundamentals of heat and mass transfer, chapter 5 (the lumped capacitance);
    # IEC 60028 for the temperature coefficient of annealed copper, 3.93e-3 1/K at 20 degrees
    # Celsius.

    temperature: float  #: Of the coil [K]; infinite for thermal runaway.
    limit: float | None  #: Permissible temperature [K]; None if unknown.
    #: Loss of the axis's coils at their temperatures [W]; infinite for thermal runaway.
    loss: float
    #: Time until the limit at maximum current from there on [s]; infinite if it is never reached,
    #: None if time constant or limit are unknown.
    until_limit: float | None


def heating(machine: Machine, squares: list[float]) -> Heating | None:
    """Return the steady-state temperature of the coils of an axis."""
    # A coil at the temperature ``Th`` has the resistance ``R (1 + a (Th - 293.15 K))``, and takes
    # the loss of its mean square of the current times that. Cooled by ``(Th - ambient)/R_th`` it
    # rests at
    # ``Th = (ambient + R_th P (1 - a 293.15 K))/(1 - R_th P a)``, ``P = R I^2``,
    # where the resistance's growth is in it; with ``R_th P a`` of 1 or more it never rests.
    coil, R = machine.coil, machine.amplifier.resistance
    if coil is None or R is None:
        return None
    parts = [at_rest(coil, R * square) for square in squares]
    losses = [
        R * square * (1 + coil.temperature_coefficient * (at - REFERENCE))
        for square, at in zip(squares, parts, strict=True)
    ]
    most = (machine.magnet.bias_current + machine.current_max) ** 2
    return Heating(
        max(parts), coil.temperature_limit, math.fsum(losses) if math.isfinite(max(parts)) else
        math.inf, _until_limit(coil, R * most, max(parts)),
    )  # fmt: skip


def at_rest(coil: Coil, power: float) -> float:
    """Return the steady-state temperature of a coil [K]; infinite for thermal runaway."""
    left, rest = _balance(coil, power)
    return math.inf if left <= 0 else rest / left


def _balance(coil: Coil, power: float) -> tuple[float, float]:
    """Return the coefficients of a coil's temperature [1], [K]: ``tau Th' = rest - left Th``."""
    rise = coil.thermal_resistance * power
    left = 1 - rise * coil.temperature_coefficient
    return left, coil.ambient + rise * (1 - coil.temperature_coefficient * REFERENCE)


def _until_limit(coil: Coil, power: float, start: float) -> float | None:
    """Return the time that a loss may last from a temperature on [s]."""
    tau, limit = coil.time_constant, coil.temperature_limit
    if tau is None or limit is None:
        return None
    if start >= limit:
        return 0.0
    left, rest = _balance(coil, power)
    fast, slow = rest - left * start, rest - left * limit  # tau Th' at both ends
    if slow <= 0:
        return math.inf
    if abs(left) < 1e-9:
        return tau * (limit - start) / rest
    return tau / left * math.log(fast / slow)


ROOM = (("A", 0.3), ("B", 0.4), ("C", 0.5))
"""Zones of ISO 14839-2, and their limits as shares of the least clearance."""

HIGHEST = 0.8  #: Highest frequency of the loads, over half the sampling rate.
SIGMAS = 3.0  #: Standard deviations of noise that count as its peak.


@dataclass(frozen=True, eq=False)
class Capacity:
    """Harmonic load capacity of a loop at a frequency, until something reaches its limit."""

    frequency: Array  #: (k,) Frequencies [Hz].
    #: Amplitude of the load at which the current reaches its limit [N], including levitation
    #: current and noise.
    current: Array
    displacement: Array  #: (k,) At which the rotor leaves zone A of ISO 14839-2 [N].
    #: (k,) At which the amplifier's voltage reaches its limit [N]; None without limit.
    voltage: Array | None
    #: Least and greatest constant load that currents in the range hold [N].
    static: tuple[float, float]

    @property
    def least(self) -> tuple[float, float]:
        """The smallest load that reaches a limit [N], and its frequency [Hz]."""
        all_ = [self.current, self.displacement]
        worst = np.min([*all_, *([] if self.voltage is None else [self.voltage])], axis=0)
        at = int(np.argmin(worst))
        return float(worst[at]), float(self.frequency[at])


@dataclass(frozen=True, eq=False)
class Demands:
    """Demands of a stable loop on an axis of its machine at its operating point."""

    # ISO 14839-2, Mechanical vibration: Vibration of rotating machinery equipped with active
    # magnetic bearings, Part 2: Evaluation of vibration.

    #: Greatest displacement from the centre: where the rotor is held, unbalance, runout at all its
    #: orders, and three times the noise's rms [m].
    displacement: float
    clearance: float  #: To the stops [m].
    current: float  #: Maximum control current, likewise [A].
    #: In the coils [W], at their temperatures if known; None without a resistance.
    copper_loss: float | None
    heating: Heating | None  #: Their temperatures; None if unknown.
    capacity: Capacity  #: Load capacity beside these.

    @property
    def zone(self) -> str:
        """Zone of ISO 14839-2, A to D."""
        share = self.displacement / self.clearance
        return next((name for name, limit in ROOM if share < limit), "D")


class HarmonicResponse(NamedTuple):
    """Response along one line to an excitation at a multiple of the speed: complex amplitudes."""

    x: Complex  #: Displacements (p,) of the axes [m].
    i: Complex  #: Commanded currents (p,) [A].


def demands(
    loop: Loop,
    of: Machine,
    point: OperatingPoint,
    current_noise: Array,
    position_noise: Array,
    responses: Sequence[HarmonicResponse],
) -> list[Demands]:
    """Return the demands of a stable loop on each axis of its machine."""
    # Linear, and of the ideal coil: the voltage is that of its resistance and of its flux ``2 k
    # i/s``, which current and motion change. Of a radial bearing the displacement is that of the
    # orbit.
    # current_noise (p,) [A]; position_noise (p,) [m]
    isolated, iu = isolated_axes(of), np.atleast_1d(point.iu)
    displacement, swing, square = swings(
        point, synchronous_pairs(of), current_noise, position_noise, responses
    )
    capacities = _capacities(loop, of, point, displacement, swing)
    results = []
    for k, b in enumerate(isolated):
        R, coils = b.amplifier.resistance, coil_current_squares(b, float(iu[k]), float(square[k]))
        warm = heating(b, coils)
        loss = None if R is None else R * sum(coils) if warm is None else warm.loss
        far, most = float(displacement[k]), float(abs(iu[k]) + swing[k])
        results.append(Demands(far, b.clearance, most, loss, warm, capacities[k]))
    return results


def swings(
    point: OperatingPoint, pairs: Sequence[Sequence[int]], current_noise: Array,
    position_noise: Array, responses: Sequence[HarmonicResponse],
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return displacement [m], swing and mean square of the current of each axis [A], [A^2]."""
    # current_noise (p,) [A]; position_noise (p,) [m]
    displacement = orbit(np.atleast_1d(point.x), pairs) + SIGMAS * position_noise
    swing, square = SIGMAS * current_noise, np.atleast_1d(point.iu) ** 2 + current_noise**2
    for response in responses:
        displacement = displacement + orbit(response.x, pairs)
        swing = swing + np.abs(response.i)
        square = square + np.abs(response.i) ** 2 / 2
    return displacement, swing, square


def coil_current_squares(machine: Machine, iu: float, square: float) -> list[float]:
    """Return the mean squares of the currents of an axis's coils [A^2]."""
    swinging = square - iu**2
    sides = (1.0, -1.0) if machine.magnet.type == "two-sided" else (1.0,)
    return [(machine.magnet.bias_current + side * iu) ** 2 + swinging for side in sides]


def _capacities(
    loop: Loop, of: Machine, point: OperatingPoint, displacement: Array, swing: Array
) -> list[Capacity]:
    """Return the load capacity along each axis; a load moves all axes."""
    isolated, pairs, weights = isolated_axes(of), synchronous_pairs(of), weights_of(of)
    x0, iu = np.atleast_1d(point.x), np.atleast_1d(point.iu)
    f = np.geomspace(1e-3 * loop.nyquist, HIGHEST * loop.nyquist, 400)
    gains = np.array([b.amplifier.gain for b in isolated])
    all_x, all_i = loop.compliance(f), gains[:, None] * loop.control_by_load(f)
    ends = np.array([[b.current_max, b.current_min] for b in isolated])
    room = np.maximum(np.abs(ends - iu[:, None]).min(axis=1) - swing, 0.0)
    limits = np.array([b.clearance for b in isolated])
    way = np.maximum(ROOM[0][1] * limits - displacement, 0.0)
    results = []
    for k, b in enumerate(isolated):
        x, i, law = all_x[:, :, k], all_i[:, :, k], magnet_of(b)
        limited = [
            np.min([room / volts for room, volts in coils], axis=0)
            for n, one in enumerate(isolated)
            if (coils := voltage(one, iu[n], x0[n], f, i[:, n], x[:, n])) is not None
        ]
        held = sorted(-float(law.force(end, float(x0[k]))) - weights[k] for end in ends[k])
        results.append(
            Capacity(
                f,
                _reached(room, np.abs(i)),
                _reached(way, orbit(x, pairs)),
                np.min(limited, axis=0) if limited else None,
                (held[0], held[1]),
            )
        )
    return results


def _reached(room: Array, unit_demand: Array) -> Array:
    """Return the load (k,) [N] that exhausts the margin of an axis (p,); 1 N takes (k, p)."""
    loads = np.divide(
        room, unit_demand, out=np.full(unit_demand.shape, np.inf), where=unit_demand > 0
    )
    return np.asarray(loads.min(axis=1))


def orbit(x: NDArray[Any], pairs: Sequence[Sequence[int]]) -> Array:
    """Return the largest distance from the centre of displacements (..., p) within a turn [m]."""
    # Of the two axes of a radial bearing that is the orbit's greater half axis.
    # x (..., p) [m]
    far: Array = np.abs(x).astype(float)
    for of in pairs:
        if len(of) == 2:
            a, b = x[..., of[0]], x[..., of[1]]
            far[..., list(of)] = ((np.abs(a + 1j * b) + np.abs(a - 1j * b)) / 2)[..., None]
    return far


def synchronous_pairs(of: Machine) -> list[tuple[int, ...]]:
    """Return the axes of each bearing, by their numbers."""
    bearings = [axis.bearing for axis in of.axes]
    return [
        tuple(k for k, bearing in enumerate(bearings) if bearing is one)
        for one in dict.fromkeys(of.bearings)
    ]


def of_runout(loop: Loop, of: Machine) -> list[HarmonicResponse]:
    """Return the response to each order of each sensor's runout."""
    speed, gains = abs(of.speed), [b.amplifier.gain for b in isolated_axes(of)]
    if not speed:
        return []
    readings = [(r.sensor, of.lag_of(r.sensor)) for r in of.readings]
    results = []
    for sensor in dict.fromkeys(at for at, _ in readings):
        for line in sensor.runout:
            f = line.order * speed / (2 * math.pi)
            added, turn = np.zeros(len(readings), complex), 0
            for k, (at, lag) in enumerate(readings):
                if at is sensor:
                    # The next reading is a quarter turn ahead.
                    late = np.exp(-0.5j * math.pi * line.order * turn)
                    added[k] = line.amplitude * at.gain * late / (1 + 2j * math.pi * f * lag)
                    turn += 1
            x, u = loop.noise_to_position([f])[0] @ added, loop.noise_to_control([f])[0] @ added
            results.append(HarmonicResponse(x, np.array(gains) * u))
    return results


def of_unbalance(loop: Loop, machine: Machine, point: OperatingPoint) -> HarmonicResponse:
    """Return the response to a machine's unbalance at its speed."""
    planes = machine.unbalances()
    columns = unbalance_columns(machine, point, [z for z, _, _ in planes])
    unbalance = np.array([amount * np.exp(1j * angle) for _, amount, angle in planes])
    x, u = loop.driven(columns @ unbalance, machine.speed / (2 * math.pi))
    return HarmonicResponse(x, np.array([b.amplifier.gain for b in isolated_axes(machine)]) * u)


def voltage(
    machine: Machine, iu: float, at: float, f: Array, i: Complex, x: Complex
) -> list[tuple[float, Array]] | None:
    """Return for each coil of an axis the voltage left to harmonics, and their demand."""
    # f (k,) [Hz]; i (k,) [A]; x (k,) [m]
    amplifier, magnet = machine.amplifier, machine.magnet
    limit, R, bandwidth = amplifier.voltage_limit, amplifier.resistance, amplifier.bandwidth
    if limit is None or R is None or bandwidth is None:  # given together
        return None
    s = 2j * math.pi * f
    flowing = i / (1 + 1j * f / bandwidth)
    results = []
    for side in (1.0, -1.0) if magnet.type == "two-sided" else (1.0,):
        gap, current = magnet.air_gap - side * at, magnet.bias_current + side * iu
        flux = 2 * magnet.magnet_constant / gap * (flowing + current / gap * x)
        results.append((limit - R * current, np.abs(R * flowing + s * flux)))
    return results
