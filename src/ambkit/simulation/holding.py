"""Controllers that hold a machine, one for each axis, and how well they do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.base.threads import one_thread
from ambkit.machine.bank import alone_of, weights_of
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import magnet_of, own_time
from ambkit.models.linear import linearised
from ambkit.models.machine import machine_parts
from ambkit.models.parts.rotor import velocities_of
from ambkit.simulation.gains import PEAK, weight_of
from ambkit.simulation.holding_margins import Sensitivities, sensitivities, shown_along_axes
from ambkit.simulation.scenario import PID

if TYPE_CHECKING:
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
BOUNDS = np.log([(0.3, 0.2, 0.5), (1.25, 1.5, 32.0)])
"""Logarithms of the least and the greatest of these shares."""
ENOUGH = 2.0
"""Peak of abs(S) from which on others are looked for."""
STRIDE, TRIES, UNHELD = 0.2, 250, 1e3
"""Of the search for the lowest peak: its first steps, its evaluations, the cost of what falls."""
OVERSHOOT, WEIGHTS = 0.13, (0.85, 0.7, 0.55, 0.4, 0.25, 0.0)
"""Of a step of a reference, at most; and shares of the set-point weight that are tried for it."""
TIMES = 300
"""Points at which a step is looked at."""
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
    """Controllers of a machine's axes, and the poles of the loop with them."""

    pids: tuple[PID, ...]  #: Of each axis.
    poles: Complex  #: (n,) Of the sampled loop at the machine's speed, with its delay [1/s].
    score: float  #: At most 1, where all is well damped; not above 0 where the rotor is not held.

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
    """Return controllers for a machine, each axis with its own."""
    # Each is tuned to its axis alone, see `PID.for_bearing`. Where that shakes a bending mode, by
    # the loop's delay or a sensor on the other side of a node, softer gains and slower derivatives
    # are tried, the same for all axes, and those are taken that leave most damping: to the rigid
    # body up to `WELL_DAMPED`, to a bending mode up to `LEFT_TO_IT` of its own. Where the peak of
    # abs(S) of an axis with all others closed is `ENOUGH` or more then, those that bring it down to
    # that of one axis alone, `PEAK`, with most stiffness; or the lowest that is found. Where a step
    # of a reference overshoots by more than `OVERSHOOT`, kp sees less of it.
    return _held(machine, feedback)


def overshoot_of(
    machine: Machine,
    pids: Sequence[PID],
    feedback: Literal["measurement", "estimate"] = "measurement",
) -> float:
    """Return how far an axis goes beyond a step of its reference, of all axes the most [1]."""
    return _Loop(machine, feedback).overshoot(tuple(pids))


@lru_cache(maxsize=64)
@one_thread()
def _held(machine: Machine, feedback: Literal["measurement", "estimate"]) -> Holding:
    usual = tuple(map(PID.for_bearing, alone_of(machine)))
    search = _Search(machine, usual, feedback)
    found = Holding(usual, np.zeros(0, complex), 1.0)
    if machine.bending is not None:
        found = search.most_damped()
    margins = sensitivities(machine, estimated=feedback == "estimate")
    if margins is None or not found.held:
        return search.weighted(found)
    if margins.peaks(found.pids).max() >= ENOUGH:
        found = search.on_margins(found, margins)
    return search.calm(search.weighted(found))


class _Search:
    """Controllers that are softer, less damped and slower than the usual ones, all axes alike."""

    def __init__(self, machine: Machine, usual: tuple[PID, ...], feedback: str) -> None:
        self.machine, self.usual, self.feedback = machine, usual, feedback
        # A velocity is not filtered again.
        self.slower = SLOWER if feedback == "measurement" else (1.0,)

    @cached_property
    def loop(self) -> _Loop:
        """The machine, and what controllers make of it."""
        return _Loop(self.machine, self.feedback)

    def of(self, pids: tuple[PID, ...], p: float, d: float, f: float) -> tuple[PID, ...]:
        """Return controllers with these shares of gains and filter."""
        return tuple(_changed(pid, p, d, f) for pid in pids)

    def most_damped(self) -> Holding:
        """Return those that leave most damping."""
        best = self.loop.with_(self.usual)
        if best.score >= 1:
            return best
        for shares in itertools.product(SOFTER, LESS_DAMPED, self.slower):
            tried = self.loop.with_(self.of(self.usual, *shares))
            best = tried if tried.score > best.score else best
        for _ in range(FINER):
            nearby = NEARBY if len(self.slower) > 1 else (1.0,)
            for shares in itertools.product(NEARBY, NEARBY, nearby):
                tried = self.loop.with_(self.of(best.pids, *shares))
                best = tried if tried.score > best.score else best
        return best

    def on_margins(self, found: Holding, margins: Sensitivities) -> Holding:
        """Return the stiffest whose peaks of abs(S) are at most `PEAK`, or those of the lowest."""
        best, lowest = found, float(margins.peaks(found.pids).max())
        near: Array = np.zeros(3)
        for p, d, f in itertools.product(SOFTER, LESS_DAMPED, self.slower):
            pids = self.of(self.usual, p, d, f)
            peak = float(margins.peaks(pids).max())
            if peak < lowest and (tried := self.loop.with_(pids)).held:
                best, lowest, near = tried, peak, np.log([p, d, f])
                if peak <= PEAK:
                    return best
        return self._refined(best, near, margins) if best is not found else best

    def _refined(self, best: Holding, near: Array, margins: Sensitivities) -> Holding:
        """Look for a lower peak beside what was tried: of all axes alike, then of each bearing."""
        # By the simplex of Nelder and Mead, in the logarithms of the shares.
        names = list(dict.fromkeys(axis.bearing.name for axis in self.machine.axes))
        of_axis = np.array([names.index(axis.bearing.name) for axis in self.machine.axes])
        free = 3 if len(self.slower) > 1 else 2
        shares = near[None, :]
        for bearings in (1, len(names)):
            start = np.broadcast_to(shares, (bearings, 3))[:, :free]
            peak, least, at = self._lowest(start, of_axis % bearings, margins)
            if least < peak:
                best = self.loop.with_(self._shared(at, of_axis % bearings))
                shares = np.zeros((bearings, 3))
                shares[:, :free] = at
            if least < ENOUGH:
                break
        return best

    def _lowest(
        self, start: Array, of_axis: NDArray[np.intp], margins: Sensitivities
    ) -> tuple[float, float, Array]:
        """Return the peak at a start, the lowest that was found, and the logarithms there."""
        from scipy.optimize import minimize

        lowest = math.inf

        def cost(at: Array) -> float:
            nonlocal lowest
            pids = self._shared(at.reshape(start.shape), of_axis)
            peak = max(PEAK, float(margins.peaks(pids).max()))
            if peak < lowest:  # poles take longer, and are asked of the best alone
                if not self.loop.with_(pids).held:
                    return UNHELD
                lowest = peak
            return peak

        first = start.ravel()
        found: Any = minimize(
            cost, first, method="Nelder-Mead",
            options={
                "maxfev": TRIES * len(start), "xatol": 1e-2, "fatol": 1e-3,
                "initial_simplex": np.vstack([first, first + STRIDE * np.eye(len(first))]),
            },
        )  # fmt: skip
        return cost(first), float(found.fun), found.x.reshape(start.shape)

    def _shared(self, logs: Array, of_axis: NDArray[np.intp]) -> tuple[PID, ...]:
        """Return the usual controllers with shares of given logarithms (bearings, 2 or 3)."""
        every = np.zeros((len(logs), 3))
        every[:, : logs.shape[1]] = logs
        shares = np.exp(np.clip(every, *BOUNDS))[of_axis]
        each = zip(self.usual, shares, strict=True)
        return tuple(_changed(pid, *map(float, share)) for pid, share in each)

    def weighted(self, found: Holding) -> Holding:
        """Return controllers that were changed with the weight of the reference of their gains."""
        if found.pids is self.usual:
            return found
        pids = tuple(
            pid.model_copy(update={"setpoint_weight": weight_of(alone, pid.kp, pid.ki, pid.kd)})
            for pid, alone in zip(found.pids, alone_of(self.machine), strict=True)
        )
        return replace(found, pids=pids)

    def calm(self, found: Holding) -> Holding:
        """Return the same with less of the references to kp, where a step overshoots by much."""
        pids = found.pids
        for share in WEIGHTS:
            if self.loop.overshoot(pids) <= OVERSHOOT:
                break
            pids = tuple(
                pid.model_copy(update={"setpoint_weight": share * pid.setpoint_weight})
                for pid in found.pids
            )
        return replace(found, pids=pids)


def _changed(pid: PID, p: float, d: float, f: float) -> PID:
    """Return a PID with shares of its gains; neither poles nor margins need its weight."""
    return PID(
        kp=pid.kp * p, ki=pid.ki * p, kd=pid.kd * d,
        derivative_filter=pid.derivative_filter * f, anti_windup=pid.anti_windup,
    )  # fmt: skip


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
            rates = dict(zip(machine.positions, velocities_of(machine.positions), strict=True))
            self.seen, self.velocity = np.zeros((2, p, len(self.A)))
            for k, axis in enumerate(machine.axes):
                for q, value in axis.line.form.items():
                    self.seen[k, at[q]] = self.velocity[k, at[rates[q]]] = value
        self.own = machine.bending
        self.slowest = math.inf if self.own is None else 0.7 * float(self.own.frequency[0])

    def with_(self, pids: tuple[PID, ...]) -> Holding:
        """Return the loop with controllers."""
        z = np.linalg.eigvals(self._closed(pids)).astype(complex)
        poles = np.log(z[np.abs(z) > math.exp(-3)]) / self.T  # what is gone at once is no motion
        springs = np.array([pid.kp for pid in pids]) * self.k_i / self.k_s - 1
        return Holding(pids, poles, min(self._score(poles), float(springs.min()) / STIFF))

    def overshoot(self, pids: tuple[PID, ...]) -> float:
        """Return how far an axis goes beyond a step of its reference, of all axes the most [1]."""
        F, n, p = self._closed(pids), len(self.A), len(pids)
        B = np.zeros((len(F), p))
        for k, pid in enumerate(pids):
            B[n + 3 * k, k] = self.T * pid.ki
            B[:n, k] = self.B[:, k] * pid.kp * pid.setpoint_weight
        samples = max(1, round(30 * max(map(own_time, self.alone)) / self.T / TIMES))
        step = np.block([[F, B], [np.zeros((p, len(F))), np.eye(p)]])
        several, state = np.linalg.matrix_power(step, samples), np.eye(len(step))[:, -p:]
        most = 0.0
        for _ in range(TIMES):
            state = several @ state
            most = max(most, float(np.diagonal(self.seen @ state[:n]).max()) - 1)
        return most

    def _closed(self, pids: tuple[PID, ...]) -> Array:
        """Return the states' matrix with controllers as ``core/src/controller.c`` has them."""
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
        return F

    def _score(self, poles: Complex) -> float:
        ratio = -poles.real / np.abs(poles)
        if self.own is None:
            return float(np.minimum(ratio / WELL_DAMPED, 1.0).min())
        bends = np.abs(poles.imag) > self.slowest
        nearest = np.abs(np.abs(poles.imag)[:, None] - self.own.frequency).argmin(axis=1)
        wanted = np.where(bends, LEFT_TO_IT * self.own.damping_ratio[nearest], WELL_DAMPED)
        return float(np.minimum(ratio / wanted, 1.0).min())
