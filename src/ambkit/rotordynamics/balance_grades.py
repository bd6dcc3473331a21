"""What unbalance does to a machine, by balance quality grades and over its speed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.judge.loop.capacity import of_unbalance, orbit, pairs_of
from ambkit.machine import geometry
from ambkit.machine.components import Unbalance
from ambkit.machine.force_laws import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.models.parts.synchronous import unbalance_planes

GRADES = (0.4e-3, 1e-3, 2.5e-3, 6.3e-3, 16e-3, 40e-3)
"""Balance quality grades of ISO 21940-11 that rotors on magnetic bearings have [m/s]."""


class Grade(NamedTuple):
    """What the unbalance that a grade permits does at a machine's speed, whatever its angles."""

    grade: float  #: Balance quality grade [m/s].
    unbalance: float  #: That it permits, of all planes together [kg m].
    force: float  #: Of it, were it in one plane [N].
    displacement: float  #: Greatest half axis of an orbit at a bearing [m].
    clearance_share: float  #: Greatest share of a clearance that the orbits take [1].
    current: float  #: Greatest amplitude of a demanded current [A].


def of_grades(loop: Loop, machine: Machine, point: OperatingPoint) -> list[Grade]:
    """Return what the unbalance of each grade would do."""
    # In the planes that are described, or else at the outer bearings; the planes' shares as the
    # machine's own are graded, and their angles as bad as can be.
    isolated, pairs = isolated_axes(machine), pairs_of(machine)
    travel = np.array([b.rotor.clearance for b in isolated])
    per_grade = [
        of_unbalance(loop, machine.model_copy(update={"unbalance": (plane,)}), point)
        for plane in permitted(machine, 1.0)
    ]
    x = sum(orbit(item.x, pairs) for item in per_grade)
    i = sum(np.abs(item.i) for item in per_grade)
    speed = abs(machine.speed)
    return [
        Grade(
            grade, machine.rotor.mass * grade / speed, machine.rotor.mass * grade * speed,
            float(np.max(grade * x)), float(np.max(grade * x / travel)), float(np.max(grade * i)),
        )
        for grade in GRADES
    ]  # fmt: skip


def permitted(machine: Machine, grade: float) -> list[Unbalance]:
    """Return the unbalance that a grade permits, plane by plane."""
    places = unbalance_planes(machine)
    places = places if len(places) < 3 else [places[0], places[-1]]
    if len(places) == 2 and places[0] * places[1] >= 0:
        places = unbalance_planes(machine.model_copy(update={"unbalance": ()}))
    planes = tuple(Unbalance(place=place, grade=grade) for place in places)
    of_grade = machine.model_copy(update={"unbalance": planes}).unbalances()
    return [Unbalance(place=place, amount=amount) for place, amount, _ in of_grade]


def grade_of(machine: Machine) -> float | None:
    """Return the balance quality grade of a machine's unbalance at its speed [m/s]; None: none."""
    # The planes' amounts are added up.
    if not machine.speed or not machine.unbalance:
        return None
    total_unbalance = sum(amount for _, amount, _ in machine.unbalances())
    return float(total_unbalance * abs(machine.speed) / machine.rotor.mass)


def unbalance_forces(machine: Machine) -> NDArray[np.float64]:
    """The amplitudes of the forces along the axes that do what the unbalance does (p,) [N]."""
    # To the rigid rotor, at the machine's speed.
    positions = machine.rigid_positions
    H = geometry.matrix([axis.line for axis in machine.axes], positions)
    forces = np.zeros(len(positions), complex)
    for place, amount, angle in machine.unbalances():
        ahead, across = geometry.matrix(
            [geometry.Line.across(place, turn) for turn in (angle, angle + math.pi / 2)], positions
        )
        forces += amount * machine.speed**2 * (ahead - 1j * across)
    return np.asarray(np.abs(np.linalg.pinv(H.T) @ forces), float)
