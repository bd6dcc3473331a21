"""Geometry of a rotor: its coordinates, the axes of its bearings, its readings.

The coordinates are q = (x, y, th_x, th_y), and z with a thrust bearing; a point of the shaft at z
moves by ``x + z th_y`` and ``y - z th_x``. A flexible rotor adds m1_x, m1_y and so on, with
``phi_1(z) m1_x`` and ``phi_1(z) m1_y``: the deflection of each mode where its shape is largest, in
both planes. All are relative to the static shape of the levitated rotor, bent by its weight, at
which the sensors are set to zero; the remaining effect of the weight is that of forces along the
axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.components import BearingAt, Body, SensorAt, Unbalance
from ambkit.machine.parts import along_x
from ambkit.machine.rotors.modes import Bending

POSITIONS = ("x", "y", "th_x", "th_y")  #: The radial coordinates [m, m, rad, rad].


class Line(NamedTuple):
    """A direction at a place, of a magnet force or a sensor."""

    place: float  #: Position from the centre of mass [m].
    cosine: float  #: Cosine of its angle from x; NaN along the shaft.
    sine: float  #: Sine of its angle from x; NaN along the shaft.
    shape: tuple[float, ...] = ()
    """Mode shapes there, with maximum 1 [1]."""

    @classmethod
    def across(cls, place: float, angle: float, shape: tuple[float, ...] = ()) -> Line:
        """Return a radial direction; exactly along a coordinate if within 1e-12."""
        ways = (math.cos(angle), math.sin(angle))
        cosine, sine = (float(round(way)) if abs(way - round(way)) < 1e-12 else way for way in ways)
        return cls(place, cosine, sine, shape)

    @classmethod
    def along(cls) -> Line:
        """Return the direction along the shaft."""
        return cls(0.0, math.nan, math.nan)

    @property
    def translation(self) -> bool:
        """Whether it is the only direction of a mass, which has no place."""
        return math.isnan(self.place)

    @property
    def axial(self) -> bool:
        """Whether it is along the shaft."""
        return math.isnan(self.cosine)

    @property
    def form(self) -> dict[str, float]:
        """The displacement there, as a linear form of its coordinates."""
        if self.translation:
            return {"x": 1.0}
        if self.axial:
            return {"z": 1.0}
        in_x = {"x": self.cosine, "th_y": self.place * self.cosine} if self.cosine else {}
        in_y = {"y": self.sine, "th_x": -self.place * self.sine} if self.sine else {}
        for k, out in enumerate(self.shape, 1):
            in_x |= {f"m{k}_x": out * self.cosine} if self.cosine else {}
            in_y |= {f"m{k}_y": out * self.sine} if self.sine else {}
        return in_x | in_y


class Axis(NamedTuple):
    """An axis of a bearing."""

    name: str  #: Such as ``A1``.
    line: Line  #: Direction of its magnet force.
    bearing: BearingAt  #: Its bearing.


class Reading(NamedTuple):
    """A reading of a sensor."""

    name: str  #: Such as ``A1``.
    line: Line  #: Direction of the measurement.
    sensor: SensorAt  #: Its sensor.


TRANSLATION = Line(math.nan, 1.0, 0.0)  #: Along the only coordinate of a mass.


class Shaft(NamedTuple):
    """Conversion of places on a rotor into directions."""

    centre: float = 0.0  #: Position of the centre of mass [m].
    bending: Bending | None = None  #: Its bending modes, if it has any.
    translation: bool = False  #: Whether it is a mass with one coordinate.

    @classmethod
    def of(cls, rotor: Body, bearings: tuple[BearingAt, ...]) -> Shaft:
        """Return that of a machine's rotor."""
        places = tuple(bearing.place for bearing in bearings if bearing.type == "radial")
        return cls(rotor.centre, rotor.bending(places), rotor.type == "mass")

    def line(self, place: float, angle: float) -> Line:
        """Return a radial direction."""
        if self.translation:
            return TRANSLATION
        out = () if self.bending is None else tuple(self.bending.shape(place).tolist())
        return Line.across(place - self.centre, angle, out)


RIGID = Shaft()  #: For a rigid rotor, or without bending.


def axes_of(bearings: tuple[BearingAt, ...], shaft: Shaft = RIGID) -> tuple[Axis, ...]:
    """Return the axes of bearings, in order."""
    return tuple(
        Axis(name, line, bearing) for bearing in bearings for name, line in _lines(bearing, shaft)
    )


def readings_of(sensors: tuple[SensorAt, ...], shaft: Shaft = RIGID) -> tuple[Reading, ...]:
    """Return the readings of sensors, in order."""
    return tuple(
        Reading(name, line, sensor) for sensor in sensors for name, line in _lines(sensor, shaft)
    )


def nearest(sensors: tuple[SensorAt, ...], axis: Axis) -> SensorAt:
    """Return the sensor at an axis, or the nearest one."""

    def away(sensor: SensorAt) -> tuple[bool, float]:
        away = abs(sensor.place - axis.bearing.place)
        return (sensor.type == "axial") != axis.line.axial, away

    return min(sensors, key=away)


def _lines(placed: BearingAt | SensorAt, shaft: Shaft) -> Iterator[tuple[str, Line]]:
    if placed.type in ("thrust", "axial"):
        yield placed.name, Line.along()
        return
    two = placed.type == "radial"
    yield f"{placed.name}{'1' if two else ''}", shaft.line(placed.place, placed.angle)
    if two:
        yield f"{placed.name}2", shaft.line(placed.place, placed.angle + math.pi / 2)


def matrix(lines: list[Line], positions: tuple[str, ...]) -> Array:
    """Return the displacements along directions by the coordinates (lines, positions)."""
    forms = [line.form for line in lines]
    return np.array([[form.get(q, 0.0) for q in positions] for form in forms])


def rigid_motion(rows: Array, rigid: int) -> Array:
    """Return the coordinates (q, k) of a rigid rotor that fit displacements (k,) by rows (k, q)."""
    result = np.zeros(rows.shape[::-1])
    result[:rigid] = np.linalg.pinv(rows[:, :rigid])
    return result


def masses(
    rotor: Body, positions: tuple[str, ...], bending: Bending | None = None
) -> dict[str, float]:
    """Return mass or inertia of each coordinate [kg] or [kg m^2]."""
    of = {"th_x": rotor.transverse_inertia, "th_y": rotor.transverse_inertia}
    if bending is not None:
        for name, mass in zip(bending.names, bending.mass.tolist(), strict=True):
            of |= {f"{name}_x": mass, f"{name}_y": mass}
    return {q: of.get(q, rotor.mass) for q in positions}


def compliance(rotor: Body, axes: tuple[Axis, ...]) -> Array:
    """Return the acceleration along each axis due to a force of 1 N along each (p, p) [1/kg]."""
    # Of the rigid body; flexible modes make it larger at high frequency.
    positions = positions_of(axes)
    H = matrix([axis.line for axis in axes], positions)
    inverse = 1 / np.array(list(masses(rotor, positions).values()))
    return np.asarray((H * inverse) @ H.T)


def supporting_forces(rotor: Body, axes: tuple[Axis, ...], gravity: float) -> Array:
    """Return the forces along the axes that balance the rotor's weight (p,) [N]."""
    # If the axes are redundant, the solution with the least sum of squares.
    positions = positions_of(axes)
    weight = weight_of(rotor, positions, gravity)
    H = matrix([axis.line for axis in axes], positions)
    return np.asarray(np.linalg.lstsq(H.T, -weight, rcond=None)[0])


def weight_of(rotor: Body, positions: tuple[str, ...], gravity: float) -> Array:
    """Return the force of gravity on each coordinate [N]; it does not bend a free rotor."""
    if rotor.type == "mass":
        return np.array([along_x(rotor.gravity) * rotor.mass * gravity])
    falls = {"-x": "x", "-z": "z"}.get(rotor.gravity)
    return np.array([-rotor.mass * gravity if q == falls else 0.0 for q in positions])


def positions_of(axes: tuple[Axis, ...]) -> tuple[str, ...]:
    """Return the rigid-body coordinates of a rotor with bearings of these axes."""
    if any(axis.line.translation for axis in axes):
        return ("x",)
    return POSITIONS + (("z",) if any(axis.line.axial for axis in axes) else ())


def modal_positions(bending: Bending | None) -> tuple[str, ...]:
    """Return the modal coordinates."""
    names = () if bending is None else bending.names
    return tuple(f"{name}_{plane}" for name in names for plane in "xy")


def static_deflection(machine: Any, forces: Array) -> Array:
    """Return the static modal displacements due to forces along the axes (2 modes,) [m]."""
    if machine.bending is None:
        return np.zeros(0)
    H = matrix([axis.line for axis in machine.axes], modal_positions(machine.bending))
    return np.asarray((H.T @ forces) / np.repeat(machine.bending.stiffness, 2))


def unbalances_of(
    planes: tuple[Unbalance, ...], rotor: Body, speed: float
) -> list[tuple[float, float, float]]:
    """Return place [m], amount [kg m] and angle [rad] of each plane's unbalance."""
    graded = [item.place - rotor.centre for item in planes if item.grade is not None]
    results = []
    for entry in planes:
        amount = entry.amount
        if amount is None:
            own = entry.place - rotor.centre
            others = [abs(place) for place in graded if place != own]
            share = others[0] / (others[0] + abs(own)) if others else 1.0
            amount = rotor.mass * (entry.grade or 0.0) / abs(speed) * share
        results.append((entry.place, amount, entry.angle))
    return results
