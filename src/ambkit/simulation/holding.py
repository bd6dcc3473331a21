"""Controllers that hold a machine, one for each axis, and how well they do."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.machine import geometry
from ambkit.machine.bank import alone_of, weights_of
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import magnet_of
from ambkit.models.linear import linearised
from ambkit.models.machine import machine_parts, velocity_of
from ambkit.simulation.gains import weight_of
from ambkit.simulation.scenario import PID

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SOFTER = (1.0, 0.75, 0.6, 0.5, 0.4, 0.35)
"""Shares of the proportional gain that are tried where the usual one shakes a bending mode; below
about 0.3 no spring is left against the magnets' own."""
LESS_DAMPED = (1.5, 1.0, 0.75, 0.5, 0.35, 0.2)
"""Shares of the derivative gain."""
SLOWER = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""By how much the derivative is filtered more."""
NEARBY, FINER = (0.87, 1.0, 1.15), 2
"""What is tried next to the best of these, and how often."""
STIFF = 0.4
"""Of the magnets' own stiffness, what is to be left against it."""
WELL_DAMPED = 0.3
"""Damping ratio of the rigid body that is good enough."""
LEFT_TO_IT = 0.5
"""Share of its own damping that a controller may take from a bending mode."""


@dataclass(frozen=True, eq=False)
class Holding:
    """Controllers of a machine's axes, and the poles of the loop with them.

    Attributes
    ----------
    pids : tuple of PID
        Of each axis.
    poles : ndarray of complex (n,)
        Of the sampled loop at the machine's speed, with its delay [1/s].
    score : float
        At most 1, where all is well damped; not above 0 where the rotor is not held.
    """

    pids: tuple[PID, ...]
    poles: Complex
    score: float

    @property
    def held(self) -> bool:
        """Whether nothing grows."""
        return self.score > 0

    @property
    def growing(self) -> list[complex]:
        """Poles that grow, of pairs the one above [1/s], the fastest growing first."""
        grow = self.poles[(self.poles.real > 0) & (self.poles.imag >= 0)]
        return sorted(grow.tolist(), key=lambda pole: -pole.real)


def holding(
    machine: Machine, feedback: Literal["measurement", "estimate"] = "measurement"
) -> Holding:
    """Return controllers for a machine, each axis with its own.

    Each is tuned to its axis alone, see `PID.for_bearing`. Where that shakes a bending mode, by the
    loop's delay or a sensor on the other side of a node, softer gains and slower derivatives are
    tried, the same for all axes, and those are taken that leave most damping: to the rigid body up
    to `WELL_DAMPED`, to a bending mode up to `LEFT_TO_IT` of its own.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    feedback : {"measurement", "estimate"}
        What the controllers are fed by. An estimator that knows displacements and velocities along
        the axes is taken for right: in a linear loop it moves no pole but its own.
    """
    usual = tuple(map(PID.for_bearing, alone_of(machine)))
    if machine.bending is None:
        return Holding(usual, np.zeros(0, complex), 1.0)
    return _searched(machine, usual, feedback)


@lru_cache(maxsize=32)
def _searched(machine: Machine, usual: tuple[PID, ...], feedback: str) -> Holding:
    loop = _Loop(machine, feedback)
    best = loop.with_(usual)
    if best.score >= 1:
        return best
    slower = SLOWER if feedback == "measurement" else (1.0,)  # a velocity is not filtered again
    for p, d, f in itertools.product(SOFTER, LESS_DAMPED, slower):
        softer = (_changed(*each, p, d, f) for each in zip(usual, loop.alone, strict=True))
        tried = loop.with_(tuple(softer))
        best = tried if tried.score > best.score else best
    for _ in range(FINER):
        for p, d, f in itertools.product(NEARBY, NEARBY, NEARBY if len(slower) > 1 else (1.0,)):
            near = (_changed(*each, p, d, f) for each in zip(best.pids, loop.alone, strict=True))
            tried = loop.with_(tuple(near))
            best = tried if tried.score > best.score else best
    return best


def _changed(pid: PID, alone: Bearing, p: float, d: float, f: float) -> PID:
    kp, ki, kd = pid.kp * p, pid.ki * p, pid.kd * d
    return PID(
        kp=kp, ki=ki, kd=kd, derivative_filter=pid.derivative_filter * f,
        anti_windup=pid.anti_windup, setpoint_weight=weight_of(alone, kp, ki, kd),
    )  # fmt: skip


def shown_along_axes(machine: Machine) -> Array:
    """Return the displacements along the axes (p, m), by the readings.

    It is that of the rigid rotor which explains all readings best.
    """
    positions = machine.rigid_positions
    H = geometry.matrix([axis.line for axis in machine.axes], positions)
    C = geometry.matrix([r.line for r in machine.readings], positions)
    gains = np.array([r.sensor.gain for r in machine.readings])
    return np.asarray(H @ np.linalg.pinv(gains[:, None] * C))


def _hovering(machine: Machine) -> tuple[Array, Array]:
    """Return k_i [N/A] and k_s [N/m] of the axes (p,) where they carry the rotor."""
    tangents = []
    for alone, force in zip(alone_of(machine), weights_of(machine), strict=True):
        law = magnet_of(alone)
        iu = hover_current(alone, law, 0.0, law.bias_force + force)
        tangents.append([float(k) for k in law.tangent(iu, 0.0)])
    k_i, k_s = np.array(tangents).T
    return k_i, k_s


class _Loop:
    """A machine with linear magnets, sampled, and what controllers make of it."""

    def __init__(self, machine: Machine, feedback: str) -> None:
        self.alone = alone_of(machine)
        self.k_i, self.k_s = _hovering(machine)
        self.T = machine.sampling_time
        parts = machine_parts(machine, noise=False)
        system = linearised(parts, self.T, self.k_i, self.k_s)
        p, m = len(machine.axes), len(machine.readings)
        self.A, self.B = system.A, system.B[:, :p]
        self.seen = shown_along_axes(machine) @ system.C[:m]
        self.velocity = None
        if feedback == "estimate":
            at = {state.name: k for k, state in enumerate(system.states)}
            self.seen, self.velocity = np.zeros((2, p, len(self.A)))
            for k, axis in enumerate(machine.axes):
                for q, value in axis.line.form.items():
                    self.seen[k, at[q]] = self.velocity[k, at[velocity_of(q)]] = value
        bending = machine.bending
        assert bending is not None
        self.slowest = 0.7 * float(bending.frequency[0])
        self.own = bending

    def with_(self, pids: tuple[PID, ...]) -> Holding:
        """Return the loop with controllers as ``core/src/controller.c`` computes them."""
        n, p, T = len(self.A), len(pids), self.T
        F = np.zeros((n + 3 * p, n + 3 * p))
        F[:n, :n] = self.A
        for k, pid in enumerate(pids):
            integral, velocity, last = range(n + 3 * k, n + 3 * k + 3)
            share = 1 / (pid.derivative_filter + T)
            F[last, :n] = self.seen[k]
            if self.velocity is None:
                F[velocity, :n] = share * self.seen[k]
                F[velocity, velocity], F[velocity, last] = 1 - T * share, -share
            else:
                F[velocity, :n] = self.velocity[k]
            F[integral, :n], F[integral, integral] = -T * pid.ki * self.seen[k], 1.0
            demanded = -pid.kp * F[last] - pid.kd * F[velocity]
            demanded[integral] += 1.0
            F[:n] += np.outer(self.B[:, k], demanded)
        z = np.linalg.eigvals(F).astype(complex)
        poles = np.log(z[np.abs(z) > math.exp(-3)]) / T  # what is gone in a sample is no motion
        springs = np.array([pid.kp for pid in pids]) * self.k_i / self.k_s - 1
        return Holding(pids, poles, min(self._score(poles), float(springs.min()) / STIFF))

    def _score(self, poles: Complex) -> float:
        ratio = -poles.real / np.abs(poles)
        bends = np.abs(poles.imag) > self.slowest
        nearest = np.abs(np.abs(poles.imag)[:, None] - self.own.frequency).argmin(axis=1)
        wanted = np.where(bends, LEFT_TO_IT * self.own.damping_ratio[nearest], WELL_DAMPED)
        return float(np.minimum(ratio / wanted, 1.0).min())
