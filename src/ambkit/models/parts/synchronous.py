"""Synchronous states at a known speed: unbalance, and runout."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.machine.accessories import SLOWEST
from ambkit.machine.geometry import Line, unbalances_of
from ambkit.models.declaration import Place, Plan, place, row

GRADE = 6.3e-3  #: Expected balance quality grade of a rotor [m/s] (ISO 21940-11).
RUNOUT = 3e-6  #: Assumed runout if none is described [m].
VAGUE = 3.0  #: Initial standard deviation over the expected size where none is described.
DESCRIBED = 0.5**0.5  #: That of each component of a described amount, whose angle is unknown.
MEMORY = 1e5  #: Time in which both may change by their expected size [s].


@dataclass(frozen=True)
class SynchronousForce:
    """Unbalance in a plane: two states, along x and along y."""

    # Its force grows with the square of the speed, its transverse part with the acceleration; the
    # amount is a slow random walk. In the frame of the sensors it is a pair that rotates at the
    # speed, as in a generalised notch (Herzog et al., Unbalance compensation using generalized
    # notch filters, 1996).

    size: float  #: Typical unbalance [kg m].
    growth: float  #: Typical growth in a sample [kg m].
    speed: float  #: Speed of rotation [rad/s].
    name: str  #: Name of the states, with _x and _y.
    along_x: Place  #: Place of the plane along x.
    along_y: Place  #: Place of the plane along y.
    speeding: float = 0.0  #: Angular acceleration [rad/s^2].
    start: float = VAGUE  #: Initial standard deviation, in typical sizes.

    @classmethod
    def of(cls, machine: Any, speeding: float) -> list[SynchronousForce]:
        """Return one for each plane."""
        amounts, speed = described_unbalance(machine), machine.speed
        size = machine.rotor.mass * GRADE / max(abs(speed), SLOWEST) / len(amounts)
        memory = math.sqrt(machine.sampling_time / MEMORY)
        return [
            cls(
                size, (amount or size) * memory, speed, f"U{k}", *across(machine, z), speeding,
                DESCRIBED * amount / size or VAGUE,
            )
            for k, (z, amount) in enumerate(amounts.items(), 1)
        ]  # fmt: skip

    @property
    def rotating(self) -> tuple[str, str, int]:
        """Both states, and their turns per revolution."""
        return f"{self.name}_x", f"{self.name}_y", 1

    def declare(self, plan: Plan) -> None:
        """Add both states, their force, and their noise."""
        x, y, _ = self.rotating
        for state, along, beside, way in (
            (x, self.along_x, self.along_y, -1.0), (y, self.along_y, self.along_x, 1.0)
        ):  # fmt: skip
            plan.state(state, "kg m", self.size, "unbalance", self.start)
            force_inputs = {q: self.speed**2 * item for q, item in row(along).items()}
            if self.speeding:
                force_inputs |= {q: way * self.speeding * item for q, item in row(beside).items()}
            plan.push(state, force_inputs)
        _rotate(plan, x, y, self.speed)
        grown = dict.fromkeys((x, y), 1 / plan.T)
        plan.noise(self.name, "kg m", self.growth, grown, walk=False)


def _rotate(plan: Plan, x: str, y: str, speed: float) -> None:
    plan.rate(x, y, -speed)
    plan.rate(y, x, speed)


@dataclass(frozen=True)
class SynchronousRunout:
    """Runout in the sensors of one plane: two states, cosine and sine of the angle."""

    # It is in front of the sensors' lag. A sensor at a larger angle measures the profile later:
    # order n by n times that angle.

    size: float  #: Typical runout [m].
    growth: float  #: Typical growth in a sample [m].
    speed: float  #: Speed of rotation [rad/s].
    order: int  #: Periods per revolution.
    name: str  #: Name of the states, with _c and _s.
    sensors: tuple[tuple[str, float, float, float, float], ...]
    """For each sensor of the plane: state of the lagged reading, gain [1], lag [s], and cosine and
    sine of n times its angle.
    """
    start: float = VAGUE  #: Initial standard deviation, in typical sizes.

    @classmethod
    def of(cls, machine: Any, speeding: float) -> list[SynchronousRunout]:
        """Return one for each order of a sensor."""
        parts: list[SynchronousRunout] = []
        for sensor in machine.sensors:
            amplitudes = {line.order: line.amplitude for line in sensor.runout} or {1: RUNOUT}
            looking = [r for r in machine.readings if r.sensor is sensor]
            for order, size in amplitudes.items():
                # A quarter farther round: exactly 0 and 1 where they are.
                around = [Line.across(0.0, order * k * math.pi / 2) for k in range(len(looking))]
                seen = tuple(
                    (signal("x_m", r.name), sensor.gain, machine.lag_of(sensor), at.cosine, at.sine)
                    for r, at in zip(looking, around, strict=True)
                )
                walk_std = size * math.sqrt(machine.sampling_time / MEMORY)
                name = signal(f"r{order}", sensor.name)
                start = DESCRIBED if sensor.runout else VAGUE
                parts.append(cls(size, walk_std, machine.speed, order, name, seen, start))
        return parts

    @property
    def rotating(self) -> tuple[str, str, int]:
        """Both states, and their turns per revolution."""
        return f"{self.name}_c", f"{self.name}_s", self.order

    def declare(self, plan: Plan) -> None:
        """Add both states, their contribution to the readings, and their noise."""
        c, s, _ = self.rotating
        for state in (c, s):
            plan.state(state, "m", self.size, "runout", self.start)
        _rotate(plan, c, s, self.order * self.speed)
        for sensor_state, gain, lag, cosine, sine in self.sensors:
            for state, share in ((c, cosine), (s, sine)):
                if share:
                    plan.rate(sensor_state, state, gain * share / lag)
        grown = dict.fromkeys((c, s), 1 / plan.T)
        plan.noise(self.name, "m", self.growth, grown, walk=False)


def across(machine: Any, z: float) -> tuple[Place, Place]:
    """Return a place on the shaft, along x and along y."""
    x, y = (place(machine.line(z, angle).form) for angle in (0.0, math.pi / 2))
    return x, y


def unbalance_planes(machine: Any) -> list[float]:
    """Return the planes of estimated unbalance: one or two described, or the outer bearings."""
    # A rigid rotor has two independent planes, a flexible one another for each mode.
    planes = {item.place for item in machine.unbalance}
    most = 2 if machine.bending is None else 2 + len(machine.bending.frequency)
    if 0 < len(planes) <= most:
        return sorted(planes)
    places = sorted(bearing.place for bearing in machine.bearings if bearing.type == "radial")
    return [places[0], places[-1]]


def described_unbalance(machine: Any) -> dict[float, float]:
    """Return the amount of each of these planes by its place [kg m]; zero if none is described."""
    amounts = dict.fromkeys(unbalance_planes(machine), 0.0)
    usual = max(abs(machine.speed), SLOWEST)
    for z, amount, _ in unbalances_of(machine.unbalance, machine.rotor, usual):
        if z in amounts:
            amounts[z] += amount
    return amounts
