"""The continuous model of a whole machine: for its plant, and for its poles."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.models.machine import machine_parts
from ambkit.models.model import Array, Descriptor
from ambkit.models.parts import Disturbance
from ambkit.models.plan import Plan
from ambkit.models.sampling import Sampling


class Continuous(NamedTuple):
    """``dX/dt = (A + speed spin) X + b F + B_u u``, with what moves by itself in X."""

    # These are the rotor, the lagged readings, and the currents of amplifiers that lag. Magnet f
    # pulls with its current and its displacement ``h_f X``.

    states: tuple[Descriptor, ...]
    """The n states."""
    A: Array
    """At rest (n, n)."""
    spin: Array
    """What A gains by 1 rad/s of rotation (n, n)."""
    b: Array
    """By 1 N at each axis (n, p)."""
    B_u: Array
    """By 1 A demanded of each amplifier (n, p)."""
    h: Array
    """Displacement at each axis (p, n) [m]."""
    current: tuple[str | None, ...]
    """The state that is each axis's current; None: the demanded current at once."""

    @property
    def v(self) -> Array:
        """Velocity at each axis (p, n) [m/s]."""
        return np.asarray(self.h @ np.where(np.eye(len(self.A), dtype=bool), 0.0, self.A))

    @property
    def place(self) -> dict[str, int]:
        """Where each state stands, by its name."""
        return {state.name: k for k, state in enumerate(self.states)}


def continuous(machine: Any) -> Continuous:
    """Return the continuous model of a machine, at any speed."""
    plans = [_plan(machine, speed) for speed in (0.0, 1.0)]
    plan = plans[0]
    n, p, _, _ = Sampling(plan).sizes
    at_rest, turning = (Sampling(each).generator(0.0)[:n] for each in plans)
    place = Sampling(plan).place
    h = np.zeros((p, n))
    for k, force in enumerate(plan.forces):
        for position, value in plan.places[force.name].items():
            h[k, place[position]] = value
    names = {state.name for state in plan.states}
    fed = (plan.currents[force.name] for force in plan.forces)
    return Continuous(
        states=tuple(plan.states),
        A=at_rest[:, :n],
        spin=turning[:, :n] - at_rest[:, :n],
        b=at_rest[:, n : n + p],
        B_u=at_rest[:, n + p : n + 2 * p],
        h=h,
        current=tuple(each if each in names else None for each in fed),
    )


def _plan(machine: Any, speed: float) -> Plan:
    plan = Plan(machine.sampling_time)
    # A mass does not turn; its runout needs the speed that it has.
    at = machine if machine.rotor.type == "mass" else machine.model_copy(update={"speed": speed})
    for part in machine_parts(at, noise=False, delay=False):
        if not isinstance(part, Disturbance):
            plan.add(part)
    return plan


class OpenLoop(NamedTuple):
    """Poles of the uncontrolled rotor at a speed."""

    speed: float
    """Of rotation [rad/s]."""
    poles: NDArray[np.complex128]
    """All of them (2 q,) [1/s]."""

    @property
    def unstable(self) -> NDArray[np.complex128]:
        """Those that grow [1/s], by their real parts, the slower first."""
        poles = self.poles
        greatest = float(np.abs(poles).max())
        found = poles[poles.real > 1e-6 * greatest]
        return found[np.lexsort((found.imag, np.round(found.real, 6)))]


def open_loop(machine: Any, k_s: ArrayLike, speed: float | None = None) -> OpenLoop:
    """Return the poles of the rotor in its magnets, without control."""
    # k_s (p,) [N/m]
    of, at = continuous(machine), machine.speed if speed is None else speed
    q = 2 * len(machine.positions)
    A = of.A + at * of.spin + of.b @ (np.asarray(k_s)[:, None] * of.h)
    return OpenLoop(at, np.linalg.eigvals(A[:q, :q]).astype(complex))
