"""Whirl modes of a levitated rotor: poles and critical speeds over the speed of rotation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.control.held_loop import Gains
from ambkit.control.pid import PID
from ambkit.control.stabilising_controller import holding
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.continuous import continuous

DAMPED = 2.5  #: Amplification factor below which API 617 regards a mode as critically damped.


class CriticalSpeed(NamedTuple):
    """A speed at which unbalance excites a forward whirl."""

    speed: float  #: Speed of rotation [rad/s].
    damping_ratio: float  #: Damping ratio of the whirl there [1].

    @property
    def amplification(self) -> float:
        """Amplification factor 1/(2 zeta) [1]; infinite for an undamped whirl."""
        return 1 / (2 * self.damping_ratio) if self.damping_ratio > 0 else math.inf

    @property
    def damped(self) -> bool:
        """Whether API 617 regards it as critically damped, and not as a critical speed."""
        return self.amplification < DAMPED


@dataclass(frozen=True, eq=False, repr=False)
class WhirlModes:
    """Poles of a levitated rotor over the speed of rotation."""

    machine: Machine  #: The machine.
    speed: Array  #: (n,) Speeds of rotation [rad/s].
    #: (n, modes) Pole of each mode, tracked over the speed; of a pair the one with positive
    #: imaginary part [1/s].
    poles: NDArray[np.complex128]
    #: (modes,) Whether the mode whirls forward; else backward or, if `axial`, along the shaft.
    forwards: NDArray[np.bool_]
    #: (modes,) Whether the mode moves along the shaft, without whirl.
    axial: NDArray[np.bool_]

    @property
    def whirl(self) -> list[str]:
        """``"forward"``, ``"backward"`` or ``"axial"`` for each mode."""
        return [
            "axial" if along else "forward" if ahead else "backward"
            for ahead, along in zip(self.forwards, self.axial, strict=True)
        ]

    @property
    def critical(self) -> list[float]:
        """Speeds equal to a forward whirl frequency [rad/s]."""
        return [item.speed for item in self.criticals]

    @cached_property
    def criticals(self) -> list[CriticalSpeed]:
        """The same with the damping of the whirl there."""
        results = []
        for mode in self.poles.T[self.forwards]:
            ahead = mode.imag - self.speed  # at standstill an overdamped mode has rounding only
            for k in np.flatnonzero((ahead[:-1] > 1e-9 * self.speed[-1]) & (ahead[1:] <= 0)):
                share = ahead[k] / (ahead[k] - ahead[k + 1])
                at = self.speed[k] + share * (self.speed[k + 1] - self.speed[k])
                pole = mode[k] + share * (mode[k + 1] - mode[k])
                results.append(CriticalSpeed(float(at), float(-pole.real / abs(pole))))
        return sorted(results)


def whirl_modes(
    machine: Machine,
    fastest: QuantityLike | None = None,
    *,
    count: int = 121,
    pids: Sequence[PID | Gains] | None = None,
) -> WhirlModes:
    """Return the poles of a rotor over its speed, with given gains or those of its controllers."""
    fastest = max_speed(machine, fastest)
    if count < 2:
        raise AmbkitError(f"count must be 2 or more, got {count!r}")
    q = len(machine.positions)
    standstill, spin = held(machine, pids)
    speed = np.linspace(0.0, fastest, count)
    poles = np.empty((count, q), complex)
    forwards = along = np.zeros(q, bool)
    # at standstill forward and backward whirl are not distinguishable
    for k in reversed(range(count)):
        A = standstill + speed[k] * spin
        result, vectors = np.linalg.eig(A + _apart(machine, A) if k == count - 1 else A)
        above = np.flatnonzero(result.imag >= 0)
        if k == count - 1:  # the others are filter poles
            least_damped = above[np.argsort(-(result.imag / np.abs(result))[above])[:q]]
            poles[k] = result[least_damped]
            along = _goes_along(vectors[:q, least_damped], machine)
            forwards = _goes_forwards(vectors[:q, least_damped], machine) & ~along
        else:
            poles[k] = followed(poles[k + 1 : k + 3], result[above])
    order = np.argsort(poles[0].imag, kind="stable")
    return WhirlModes(machine, speed, poles[:, order], forwards[order], along[order])


def max_speed(machine: Machine, fastest: QuantityLike | None) -> float:
    """Return the maximum speed of an evaluation [rad/s]."""
    if machine.rotor.type == "mass":
        raise AmbkitError(f"{machine.name} does not turn: its rotor moves along one axis")
    fastest = in_si("fastest", fastest, "rad/s")
    fastest = (2 * abs(machine.speed) or 1000.0) if fastest is None else fastest
    if not (math.isfinite(fastest) and fastest > 0):
        raise AmbkitError(f"fastest must be greater than 0 rad/s, is {fastest:g} rad/s")
    return fastest


def stiffnesses(machine: Machine) -> list[ConstantStiffness]:
    """Return the stiffnesses of each axis at the operating point."""
    return [ConstantStiffness.of(machine.isolated_axis(axis.name)) for axis in machine.axes]


def held(machine: Machine, pids: Sequence[PID | Gains] | None = None) -> tuple[Array, Array]:
    """Return A at standstill, and its change per 1 rad/s, of the rotor with its controllers."""
    of, q2 = continuous(machine), 2 * len(machine.positions)
    A, spin = of.A[:q2, :q2], of.spin[:q2, :q2]
    pids = pids or holding(machine).pids
    k_i, k_s = np.array([[k.k_i, k.k_s] for k in stiffnesses(machine)]).T
    kp, kd, slow = np.array([[pid.kp, pid.kd, pid.derivative_filter] for pid in pids]).T
    h, v, b = of.h[:, :q2], of.v[:, :q2], of.push[:q2]
    A = A + b @ ((k_s - k_i * kp)[:, None] * h)
    if machine.bending is None:
        return A - b @ ((k_i * kd)[:, None] * v), spin
    filtered = np.block([[A, -b * (k_i * kd)], [v / slow[:, None], -np.diag(1 / slow)]])
    p = len(pids)
    return filtered, np.pad(spin, ((0, p), (0, p)))


def _apart(machine: Machine, A: Array) -> Array:
    """Return a perturbation that separates whirls of equal frequency, as of a symmetric rotor."""
    # Gyroscopics that change a frequency by some 1e-9.
    at, n = {name: k for k, name in enumerate(machine.positions)}, len(machine.positions)
    least = np.zeros_like(A)
    rate = 1e-9 * float(np.abs(np.linalg.eigvals(A)).max())
    for name, k in at.items():
        if name.endswith("x") and not name.startswith("th"):
            other = at[f"{name[:-1]}y"]
            least[n + k, n + other], least[n + other, n + k] = -rate, rate
    return least


def _goes_forwards(shapes: NDArray[np.complex128], machine: Machine) -> NDArray[np.bool_]:
    """Return whether modes (q, modes) whirl from x to y, by their angular momentum."""
    at = {name: k for k, name in enumerate(machine.positions)}
    pairs = [(name, f"{name[:-1]}y") for name in at if name.endswith("x")]
    turns = sum(
        machine.masses[at[x]] * (shapes[at[x]].conj() * shapes[at[y]]).imag for x, y in pairs
    )
    return np.asarray(np.asarray(turns) < 0)


def _goes_along(shapes: NDArray[np.complex128], machine: Machine) -> NDArray[np.bool_]:
    """Return whether modes (q, modes) move along the shaft, by their kinetic energy."""
    energy = machine.masses[:, None] * np.abs(shapes) ** 2
    axial = np.array([name == "z" for name in machine.positions])
    return np.asarray(2 * energy[axial].sum(axis=0) > energy.sum(axis=0))


def followed(
    after: Sequence[NDArray[np.complex128]] | NDArray[np.complex128], result: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return poles in the order of the preceding ones, each next to its extrapolated path."""
    from scipy.optimize import linear_sum_assignment

    ahead = after[0] if len(after) < 2 else 2 * after[0] - after[1]
    _, order = linear_sum_assignment(np.abs(ahead[:, None] - result[None, :]))
    return np.asarray(result[order])
