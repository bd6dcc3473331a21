"""How far unbalance moves a rotor on its controllers, over its speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import Given
from ambkit.base.units import engineering, rpm
from ambkit.judge.whirl_modes import held, max_speed
from ambkit.machine.machine import Machine
from ambkit.models.plant import Plant
from ambkit.result.report import Axis, Figure, Item, Line, Panel
from ambkit.result.result import Result
from ambkit.result.row import At, Row


@dataclass(frozen=True, eq=False, repr=False)
class UnbalanceResponse(Result):
    """Amplitude of the synchronous motion over the speed."""

    machine: Machine  #: Whose unbalance it is.
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
            Row("greatest_amplitude", "greatest amplitude", float(of.max()), "m", of=axis.name,
                at=At("speed", float(self.speed[of.argmax()]), "rpm"))
            for axis, of in zip(self.machine.axes, self.amplitude.T, strict=True)
        ]  # fmt: skip

    @property
    def series(self) -> dict[str, Any]:
        names = [axis.name for axis in self.machine.axes]
        columns = dict(zip(names, self.amplitude.T.tolist(), strict=True))
        return {"machine": self.machine.name, "speeds": self.speed.tolist(), "amplitude": columns}

    def figures(self) -> list[Figure]:
        return [unbalance_response_figure(self)]


def unbalance_response(
    machine: Machine, fastest: Given | None = None, *, count: int = 400
) -> UnbalanceResponse:
    """Return the steady synchronous motion of a rotor on its controllers."""
    if not machine.unbalance:
        raise AmbkitError(f"{machine.name}: it has no [[unbalance]], and so no response to it")
    fastest = max_speed(machine, fastest)
    plant = Plant(machine)
    standstill, spin = held(machine)
    ahead, across = plant.unbalance()
    q = len(machine.positions)
    unbalance_input = np.zeros(len(standstill), complex)
    unbalance_input[q : 2 * q] = ahead - 1j * across  # velocities stand after the positions
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
    """Show how far each axis moves."""
    machine, speed, amplitude = result.machine, result.speed, result.amplitude
    names: dict[int, list[str]] = {}  # axes by the first of those that move alike
    for k, axis in enumerate(machine.axes):
        alike = (j for j in names if np.allclose(amplitude[:, j], amplitude[:, k], rtol=1e-3))
        names.setdefault(next(alike, k), []).append(axis.name)
    items: list[Item] = [
        Line(speed, amplitude[:, k], signal=f"series {n % 4 + 1}", label=" and ".join(axes))
        for n, (k, axes) in enumerate(names.items())
    ]
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
