"""Unbalance response of a levitated rotor over its speed."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, grouped
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import QuantityLike
from ambkit.base.units import engineering, rpm
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.judge.loop.capacity import of_unbalance, orbit, synchronous_pairs
from ambkit.judge.whirl_modes import held, max_speed
from ambkit.machine import geometry
from ambkit.machine.axes import isolated_axes
from ambkit.machine.components import Unbalance
from ambkit.machine.machine import Machine
from ambkit.models.parts.synchronous import unbalance_planes
from ambkit.models.plant import Plant
from ambkit.result.report import Axis, Figure, Item, Line, Panel
from ambkit.result.result import Result
from ambkit.result.row import At, Row


@dataclass(frozen=True, eq=False, repr=False)
class UnbalanceResponse(Result):
    """Amplitude of the synchronous motion over the speed."""

    machine: Machine  #: The machine.
    speed: Array  #: (n,) Speeds of rotation [rad/s].
    amplitude: Array  #: (n, p) Along each axis [m].

    TITLE = "Unbalance response of {0.machine.name}"

    @property
    def finding(self) -> str:
        n, k = np.unravel_index(self.amplitude.argmax(), self.amplitude.shape)
        most = engineering(self.amplitude[n, k], "m", 4)
        return (
            f"Greatest unbalance response of {self.machine.name}: {most} along "
            f"{self.machine.axes[k].name} at {rpm(self.speed[n])}."
        )

    @property
    def rows(self) -> list[Row]:
        return [
            Row("maximum_amplitude", "maximum amplitude", float(of.max()), "m", of=axis.name,
                at=At("speed", float(self.speed[of.argmax()]), "rpm"))
            for axis, of in zip(self.machine.axes, self.amplitude.T, strict=True)
        ]  # fmt: skip

    @property
    def series(self) -> dict[str, Any]:
        names = self.machine.axis_names
        columns = dict(zip(names, self.amplitude.T.tolist(), strict=True))
        return {"machine": self.machine.name, "speeds": self.speed.tolist(), "amplitude": columns}

    def figures(self) -> list[Figure]:
        return [unbalance_response_figure(self)]


def unbalance_response(
    machine: Machine, fastest: QuantityLike | None = None, *, count: int = 400
) -> UnbalanceResponse:
    """Return the steady synchronous motion of a rotor on its controllers."""
    if not machine.unbalance:
        raise AmbkitError(f"{machine.name}: it has no [[unbalance]]")
    fastest = max_speed(machine, fastest)
    plant = Plant(machine)
    standstill, spin = held(machine)
    ahead, across = plant.unbalance()
    q = len(machine.positions)
    unbalance_input = np.zeros(len(standstill), complex)
    unbalance_input[q : 2 * q] = ahead - 1j * across  # velocities follow the positions
    speed = np.linspace(fastest / count, fastest, count)
    one = np.eye(len(standstill))
    results = [
        np.linalg.solve(1j * w * one - standstill - w * spin, w**2 * unbalance_input) for w in speed
    ]
    motion = np.array(results)[:, : plant.H.shape[1]] @ plant.H.T
    return UnbalanceResponse(machine, speed, np.abs(motion))


SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)
AMPLITUDE = Axis("amplitude", "µm", 1e6)


def unbalance_response_figure(result: UnbalanceResponse) -> Figure:
    """Plot the response along each axis."""
    machine, speed, amplitude = result.machine, result.speed, result.amplitude
    moves = amplitude.T
    alike = grouped(len(moves), lambda k, j: np.allclose(moves[j], moves[k], rtol=1e-3))
    items: list[Item] = [
        Line(speed, moves[axes[0]], signal=f"series {n % 4 + 1}",
             label=" and ".join(machine.axes[k].name for k in axes))
        for n, axes in enumerate(alike)
    ]  # fmt: skip
    least = min(axis.bearing.clearance for axis in machine.axes)
    if amplitude.max() > 0.2 * least:
        limit = speed[[0, -1]], 0 * speed[[0, -1]] + least
        items.append(Line(*limit, signal="limit", label="touch-down bearing"))
    return Figure(
        id="unbalance-response",
        title=f"Unbalance response of {markdown(machine.name)}",
        caption="Steady synchronous motion along each axis, of the linear rotor on its PIDs.",
        panels=[Panel(SPEED, AMPLITUDE, items)],
        panel_height=3.2,
    )


GRADES = (0.4e-3, 1e-3, 2.5e-3, 6.3e-3, 16e-3, 40e-3)
"""Balance quality grades of ISO 21940-11 for rotors on magnetic bearings [m/s]."""


class Grade(NamedTuple):
    """Response to the unbalance permitted by a grade at a machine's speed, for the worst angles."""

    grade: float  #: Balance quality grade [m/s].
    unbalance: float  #: Permissible unbalance, sum of all planes [kg m].
    force: float  #: Its force, if in one plane [N].
    displacement: float  #: Largest half axis of an orbit at a bearing [m].
    clearance_share: float  #: Largest share of a clearance [1].
    current: float  #: Largest amplitude of a commanded current [A].


def of_grades(loop: Loop, machine: Machine, point: OperatingPoint) -> list[Grade]:
    """Return the response to the unbalance of each grade."""
    # In the described planes, or at the outer bearings; divided among the planes as the machine's
    # own grades, at the worst angles.
    isolated, pairs = isolated_axes(machine), synchronous_pairs(machine)
    travel = np.array([b.clearance for b in isolated])
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
    """Return the permissible unbalance of a grade, plane by plane."""
    places = unbalance_planes(machine)
    places = places if len(places) < 3 else [places[0], places[-1]]
    if len(places) == 2 and places[0] * places[1] >= 0:
        places = unbalance_planes(machine.model_copy(update={"unbalance": ()}))
    planes = tuple(Unbalance(place=place, grade=grade) for place in places)
    of_grade = machine.model_copy(update={"unbalance": planes}).unbalances()
    return [Unbalance(place=place, amount=amount) for place, amount, _ in of_grade]


def grade_of(machine: Machine) -> float | None:
    """Return the balance quality grade of a machine's unbalance at its speed [m/s], or None."""
    # The amounts of the planes are added.
    if not machine.speed or not machine.unbalance:
        return None
    total_unbalance = sum(amount for _, amount, _ in machine.unbalances())
    return float(total_unbalance * abs(machine.speed) / machine.rotor.mass)


def unbalance_forces(machine: Machine) -> NDArray[np.float64]:
    """Return the amplitudes of the forces along the axes equivalent to the unbalance (p,) [N]."""
    # For the rigid rotor, at the machine's speed.
    positions = machine.rigid_coordinates
    H = geometry.matrix([axis.line for axis in machine.axes], positions)
    forces = np.zeros(len(positions), complex)
    for place, amount, angle in machine.unbalances():
        ahead, across = geometry.matrix(
            [geometry.Line.across(place, turn) for turn in (angle, angle + math.pi / 2)], positions
        )
        forces += amount * machine.speed**2 * (ahead - 1j * across)
    return np.asarray(np.abs(np.linalg.pinv(H.T) @ forces), float)
