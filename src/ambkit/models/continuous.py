"""Continuous model of a machine, for its plant and its poles."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.models.declaration import Plan
from ambkit.models.machine_parts import machine_parts
from ambkit.models.model import Descriptor
from ambkit.models.parts.disturbance import Disturbance
from ambkit.models.sampling import Sampling


class Continuous(NamedTuple):
    """``dX/dt = (A + speed spin) X + b F + B_u u``, with the dynamic states X."""

    # These are the rotor, the lagged readings, and the currents of amplifiers with bandwidth. The
    # force of magnet f depends on its current and its displacement ``h_f X``.

    states: tuple[Descriptor, ...]  #: (n,) The states.
    A: Array  #: At standstill (n, n).
    spin: Array  #: Derivative of A by the speed of rotation (n, n).
    b: Array  #: Per newton at each axis (n, p).
    push: Array  #: Per newton on the rotor at each axis's magnet, without lag (n, p).
    B_u: Array  #: Per ampere commanded of each amplifier (n, p).
    h: Array  #: Displacement at each axis (p, n) [m].
    current: tuple[str | None, ...]  #: State of each axis's current; None: as commanded.

    @property
    def v(self) -> Array:
        """Velocity at each axis (p, n) [m/s]."""
        return np.asarray(self.h @ np.where(np.eye(len(self.A), dtype=bool), 0.0, self.A))

    @property
    def place(self) -> dict[str, int]:
        """Index of each state, by name."""
        return {state.name: k for k, state in enumerate(self.states)}


OWN_TEXT = ("position", "velocity", "bending", "bending velocity", "sensor", "current")
"""Roles of the states whose equations are in the plant itself (sim/plant.c), with their limits."""


class ForceLag(NamedTuple):
    """Linear states e between a magnet's force F and the rotor: ``e' = A e + b F``."""

    # The acting force is ``c e + d F``.

    states: tuple[str, ...]  #: (k,) Their names.
    A: Array  #: (k, k) [1/s].
    b: Array  #: (k,).
    c: Array  #: (k,).
    d: float  #: Feedthrough [1].

    @property
    def rest(self) -> Array:
        """Their equilibrium for 1 N (k,)."""
        return np.asarray(-np.linalg.solve(self.A, self.b))

    def at(self, speed: float) -> tuple[NDArray[np.complex128], complex]:
        """Return the states (k,), and the acting force [1], for 1 N rotating at a speed [rad/s]."""
        e = np.linalg.solve(1j * speed * np.eye(len(self.b)) - self.A, self.b + 0j)
        return np.asarray(e, complex), complex(self.c @ e + self.d)


def behind_magnets(of: Continuous) -> list[ForceLag]:
    """Return the dynamics between the force of each axis's magnet and the rotor."""
    others = [k for k, state in enumerate(of.states) if state.role not in OWN_TEXT]
    results = []
    for axis, force_input in enumerate(of.push.T):
        states = [k for k in others if _reached(of.A, of.b[:, axis], others)[k]]
        at = int(np.argmax(np.abs(force_input)))
        c, d = of.A[at, states] / force_input[at], float(of.b[at, axis] / force_input[at])
        results.append(
            ForceLag(
                tuple(of.states[k].name for k in states), of.A[np.ix_(states, states)],
                of.b[states, axis], c, d,
            )
        )  # fmt: skip
    return results


def _reached(A: Array, b: Array, others: list[int]) -> NDArray[np.bool_]:
    """Return which states a force moves, directly or through each other (n,)."""
    among = np.isin(np.arange(len(A)), others)
    reached = among & (b != 0)
    for _ in others:
        reached |= among & ((A[:, reached] != 0).any(axis=1))
    return np.asarray(reached)


def continuous(machine: Any) -> Continuous:
    """Return the continuous model of a machine, at any speed."""
    plans = [_plan(machine, speed) for speed in (0.0, 1.0)]
    plan = plans[0]
    n, p, _, _ = Sampling(plan).sizes
    standstill, unit_speed = (Sampling(item).generator(0.0)[:n] for item in plans)
    place = Sampling(plan).place
    h = np.zeros((p, n))
    for k, force in enumerate(plan.forces):
        for position, value in plan.places[force.name].items():
            h[k, place[position]] = value
    force_input = np.zeros((n, p))
    for k, force in enumerate(plan.forces):
        for position, share in plan.places[force.name].items():
            for velocity, value in plan.inertia[position].items():
                force_input[place[velocity], k] += value * share
    names = {state.name for state in plan.states}
    fed = (plan.currents[force.name] for force in plan.forces)
    return Continuous(
        states=tuple(plan.states),
        A=standstill[:, :n],
        spin=unit_speed[:, :n] - standstill[:, :n],
        b=standstill[:, n : n + p],
        push=force_input,
        B_u=standstill[:, n + p : n + 2 * p],
        h=h,
        current=tuple(item if item in names else None for item in fed),
    )


def _plan(machine: Any, speed: float) -> Plan:
    plan = Plan(machine.sampling_time)
    # A mass does not spin; its runout needs the stated speed.
    at = machine if machine.rotor.type == "mass" else machine.model_copy(update={"speed": speed})
    for part in machine_parts(at, noise=False, delay=False):
        if not isinstance(part, Disturbance):
            plan.add(part)
    return plan


class OpenLoop(NamedTuple):
    """Poles of the uncontrolled rotor at a speed."""

    speed: float  #: Speed of rotation [rad/s].
    poles: NDArray[np.complex128]  #: All poles (2 q,) [1/s].

    @property
    def unstable(self) -> NDArray[np.complex128]:
        """Unstable poles [1/s], by ascending real part."""
        poles = self.poles
        max_magnitude = float(np.abs(poles).max())
        result = poles[poles.real > 1e-6 * max_magnitude]
        return result[np.lexsort((result.imag, np.round(result.real, 6)))]


def open_loop(machine: Any, k_s: ArrayLike, speed: float | None = None) -> OpenLoop:
    """Return the poles of the rotor on its magnets, without control."""
    # k_s (p,) [N/m]
    of, at = continuous(machine), machine.speed if speed is None else speed
    q = 2 * len(machine.positions)
    A = of.A + at * of.spin + of.push @ (np.asarray(k_s)[:, None] * of.h)
    return OpenLoop(at, np.linalg.eigvals(A[:q, :q]).astype(complex))
