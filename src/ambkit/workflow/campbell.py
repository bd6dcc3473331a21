"""The Campbell diagram of a whole machine: where its poles go with the speed of rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.machine.bank import alone_of
from ambkit.models.continuous import continuous
from ambkit.simulation.scenario import PID
from ambkit.workflow.machines import stiffnesses

if TYPE_CHECKING:
    from ambkit.machine.machine import Machine
    from ambkit.show.report.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Campbell:
    """Poles of a rotor in its magnets, over the speed of rotation.

    Attributes
    ----------
    machine : str
        Its name.
    speed : ndarray (n,)
        Speeds of rotation [rad/s].
    poles : ndarray of complex (n, modes)
        Each mode's pole, followed from speed to speed; of a pair the one above [1/s].
    forwards : ndarray of bool (modes,)
        Whether the mode whirls with the rotation, or against it or along the shaft.
    """

    machine: str
    speed: Array
    poles: NDArray[np.complex128]
    forwards: NDArray[np.bool_]

    @property
    def critical(self) -> list[float]:
        """Speeds at which a whirl forwards turns as fast as the rotor [rad/s]."""
        found = []
        for mode in self.poles.imag.T[self.forwards]:
            ahead = mode - self.speed
            for k in np.flatnonzero((ahead[:-1] > 0) & (ahead[1:] <= 0)):
                share = ahead[k] / (ahead[k] - ahead[k + 1])
                found.append(float(self.speed[k] + share * (self.speed[k + 1] - self.speed[k])))
        return sorted(found)

    def figure(self) -> Figure:
        """Show frequencies and damping over the speed."""
        from ambkit.show.plots.campbell import campbell_figure

        return campbell_figure(self.machine, self.speed, self.poles, self.forwards)


def campbell(machine: Machine, fastest: float | None = None, *, count: int = 121) -> Campbell:
    """Return how the poles of a rotor that is controlled go with its speed.

    It is held by the proportional and derivative gains that a simulation has, as if sensors and
    amplifiers were at once and without dead time.

    Parameters
    ----------
    machine : Machine
        The whole machine.
    fastest : float, optional
        Up to where [rad/s]; by default twice the machine's speed, or 1000 rad/s.
    count : int, optional
        Speeds.

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
    of = continuous(machine)
    rows = np.zeros_like(of.h)
    for f, (magnet, alone) in enumerate(zip(stiffnesses(machine), alone_of(machine), strict=True)):
        pid = PID.for_bearing(alone)
        held = pid.kp * of.h[f] + pid.kd * of.v[f]
        rows[f] = magnet.k_s * of.h[f] - magnet.k_i * held
    q = len(machine.positions)
    speed = np.linspace(0.0, fastest, count)
    poles = np.empty((count, q), complex)
    forwards = np.zeros(q, bool)
    for k in reversed(range(count)):  # at rest nothing tells a whirl forwards from one backwards
        A = (of.A + speed[k] * of.spin + of.b @ rows)[: 2 * q, : 2 * q]
        found, vectors = np.linalg.eig(A)
        above = np.argsort(-found.imag)[:q]
        if k == count - 1:
            poles[k] = found[above]
            forwards = _goes_forwards(vectors[:, above])
        else:
            poles[k] = _followed(poles[k + 1 : k + 3], found[above])
    order = np.argsort(poles[0].imag, kind="stable")
    return Campbell(machine.name, speed, poles[:, order], forwards[order])


def _goes_forwards(vectors: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Return whether modes (2 q, modes) go from x to y, by what of them is largest."""
    x, y, th_x, th_y = vectors[:4]
    across = np.abs(x) + np.abs(y)
    tilt = np.abs(th_x) + np.abs(th_y)
    turns = np.where(across > tilt, (x.conj() * y).imag, (th_x.conj() * th_y).imag)
    return np.asarray(turns < 0)


def _followed(
    after: NDArray[np.complex128], found: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    """Return poles in the order of those after, each next to where its path leads."""
    from scipy.optimize import linear_sum_assignment

    ahead = after[0] if len(after) < 2 else 2 * after[0] - after[1]
    _, order = linear_sum_assignment(np.abs(ahead[:, None] - found[None, :]))
    return np.asarray(found[order])
