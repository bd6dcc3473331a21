"""What turns with the rotor at its known speed: unbalance, and runout."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.machine.angle_sensor import SLOWEST
from ambkit.machine.geometry import Line
from ambkit.models.declaration import Place, Plan, place, row

GRADE = 6.3e-3  #: Expected balance quality grade of a rotor [m/s] (ISO 21940-11).
RUNOUT = 3e-6  #: Runout that is expected where none is described [m].
MEMORY = 1e5  #: Time in which both may change by as much as they are expected to be [s].


@dataclass(frozen=True)
class SynchronousForce:
    """Unbalance in a plane, which goes round with the rotor: two states, along x and along y."""

    # It pushes with the square of the speed, across with the speed's growth, and keeps its size but
    # for a random walk, slow against everything else. In the frame of the sensors it is a pair that
    # turns by the speed, as that of a generalised notch (Herzog et al., Unbalance compensation
    # using generalized notch filters, 1996).

    size: float  #: Typical unbalance [kg m].
    growth: float  #: Typical growth in a sample [kg m].
    speed: float  #: Of rotation [rad/s].
    name: str  #: Of the states, with _x and _y.
    along_x: Place  #: The place in its plane, moved along x.
    along_y: Place  #: And along y.
    speeding: float = 0.0  #: By how much the speed grows [rad/s^2].

    @classmethod
    def of(cls, machine: Any, speeding: float) -> list[SynchronousForce]:
        """Return one for each plane."""
        planes = unbalance_planes(machine)
        speed, usual = machine.speed, max(abs(machine.speed), SLOWEST)
        size = machine.rotor.mass * GRADE / usual / len(planes)
        return [
            cls(
                size, size * math.sqrt(machine.sampling_time / MEMORY), speed, f"U{k}",
                *across(machine, z), speeding,
            )
            for k, z in enumerate(planes, 1)
        ]  # fmt: skip

    @property
    def rotating(self) -> tuple[str, str, int]:
        """Both states, and how often they turn a revolution."""
        return f"{self.name}_x", f"{self.name}_y", 1

    def declare(self, plan: Plan) -> None:
        """Add both states, where they push, and their noise."""
        x, y, _ = self.rotating
        for state, along, beside, way in (
            (x, self.along_x, self.along_y, -1.0), (y, self.along_y, self.along_x, 1.0)
        ):  # fmt: skip
            plan.state(state, "kg m", self.size, "unbalance")
            force_inputs = {q: self.speed**2 * item for q, item in row(along).items()}
            if self.speeding:
                force_inputs |= {q: way * self.speeding * item for q, item in row(beside).items()}
            plan.push(state, force_inputs)
        _turn(plan, x, y, self.speed)
        grown = dict.fromkeys((x, y), 1 / plan.T)
        plan.noise(self.name, "kg m", self.growth, grown, walk=False)


def _turn(plan: Plan, x: str, y: str, speed: float) -> None:
    plan.rate(x, y, -speed)
    plan.rate(y, x, speed)


@dataclass(frozen=True)
class SynchronousRunout:
    """Runout that sensors of one plane see: two states, a cosine and a sine of the angle."""

    # It enters before the sensors' lag. A sensor farther round by some angle sees the profile by so
    # much later: order n by n times that angle.

    size: float  #: Typical runout [m].
    growth: float  #: Typical growth in a sample [m].
    speed: float  #: Of rotation [rad/s].
    order: int  #: How often a revolution.
    name: str  #: Of the states, with _c and _s.
    sensors: tuple[tuple[str, float, float, float, float], ...]
    """Of each sensor that sees it: state of the lagged reading, gain [1], lag [s], and cosine and
    sine of n times the angle by which it is farther round."""

    @classmethod
    def of(cls, machine: Any, speeding: float) -> list[SynchronousRunout]:
        """Return one for each order that a sensor sees."""
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
                name = f"r{order}_{sensor.name}"
                parts.append(cls(size, walk_std, machine.speed, order, name, seen))
        return parts

    @property
    def rotating(self) -> tuple[str, str, int]:
        """Both states, and how often they turn a revolution."""
        return f"{self.name}_c", f"{self.name}_s", self.order

    def declare(self, plan: Plan) -> None:
        """Add both states, their share of the readings, and their noise."""
        c, s, _ = self.rotating
        for state in (c, s):
            plan.state(state, "m", self.size, "runout")
        _turn(plan, c, s, self.order * self.speed)
        for sensor_state, gain, lag, cosine, sine in self.sensors:
            for state, share in ((c, cosine), (s, sine)):
                if share:
                    plan.rate(sensor_state, state, gain * share / lag)
        grown = dict.fromkeys((c, s), 1 / plan.T)
        plan.noise(self.name, "m", self.growth, grown, walk=False)


def across(machine: Any, z: float) -> tuple[Place, Place]:
    """Return a place on the shaft, moved along x and along y."""
    x, y = (place(machine.line(z, angle).form) for angle in (0.0, math.pi / 2))
    return x, y


def unbalance_planes(machine: Any) -> list[float]:
    """Where unbalance is estimated: one or two described planes, or at the outer bearings."""
    # Two planes are all that a rigid rotor has, and one that bends has another for each mode.
    planes = {item.place for item in machine.unbalance}
    most = 2 if machine.bending is None else 2 + len(machine.bending.frequency)
    if 0 < len(planes) <= most:
        return sorted(planes)
    places = sorted(bearing.place for bearing in machine.bearings if bearing.type == "radial")
    return [places[0], places[-1]]
