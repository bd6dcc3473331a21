"""The synchronous motion that controllers leave to the rotor, at each speed.

A rotor that bends turns about its axis of inertia only where nothing holds it, and how far its
shaft is bent then depends on the speed. What goes round with it is Re(Z U exp(j W t)) for an
unbalance U, with the whole dynamics at that speed: masses, gyroscopics, damping that stands still
and that turns, stiffness. As the unbalance is estimated and not moved by any current, controllers
that are told of it leave the poles of the loop where they are, at any speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.machine import geometry
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.machine import SLOWEST, unbalance_planes

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.simulation.plant import Plant

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

NODES = 129
"""Speeds at which the motion is computed."""
FAR = 0.5
"""Share of the travel, or of the greatest current, that the machine's unbalance may take: where it
takes more, as near a free rotor's own bending, it is fought."""


@dataclass(frozen=True, eq=False)
class LetTurn:
    """What is left to the rotor, as ``amb_let_turn`` has it.

    Attributes
    ----------
    first, step : float
        The first speed, at which nothing is left to it yet, and from one to the next [rad/s].
    start : int
        Which state is the first of the unbalance's.
    motion : ndarray (nodes, moved, w)
        Of positions and velocities [m/(kg m)], [m/s/(kg m)], of angles in rad.
    current : ndarray (nodes, p, w)
        That it needs [A/(kg m)].
    """

    first: float
    step: float
    start: int
    motion: Array
    current: Array

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of nodes and states, by their names in C."""
        nodes, moved, width = self.motion.shape
        return {"nodes": nodes, "from": self.start, "width": width, "moved": moved}

    def at(self, speed: float) -> tuple[Array, Array]:
        """Return motion (moved, w) [m], [m/s] and currents (p, w) [A] for 1 kg m, as in C.

        Parameters
        ----------
        speed : float
            Of rotation [rad/s].
        """
        at = float(np.clip((speed - self.first) / self.step, 0, len(self.motion) - 1))
        node = min(int(at), len(self.motion) - 2)
        share = at - node
        motion, current = (
            each[node] + share * (each[node + 1] - each[node])
            for each in (self.motion, self.current)
        )
        return motion, current


def let_turn_fields(turn: LetTurn | None) -> dict[str, Any]:
    """Return the fields that the core's binding reads."""
    if turn is None:
        return {"let_turn_motion": None}
    return {f"let_turn_{key}": value for key, value in turn.counts.items()} | {
        "let_turn_first": turn.first,
        "let_turn_step": turn.step,
        "let_turn_motion": turn.motion.ravel().tolist(),
        "let_turn_current": turn.current.ravel().tolist(),
    }


def check_unbalance(estimator: Estimator) -> None:
    """Raise AmbkitError where an estimator has no unbalance among its states."""
    if not any(state.role == "unbalance" for state in estimator.states):
        raise AmbkitError(
            f"{estimator.name}: it has no unbalance among its states, which the controllers are "
            'to know: it needs synchronous = ["unbalance"]'
        )


def let_turn(
    plant: Plant,
    estimator: Estimator,
    unbalance: Literal["force-free", "still"],
    start: float | None = None,
    fastest: float | None = None,
) -> LetTurn:
    """Return the motion that controllers are to leave to the rotor, over the speeds.

    Parameters
    ----------
    plant : Plant
        The machine.
    estimator : Estimator
        That feeds them.
    unbalance : {"force-free", "still"}
        That of the free rotor, with currents that take the magnets' pull at it back; or that of one
        that is held where its magnets are, with the currents that hold it.
    start : float, optional
        Speed from which on [rad/s]; `SLOWEST`, or half of the fastest, by default.
    fastest : float, optional
        Up to which [rad/s]; the machine's own by default.

    Raises
    ------
    AmbkitError
        The estimator has no unbalance among its states; there is no speed between both; at the
        machine's own speed it would take too much, see `FAR`.
    """
    check_unbalance(estimator)
    machine = plant.machine
    top = max(abs(machine.speed), abs(fastest or 0.0))
    first = min(SLOWEST, top / 2) if start is None else start
    if not first < top:
        raise AmbkitError(
            f"unbalance_from: {first:.6g} rad/s is not below the greatest speed, {top:.6g} rad/s"
        )
    way = -1.0 if machine.speed < 0 else 1.0
    speeds = way * np.linspace(first, top, NODES)
    states = [k for k, state in enumerate(estimator.states) if state.role == "unbalance"]
    sizes = _sizes(plant, [estimator.states[k].size for k in states[::2]])
    *_, taken = _at(plant, machine.speed, unbalance, sizes)
    if first < abs(machine.speed) and taken > FAR:
        raise AmbkitError(
            f'{machine.name}: at {machine.speed:.6g} rad/s unbalance = "{unbalance}" would take '
            f"{100 * taken:.3g} % of the travel or of the greatest current, which must be at most "
            f'{100 * FAR:.3g} %: near its own bending a free rotor is to be held; "fought" does'
        )
    found = [_left(*_at(plant, float(speed), unbalance, sizes)) for speed in speeds]
    motion, current = (np.array([_real(each) for each in of]) for of in zip(*found, strict=True))
    motion[0], current[0] = 0.0, 0.0
    return LetTurn(float(speeds[0]), float(speeds[1] - speeds[0]), states[0], motion, current)


def _left(moved: Complex, current: Complex, taken: float) -> tuple[Complex, Complex]:
    share = 1.0 if taken <= FAR else 0.0
    return share * moved, share * current


def _sizes(plant: Plant, usual: list[float]) -> Array:
    """Return how large the unbalance is in each plane [kg m]: as described, or as is usual."""
    given: dict[float, float] = {}
    for z, amount, _ in plant.machine.unbalances() if plant.machine.speed else []:
        given[z] = given.get(z, 0.0) + amount
    planes = unbalance_planes(plant.machine)
    return np.array([given.get(z, size) for z, size in zip(planes, usual, strict=True)])


def _real(Z: Complex) -> Array:
    """Return what acts on (x, y) of each plane: Re(Z (x + j y))."""
    return np.stack([Z.real, -Z.imag], axis=-1).reshape(len(Z), -1)


def _at(plant: Plant, speed: float, unbalance: str, sizes: Array) -> tuple[Complex, Complex, float]:
    """Return the motion of positions and velocities, and the currents, by U of each plane.

    And what share of the travel, or of the greatest current, unbalance of these sizes takes.
    """
    machine, model = plant.machine, plant.model
    q = len(machine.positions)
    A = (model.A + speed * model.spin)[q : 2 * q, : 2 * q]
    whole = -(speed**2) * np.eye(q) - A[:, :q] - 1j * speed * A[:, q:]
    planes = [
        geometry.matrix([machine.line(z, turn) for turn in (0.0, math.pi / 2)], machine.positions)
        for z in unbalance_planes(machine)
    ]
    pushed = np.column_stack([one[0] - 1j * one[1] for one in planes]) / machine.masses[:, None]
    moved = np.linalg.solve(whole, speed**2 * pushed)
    k = [ConstantStiffness.of(alone) for alone in plant.alone]
    k_i, k_s = (np.array([getattr(each, of) for each in k])[:, None] for of in ("k_i", "k_s"))
    if unbalance == "force-free":
        current = -(k_s / k_i) * (plant.H @ moved)
    else:
        give = np.linalg.solve(whole, model.b[q : 2 * q])
        held = -np.linalg.lstsq(plant.H @ give, plant.H @ moved, rcond=None)[0]
        moved, current = moved + give @ held, held / k_i
    travel = np.array([alone.rotor.travel_limit for alone in plant.alone])
    limit = np.array([alone.amplifier.current_limit for alone in plant.alone])
    least = np.abs(np.linalg.pinv(plant.H)) @ travel
    taken = max(
        float((np.abs(moved) @ sizes / least).max()), float((np.abs(current) @ sizes / limit).max())
    )
    return np.vstack([moved, 1j * speed * moved]), _ahead(plant, speed)[:, None] * current, taken


def _ahead(plant: Plant, speed: float) -> Complex:
    """Return by what a demanded current is to be ahead of the current (p,): lag, delay, hold."""
    T = plant.machine.sampling_time
    late = np.exp(1j * speed * ((plant.machine.delay or 0.0) + T / 2)) / np.sinc(
        speed * T / (2 * math.pi)
    )
    corners = [axis.bearing.amplifier.bandwidth for axis in plant.axes]
    lags = [1.0 if each is None else 1 + 1j * speed / (2 * math.pi * each) for each in corners]
    return np.asarray(late * np.array(lags))
