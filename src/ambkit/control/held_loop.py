"""A machine held by a PID for each axis: sensitivity peaks, poles and their damping."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_controller import side_by_side
from ambkit.control.linear.linear_plant import POSITION, VELOCITY, OperatingPoint, of_axes, plant
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.machine.axes import isolated_axes, weights_of
from ambkit.machine.loading import levitation_current
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of, own_time
from ambkit.models.linear import LinearSystem, linearised
from ambkit.models.machine_parts import machine_parts
from ambkit.models.parts.rotor import velocities_of

TOP = 2000.0  #: Maximum frequency [Hz], or half the sampling rate.

POINTS, NEAR, WITHIN = 200, 21, 0.06
"""Points of the frequency grid, around each oscillatory mode, and the range of its shift."""

UNDAMPED = 1e-9
"""Damping ratio of a mode below which its own frequency is left out: S is zero there."""


def pid_response(gains: Any, z: Any, T: float, volts: Any) -> tuple[Any, Any, Any]:
    """Return the responses of PIDs to displacement and velocity, and of the derivative's filter."""
    # Written out, not in states as in `controller`, because hundreds of them are evaluated.
    kp, ki, kd, T_f, *_ = gains
    share = 1 / (T_f + T)
    slope = share * (1 - 1 / z) / (1 - (1 - T * share) / z)
    return volts * (kp + ki * T / (z - 1)), volts * kd, slope


class Sensitivities:
    """Loops of a machine, each axis with its own PID and all others closed."""

    def __init__(self, machine: Machine, *, estimated: bool) -> None:
        point = OperatingPoint.of_machine(machine)
        P = plant(machine, point)
        p, m = len(machine.axes), len(machine.readings)
        f = _frequencies(machine, P)
        self.T, self.z = machine.sampling_time, np.exp(2j * np.pi * f * machine.sampling_time)
        self.volts = np.array([1 / b.amplifier.gain for b in isolated_axes(machine)])
        self.measured = View(machine).measured
        self.added = np.linalg.pinv(self.measured)
        self.plant = P.response(f)[:, :m, :p]
        self.seen = self.measured @ self.plant
        self.estimator: tuple[Complex, Complex] | None = None
        if estimated:
            E = estimator_at(KalmanFilter(machine), point).response(f)
            self.estimator = E[:, :, :m], E[:, :, m:]

    def peaks(self, pids: Sequence[Any]) -> Array:
        """Return the peak of abs(S) of each axis (p,) [1], for stable and unstable loops."""
        p, gains = len(pids), [(pid.kp, pid.ki, pid.kd, pid.derivative_filter) for pid in pids]
        x, v, slope = pid_response(np.array(gains).T, self.z[:, None], self.T, self.volts)
        if self.estimator is None:
            L = self.seen * (x + v * slope)[:, None, :]
            S = np.linalg.inv(np.eye(p) + L)
        else:
            of_y, of_u = self.estimator
            by_u, by_y = (x[:, :, None] * E[:, :p] + v[:, None] * E[:, p:] for E in (of_u, of_y))
            fed = np.linalg.solve(np.eye(p) + by_u, by_y)
            m = self.plant.shape[1]
            S = self.measured @ np.linalg.inv(np.eye(m) + self.plant @ fed) @ self.added
        return np.asarray(np.abs(np.einsum("kii->ki", S)).max(axis=0))


def sensitivities(machine: Machine, *, estimated: bool) -> Sensitivities | None:
    """Loops of a machine; None if nothing holds it at the centre, or no filter is possible."""
    try:
        return Sensitivities(machine, estimated=estimated)
    except (AmbkitError, ValueError):
        return None


def _frequencies(machine: Machine, P: LinearSystem) -> Array:
    top = min(TOP, 0.5 / machine.sampling_time)
    min_frequency = 1 / (40 * math.pi * max(own_time(b) for b in isolated_axes(machine)))
    swings = np.log(P.poles()[np.abs(P.poles()) > 1e-6]) / machine.sampling_time
    swings = swings[np.abs(swings.real) < WITHIN * swings.imag]
    near = np.linspace(-1, 1, NEAR)
    about = [one.imag * (1 + WITHIN * near) for one in swings]
    about += [one.imag + 3 * abs(one.real) * near for one in swings]
    f = np.concatenate([
        np.geomspace(min(min_frequency, top / 2), top, POINTS),
        np.concatenate([np.zeros(0), *about]) / (2 * math.pi),
    ])  # fmt: skip
    undamped = swings.imag[np.abs(swings.real) < UNDAMPED * swings.imag] / (2 * math.pi)
    apart = (np.abs(f[:, None] - undamped) > UNDAMPED * f[:, None]).all(axis=1)
    return np.unique(f[(f > 0) & (f <= top) & apart])


TIMES = 300  #: Points at which a step is looked at.
STIFF = 0.4  #: Of the magnets' own stiffness, what is to be left against it.
WELL_DAMPED = 0.3  #: Damping ratio of the rigid body that is good enough.
LEFT_TO_IT = 0.5  #: Share of its own damping that a controller may take from a bending mode.


class Gains(NamedTuple):
    """Gains of a PID, as `ambkit.PID` has them."""

    kp: float
    ki: float
    kd: float
    derivative_filter: float
    anti_windup: float
    setpoint_weight: float


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """Controllers of a machine's axes, and the poles of the loop with them."""

    pids: tuple[Gains, ...]  #: Of each axis.
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


def overshoot(loop: Loop, own: float, axes: int = 1) -> float:
    """Return how far an axis goes beyond a step of its reference, of all axes the most [1]."""
    # own: of the slowest axis [s]
    closed, m = loop.closed, loop.measurements
    n, zero = len(closed.A), np.zeros((axes, len(closed.A)))
    step = np.block([[closed.A, closed.B[:, -axes:]], [zero, np.eye(axes)]])
    several = np.linalg.matrix_power(step, max(1, round(30 * own / loop.T / TIMES)))
    state, most = np.eye(n + axes)[:, n:], 0.0
    for _ in range(TIMES):
        state = several @ state
        most = max(most, float(np.diagonal(closed.C[m : m + axes] @ state[:n]).max()) - 1)
    return most


class HeldLoop:
    """A machine with linear magnets, sampled, and what controllers make of it."""

    def __init__(self, machine: Machine, feedback: str) -> None:
        self.isolated = isolated_axes(machine)
        tangents = []  # where the axes carry the rotor
        for isolated, force in zip(self.isolated, weights_of(machine), strict=True):
            law = magnet_of(isolated)
            iu = levitation_current(isolated, law, 0.0, law.bias_force + force)
            tangents.append([float(k) for k in law.tangent(iu, 0.0)])
        self.k_i, self.k_s = np.array(tangents).T
        self.T, parts = machine.sampling_time, machine_parts(machine, noise=False)
        system = linearised(parts, self.T, self.k_i, self.k_s)
        self.axes = machine.axis_names
        p, m = len(machine.axes), len(machine.readings)
        self.measured = feedback == "measurement"
        position = View(machine).measured @ system.C[:m]
        seen: Any = [position]
        if not self.measured:
            at = {state.name: k for k, state in enumerate(system.states)}
            rates = dict(zip(machine.positions, velocities_of(machine.positions), strict=True))
            position, velocity = seen = np.zeros((2, p, len(system.A)))
            for k, axis in enumerate(machine.axes):
                for q, value in axis.line.form.items():
                    position[k, at[q]] = velocity[k, at[rates[q]]] = value
        C = np.vstack([*seen, position])
        kinds = [*(POSITION, VELOCITY)[: len(seen)], POSITION]
        #: From demanded currents to what controllers see, and to the positions along the axes.
        self.plant = LinearSystem(
            system.A, system.B[:, :p], C, np.zeros((len(C), p)), self.T, system.states,
            system.inputs[:p], tuple(s for kind in kinds for s in of_axes(kind, self.axes)),
        )  # fmt: skip
        self.own = machine.bending
        self.slowest = math.inf if self.own is None else 0.7 * float(self.own.frequency[0])

    def with_(self, pids: tuple[Gains, ...]) -> Stabilisation:
        """Return the loop with controllers."""
        z = self._loop(pids).closed.poles().astype(complex)
        poles = np.log(z[np.abs(z) > math.exp(-3)]) / self.T  # what is gone at once is no motion
        springs = np.array([pid.kp for pid in pids]) * self.k_i / self.k_s - 1
        return Stabilisation(pids, poles, min(self._score(poles), float(springs.min()) / STIFF))

    def overshoot(self, pids: tuple[Gains, ...]) -> float:
        """Return how far an axis goes beyond a step of its reference, of all axes the most [1]."""
        return overshoot(self._loop(pids), max(map(own_time, self.isolated)), len(pids))

    def _loop(self, pids: tuple[Gains, ...]) -> Loop:
        P = self.plant
        K = side_by_side(pids, self.T, self.axes, measured=self.measured)
        return Loop(P, K, measurements=len(P.outputs) - len(pids))

    def _score(self, poles: Complex) -> float:
        ratio = -poles.real / np.abs(poles)
        if self.own is None:
            return float(np.minimum(ratio / WELL_DAMPED, 1.0).min())
        bends = np.abs(poles.imag) > self.slowest
        nearest = np.abs(np.abs(poles.imag)[:, None] - self.own.frequency).argmin(axis=1)
        target_damping = np.where(bends, LEFT_TO_IT * self.own.damping_ratio[nearest], WELL_DAMPED)
        return float(np.minimum(ratio / target_damping, 1.0).min())
