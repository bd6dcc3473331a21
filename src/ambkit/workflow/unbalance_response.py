"""How far unbalance moves a rotor on its controllers, over its speed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Drawn
from ambkit.simulation.plant import Plant
from ambkit.workflow.campbell import held

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.result.report.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class UnbalanceResponse(Drawn):
    """Amplitude of the synchronous motion over the speed."""

    machine: Machine  #: Whose unbalance it is.
    speed: Array  #: (n,) Speeds of rotation [rad/s].
    amplitude: Array  #: (n, p) Along each axis [m].

    def to_dict(self) -> dict[str, Any]:
        """Return speed [rad/s] and the amplitude of each axis [m] by its name."""
        names = [axis.name for axis in self.machine.axes]
        columns = dict(zip(names, self.amplitude.T.tolist(), strict=True))
        return {"machine": self.machine.name, "speed": self.speed.tolist(), "amplitude": columns}

    def figure(self) -> Figure:
        """Show the amplitude of each axis over the speed."""
        from ambkit.show.plots.unbalance_response import unbalance_response_figure

        return unbalance_response_figure(self.machine, self.speed, self.amplitude)


def unbalance_response(
    machine: Machine, fastest: float | None = None, *, count: int = 400
) -> UnbalanceResponse:
    """Return the steady synchronous motion of a rotor on its controllers.

    By the linear model that the Campbell diagram has too: magnets at their centre, proportional and
    derivative gains as a simulation has them, sensors and amplifiers at once.

    Parameters
    ----------
    machine : Machine
        With its unbalance.
    fastest : float, optional
        Up to where [rad/s]; by default twice the machine's speed, or 1000 rad/s.
    count : int
        Speeds.

    Raises
    ------
    AmbkitError
        It has no unbalance.
    ValueError
        `fastest` is not greater than 0.
    """
    if not machine.unbalance:
        raise AmbkitError(f"{machine.name}: it has no [[unbalance]], and so no response to it")
    fastest = (2 * abs(machine.speed) or 1000.0) if fastest is None else fastest
    if not (math.isfinite(fastest) and fastest > 0):
        raise ValueError(f"fastest must be greater than 0 rad/s, got {fastest!r}")
    plant = Plant(machine)
    at_rest, spin = held(machine)
    ahead, across = plant.unbalance()
    q = len(machine.positions)
    push = np.zeros(len(at_rest), complex)
    push[q : 2 * q] = ahead - 1j * across  # velocities stand after the positions
    speed = np.linspace(fastest / count, fastest, count)
    one = np.eye(len(at_rest))
    found = [np.linalg.solve(1j * w * one - at_rest - w * spin, w**2 * push) for w in speed]
    motion = np.array(found)[:, : plant.H.shape[1]] @ plant.H.T
    return UnbalanceResponse(machine, speed, np.abs(motion))
