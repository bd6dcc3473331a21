"""The linear-quadratic-Gaussian controller of a plant of one axis: a baseline for other loops."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.models.linear import LinearSystem, Signal

Array = NDArray[np.float64]

LEAST_CONTROL = 1e-2
"""Weight of the control signal beyond which nothing changes [m^2/V^2]: the controller does no more
than to hold the rotor."""


@dataclass(frozen=True)
class Noise:
    """What an LQG controller takes as noise.

    Attributes
    ----------
    measurement : float
        Variance on the measurement [m^2].
    control : float
        Variance on the control signal [V^2].
    load : float
        Growth of the load's variance [N^2/s].
    """

    measurement: float
    control: float
    load: float


class LQG:
    """Regulators of a plant by its state and its load, as a Kalman filter knows them.

    Parameters
    ----------
    plant : LinearSystem
        Sampled; inputs ``u`` [V] and ``f_d`` [N], outputs ``y`` and ``x`` [m].
    noise : Noise
        From which the filter has its gain.

    Raises
    ------
    AmbkitError
        There is no such filter.

    References
    ----------
    Åström, Introduction to stochastic control theory, 1970.
    """

    def __init__(self, plant: LinearSystem, noise: Noise) -> None:
        assert plant.T is not None
        self.plant, n = plant, len(plant.A)
        A, self.b = plant.A, plant.B[:, :1]
        self.A = np.block([[A, plant.B[:, 1:2]], [np.zeros((1, n)), np.ones((1, 1))]])
        self.B = np.vstack([self.b, [[0.0]]])
        self.C = np.hstack([plant.C[:1], [[0.0]]])
        # States are counted in what a control signal makes of them, or digits are lost.
        pulsed = [self.b]
        for _ in range(n + 1):
            pulsed.append(A @ pulsed[-1])
        self.size = np.abs(pulsed).max(axis=(0, 2))
        Q = noise.control * self.B @ self.B.T
        Q[-1, -1] += noise.load * plant.T
        size = np.append(self.size, math.sqrt(noise.load * plant.T))
        unit = math.sqrt(noise.measurement)
        P = _riccati((self.A * size / size[:, None]).T, (self.C * size / unit).T,
                     Q / np.outer(size, size), np.eye(1))  # fmt: skip
        P = P * np.outer(size, size)
        S = (self.C @ P @ self.C.T).item() + noise.measurement
        self.M = P @ self.C.T / S

    def compensator(self, weight: float = LEAST_CONTROL) -> LinearSystem:
        """Return the controller that makes the mean of ``x^2 + weight u^2`` least.

        Beside, it cancels the load at rest, and holds a reference.

        Parameters
        ----------
        weight : float, optional
            Of the control signal [m^2/V^2]; by default so much that the unstable poles are but
            mirrored.

        Returns
        -------
        LinearSystem
            Inputs ``y`` and ``r`` [m], output ``u`` [V].
        """
        n, size, A, c = len(self.plant.A), self.size, self.plant.A, self.plant.C[1:2]
        scaled = A * size / size[:, None]
        b, seen = self.b / size[:, None], c * size / math.sqrt(weight)
        X = _riccati(scaled, b, seen.T @ seen, np.eye(1))
        K = np.linalg.solve(np.eye(1) + b.T @ X @ b, b.T @ X @ scaled) / size
        rest = np.block([[np.eye(n) - A, -self.b], [c, np.zeros((1, 1))]])
        forced = np.linalg.solve(rest, np.vstack([self.plant.B[:, 1:2], [[0.0]]]))
        moved = np.linalg.solve(rest, np.vstack([np.zeros((n, 1)), [[1.0]]]))
        gain = np.hstack([K, -(K @ forced[:n] + forced[n:])])
        left = np.eye(n + 1) - self.M @ self.C
        told, direct = -gain @ left, -gain @ self.M
        ahead = K @ moved[:n] + moved[n:]
        return LinearSystem(
            self.A @ left + self.B @ told,
            np.hstack([self.A @ self.M + self.B @ direct, self.B @ ahead]),
            told, np.hstack([direct, ahead]), self.plant.T,
            (*(Signal(f"{at.name}_lqg", at.unit) for at in self.plant.states),
             Signal("f_d_lqg", "N")),
            (Signal("y", "m"), Signal("r", "m")), (Signal("u", "V"),),
        )  # fmt: skip


def _riccati(A: Array, B: Array, Q: Array, R: Array) -> Array:
    from scipy.linalg import solve_discrete_are

    try:
        return np.asarray(solve_discrete_are(A, B, Q, R))
    except np.linalg.LinAlgError:
        raise AmbkitError("there is no linear-quadratic controller of this plant") from None
