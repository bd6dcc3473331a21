"""The linear-quadratic-Gaussian controller of a plant: a baseline for other loops."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.errors import AmbkitError
from ambkit.models.linear import LinearSystem, Signal

Array = NDArray[np.float64]

LEAST_CONTROL = 1e-2
"""Weight of the control signal beyond which nothing changes [m^2/V^2]: the controller does no more
than to hold the rotor."""


@dataclass(frozen=True)
class Noise:
    """What an LQG controller takes as noise; of several axes one number for each."""

    measurement: ArrayLike  #: Variances on the measurements [m^2].
    control: ArrayLike  #: Variances on the control signals [V^2].
    load: ArrayLike  #: Growth of the loads' variances [N^2/s].


class LQG:
    """Regulators of a plant by its state and its loads, as a Kalman filter knows them."""

    # Åström, Introduction to stochastic control theory, 1970.

    def __init__(self, plant: LinearSystem, noise: Noise) -> None:
        assert plant.T is not None
        self.plant, n, p = plant, len(plant.A), len(plant.inputs) // 2
        self.axes, m = p, len(plant.outputs) - p
        A, self.b = plant.A, plant.B[:, :p]
        self.A = np.block([[A, plant.B[:, p:]], [np.zeros((p, n)), np.eye(p)]])
        self.B = np.vstack([self.b, np.zeros((p, p))])
        self.C = np.hstack([plant.C[:m], np.zeros((m, p))])
        # States are counted in what control signals make of them, or digits are lost.
        pulsed = [self.b]
        for _ in range(n + 1):
            pulsed.append(A @ pulsed[-1])
        self.size = np.abs(pulsed).max(axis=(0, 2))
        load_intensity = plant.T * np.broadcast_to(np.asarray(noise.load, float), p)
        var_u = np.broadcast_to(np.asarray(noise.control, float), p)
        var_y = np.broadcast_to(np.asarray(noise.measurement, float), m)
        Q = (self.B * var_u) @ self.B.T
        Q[n:, n:] += np.diag(load_intensity)
        size, unit = np.concatenate([self.size, np.sqrt(load_intensity)]), np.sqrt(var_y)
        P = _riccati((self.A * size / size[:, None]).T, (self.C * size / unit[:, None]).T,
                     Q / np.outer(size, size), np.eye(m))  # fmt: skip
        P = P * np.outer(size, size)
        S = self.C @ P @ self.C.T + np.diag(var_y)
        self.M = np.linalg.solve(S / np.outer(unit, unit), self.C @ P / unit[:, None]).T / unit

    def compensator(self, weight: float = LEAST_CONTROL) -> LinearSystem:
        """Return the controller that makes the mean of ``x^2 + weight u^2`` least, of all axes."""
        # Beside, it cancels the loads at rest, and holds references.
        n, p, size, A = len(self.plant.A), self.axes, self.size, self.plant.A
        c = self.plant.C[-p:]
        scaled = A * size / size[:, None]
        b, seen = self.b / size[:, None], c * size / math.sqrt(weight)
        X = _riccati(scaled, b, seen.T @ seen, np.eye(p))
        K = np.linalg.solve(np.eye(p) + b.T @ X @ b, b.T @ X @ scaled) / size
        rest = np.block([[np.eye(n) - A, -self.b], [c, np.zeros((p, p))]])
        forced = np.linalg.solve(rest, np.vstack([self.plant.B[:, p:], np.zeros((p, p))]))
        moved = np.linalg.solve(rest, np.vstack([np.zeros((n, p)), np.eye(p)]))
        gain = np.hstack([K, -(K @ forced[:n] + forced[n:])])
        left = np.eye(n + p) - self.M @ self.C
        state_gain, direct = -gain @ left, -gain @ self.M
        ahead = K @ moved[:n] + moved[n:]
        P = self.plant
        return LinearSystem(
            self.A @ left + self.B @ state_gain,
            np.hstack([self.A @ self.M + self.B @ direct, self.B @ ahead]),
            state_gain, np.hstack([direct, ahead]), P.T,
            tuple(Signal(f"{at.name}_lqg", at.unit) for at in (*P.states, *P.inputs[p:])),
            (*P.outputs[:-p], *(Signal(f"r{at.name[1:]}", "m") for at in P.outputs[-p:])),
            P.inputs[:p],
        )  # fmt: skip


def _riccati(A: Array, B: Array, Q: Array, R: Array) -> Array:
    from scipy.linalg import solve_discrete_are

    try:
        return np.asarray(solve_discrete_are(A, B, Q, R))
    except np.linalg.LinAlgError:
        raise AmbkitError("there is no linear-quadratic controller of this plant") from None
