"""The Campbell diagram of a whole machine: where its poles go with the speed of rotation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.showing import Drawn
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.continuous import continuous
from ambkit.simulation.holding import holding

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.result.report.figure import Figure
    from ambkit.simulation.holding import Gains
    from ambkit.simulation.scenario import PID

Array = NDArray[np.float64]


class CriticalSpeed(NamedTuple):
    """A speed at which unbalance meets a forward whirl."""

    speed: float
    """Of rotation [rad/s]."""
    damping_ratio: float
    """Of the whirl there [1]."""

    @property
    def amplification(self) -> float:
        """Amplification factor 1/(2 zeta) [1]; infinite of a whirl that is not damped."""
        return 1 / (2 * self.damping_ratio) if self.damping_ratio > 0 else math.inf


@dataclass(frozen=True, eq=False)
class Campbell(Drawn):
    """Poles of a rotor in its magnets, over the speed of rotation."""

    machine: str  #: Its name.
    speed: Array  #: (n,) Speeds of rotation [rad/s].
    #: (n, modes) Each mode's pole, followed from speed to speed; of a pair the one above [1/s].
    poles: NDArray[np.complex128]
    #: (modes,) Whether the mode whirls with the rotation; else against it or, where `axial`, along
    #: the shaft.
    forwards: NDArray[np.bool_]
    #: (modes,) Whether the mode moves along the shaft, and does not whirl.
    axial: NDArray[np.bool_]

    @property
    def whirl(self) -> list[str]:
        """Of each mode ``"forward"``, ``"backward"`` or ``"axial"``."""
        return [
            "axial" if along else "forward" if ahead else "backward"
            for ahead, along in zip(self.forwards, self.axial, strict=True)
        ]

    @property
    def critical(self) -> list[float]:
        """Speeds at which a whirl forwards turns as fast as the rotor [rad/s]."""
        return [each.speed for each in self.criticals]

    @property
    def criticals(self) -> list[CriticalSpeed]:
        """The same with the damping of the whirl there."""
        found = []
        for mode in self.poles.T[self.forwards]:
            ahead = mode.imag - self.speed  # at rest, of a mode that only creeps, but rounding
            for k in np.flatnonzero((ahead[:-1] > 1e-9 * self.speed[-1]) & (ahead[1:] <= 0)):
                share = ahead[k] / (ahead[k] - ahead[k + 1])
                at = self.speed[k] + share * (self.speed[k + 1] - self.speed[k])
                pole = mode[k] + share * (mode[k + 1] - mode[k])
                found.append(CriticalSpeed(float(at), float(-pole.real / abs(pole))))
        return sorted(found)

    def to_dict(self) -> dict[str, object]:
        """Return the speeds at which unbalance meets a whirl [rad/s], and the modes at rest."""
        poles, last = self.poles[0], self.poles[-1]
        return {
            "machine": self.machine,
            "fastest": float(self.speed[-1]),
            "critical": self.critical,
            "modes": [
                {"whirl": way, "forwards": way == "forward",
                 "frequency": [float(a.imag), float(b.imag)]}
                for a, b, way in zip(poles, last, self.whirl, strict=True)
            ],
        }  # fmt: skip

    def figure(self) -> Figure:
        """Show frequencies and damping over the speed."""
        from ambkit.show.plots.campbell import campbell_figure

        return campbell_figure(self.machine, self.speed, self.poles, self.whirl)


def campbell(
    machine: Machine,
    fastest: float | None = None,
    *,
    count: int = 121,
    pids: Sequence[PID | Gains] | None = None,
) -> Campbell:
    """Return how the poles of a rotor that is controlled go with its speed.

    It is held by the proportional and derivative gains that a simulation has, as if sensors and
    amplifiers were at once and without dead time; of a rotor that bends, with the filters of the
    derivatives.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    fastest : float, optional
        Up to where [rad/s]; by default twice the machine's speed, or 1000 rad/s.
    count : int, optional
        Speeds.
    pids : sequence of PID (p,), optional
        Of the axes; by default those of `holding`.

    Raises
    ------
    ValueError
        `fastest` is not greater than 0, or `count` less than 2.
    """
    fastest = (2 * abs(machine.speed) or 1000.0) if fastest is None else fastest
    if not (math.isfinite(fastest) and fastest > 0):
        raise ValueError(f"fastest must be greater than 0 rad/s, got {fastest!r}")
    if count < 2:
        raise ValueError(f"count must be 2 or more, got {count!r}")
    q = len(machine.positions)
    at_rest, spin = held(machine, pids)
    speed = np.linspace(0.0, fastest, count)
    poles = np.empty((count, q), complex)
    forwards = along = np.zeros(q, bool)
    for k in reversed(range(count)):  # at rest nothing tells a whirl forwards from one backwards
        A = at_rest + speed[k] * spin
        found, vectors = np.linalg.eig(A + _apart(machine, A) if k == count - 1 else A)
        above = np.flatnonzero(found.imag >= 0)
        if k == count - 1:  # the others are filters
            least_damped = above[np.argsort(-(found.imag / np.abs(found))[above])[:q]]
            poles[k] = found[least_damped]
            along = _goes_along(vectors[:q, least_damped], machine)
            forwards = _goes_forwards(vectors[:q, least_damped], machine) & ~along
        else:
            poles[k] = _followed(poles[k + 1 : k + 3], found[above])
    order = np.argsort(poles[0].imag, kind="stable")
    return Campbell(machine.name, speed, poles[:, order], forwards[order], along[order])


def stiffnesses(machine: Machine) -> list[ConstantStiffness]:
    """Return the stiffnesses of each axis at the work point."""
    return [ConstantStiffness.of(machine.alone(axis.name)) for axis in machine.axes]


def held(machine: Machine, pids: Sequence[PID | Gains] | None = None) -> tuple[Array, Array]:
    """Return A at rest, and what it gains by 1 rad/s, of the rotor on its controllers."""
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
    """What tells whirls that nothing else does: of one frequency, as of a symmetric rotor."""
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
    """Return whether modes (q, modes) go from x to y, by their angular momentum."""
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


def _followed(
    after: NDArray[np.complex128], found: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return poles in the order of those after, each next to where its path leads."""
    from scipy.optimize import linear_sum_assignment

    ahead = after[0] if len(after) < 2 else 2 * after[0] - after[1]
    _, order = linear_sum_assignment(np.abs(ahead[:, None] - found[None, :]))
    return np.asarray(found[order])
