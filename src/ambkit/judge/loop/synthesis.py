"""Bounds on the sensitivity of a loop, and H-infinity and LQG controllers near them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.data.signals import signal
from ambkit.models.linear import EDGE, LinearSystem, Signal, pulse_sizes


def least_peaks(plant: LinearSystem) -> tuple[float, float]:
    """Return the least peaks of S and T (largest singular values) of any stabilising controller."""
    # Both are 1 for a stable plant. Else ``S(p) y = 0`` at the unstable poles p with their
    # directions y, so that ``T(p) y = y``, and ``T = N H`` where N is all-pass and has the plant's
    # zeros outside of the unit circle, those at infinity to the order of the dead time in samples
    # among them. The least peak of H is an interpolation problem after Nevanlinna and Pick, exactly
    # solved. S and T have the same one, as projections along each other have the same norm (Kato
    # 1960). For one unstable pole p and a dead time of d samples it is ``p^d``, as it is ``e^(p
    # delay)`` in continuous time.
    # Seron, Braslavsky, Goodwin, Fundamental limitations in filtering and control, 1997; Ball,
    # Gohberg, Rodman, Interpolation of rational matrix functions, 1990; Kato, Estimation of
    # iterated matrices, 1960.
    from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

    if not len(plant.unstable()):
        return 1.0, 1.0
    A, B, C = _scaled(plant)
    # Minimum-energy control, which costs only measurements squared, makes the plant N.
    try:
        X = solve_discrete_are(A, B, C.T @ C, np.zeros((B.shape[1], B.shape[1])))
        root = np.linalg.cholesky(B.T @ X @ B).T
    except np.linalg.LinAlgError:
        return 1.0, 1.0
    R, unstable_block = _growing(A, lambda pole: abs(pole) > 1 + EDGE)
    # H at the poles: A R = R growth, so that C R = N(p) root F R.
    gain_at_poles = np.linalg.solve(root.T, B.T @ X @ A @ R)
    back = np.linalg.inv(unstable_block)
    own, gramian = (
        solve_discrete_lyapunov(back.T, item.T @ item) for item in (C @ R, gain_at_poles)
    )
    bound = _ratio(gramian, own)
    return bound, bound


def _scaled(plant: LinearSystem) -> tuple[Array, Array, Array]:
    """Return A, B, C with states scaled by the response to a pulse of the controls."""
    size = pulse_sizes(plant.A, plant.B)
    A, B, C = plant.A * size / size[:, None], plant.B / size[:, None], plant.C * size
    return A, B / np.abs(B).max(), C / np.abs(C).max()


def _growing(A: Array, grows: Callable[[complex], bool]) -> tuple[Array, Array]:
    """Return a basis (n, k) of the unstable subspace, and its dynamics (k, k)."""
    from scipy.linalg import schur

    def sort(real: float, imaginary: float = 0.0) -> bool:
        return grows(complex(real, imaginary))

    form, basis, k = schur(A, sort=sort)
    return basis[:, :k], form[:k, :k]


def _ratio(gramian: Any, own: Any) -> float:
    """Return the root of the greatest ratio of two quadratic forms, or 1."""
    from scipy.linalg import eigh

    return max(1.0, float(np.sqrt(eigh(gramian, own, eigvals_only=True)[-1])))


PEAK, SLOW, AT_REST = 1.5, 0.3, 1e-4
"""Weight of S: normalised peak, bandwidth over the unstable pole, and static value."""

STRONG = 10.0
"""Weight of the control signal, relative to the requirement of the plant at the frequency of its
unstable pole.
"""


def hinf(plant: LinearSystem) -> LinearSystem:
    """Return the H-infinity controller of the mixed sensitivities S and K S."""
    # S is weighted by ``(s/1.5 + 0.3 p)/(s + 3e-5 p)`` with the fastest unstable pole p, K S by 0.1
    # over what the plant answers at p. The sampled plant goes by Tustin's transform to continuous
    # time, and the controller back, which keeps every norm (Chen and Francis 1995). Time is counted
    # in 1/p and signals in what they are at p: in metres and volts the equations lose their digits.
    # Doyle, Glover, Khargonekar, Francis, State-space solutions to standard H2 and H-infinity
    # control problems, 1989; Skogestad, Postlethwaite, Multivariable feedback control, 2005.
    control = _control()
    T = plant.T
    assert T is not None
    one = np.eye(len(plant.A))
    p = math.log(float(np.abs(plant.unstable()).max())) / T
    back = np.linalg.inv(plant.A + one)
    A, B = 2 / (T * p) * back @ (plant.A - one), 2 / math.sqrt(T * p) * back @ plant.B
    C, D = 2 / math.sqrt(T * p) * plant.C @ back, plant.D - plant.C @ back @ plant.B
    size = abs((C @ np.linalg.solve(1j * one - A, B) + D).item())
    G = control.ss(A, B / math.sqrt(size), C / math.sqrt(size), D / size)
    of_S = control.tf([1 / PEAK, SLOW], [1, SLOW * AT_REST])
    of_u = control.ss([], [], [], [[1 / STRONG]])
    try:
        with warnings.catch_warnings(), one_thread():
            warnings.simplefilter("ignore", FutureWarning)  # raised inside control
            K, _, _ = control.mixsyn(G, of_S, of_u, None)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise AmbkitError(f"there is no H-infinity controller of this plant: {error}") from None
    h = T * p / 2
    k = len(K.A)
    inverse = np.linalg.inv(np.eye(k) - h * K.A)
    return LinearSystem(
        inverse @ (np.eye(k) + h * K.A), math.sqrt(2 * h) * inverse @ K.B,
        -math.sqrt(2 * h) * K.C @ inverse / size, -(K.D + h * K.C @ inverse @ K.B) / size, T,
        tuple(Signal(f"k{j}", "1") for j in range(k)), plant.outputs, plant.inputs,
    )  # fmt: skip


def _control() -> Any:
    """Return python-control if it can solve the H-infinity problem."""
    try:
        import control
        import slycot  # noqa: F401
    except ImportError:
        raise AmbkitError(
            "H-infinity needs python-control and slycot: pip install ambkit[hinf]"
        ) from None
    return control


def block_diagonal(item: list[LinearSystem], transform: Array, names: list[str]) -> LinearSystem:
    """Return controllers of isolated axes as one, fed by the displacements of the axes."""
    # shown (p, m)
    from scipy.linalg import block_diag

    A, B, C, D = (block_diag(*(getattr(one, name) for one in item)) for name in "ABCD")
    return LinearSystem(
        A, np.hstack([B @ transform, -B]), C, np.hstack([D @ transform, -D]), item[0].T,
        tuple(Signal(f"k{j}", "1") for j in range(len(A))),
        (*(Signal(f"y{j}", "m") for j in range(len(transform[0]))),
         *(Signal(signal("r", name), "m") for name in names or [""])),
        tuple(Signal(signal("u", name), "V") for name in names or [""]),
    )  # fmt: skip


LEAST_CONTROL = 1e-2
"""Weight of the control signal beyond which nothing changes [m^2/V^2]: minimum-effort
stabilisation.
"""


@dataclass(frozen=True)
class Noise:
    """Noise model of an LQG controller; of several axes one number for each."""

    measurement: ArrayLike  #: Variances on the measurements [m^2].
    control: ArrayLike  #: Variances on the control signals [V^2].
    load: ArrayLike  #: Intensities of the disturbances' random walks [N^2/s].


class LQG:
    """Regulators of a plant by states and disturbances estimated by a Kalman filter."""

    # Åström, Introduction to stochastic control theory, 1970.

    def __init__(self, plant: LinearSystem, noise: Noise) -> None:
        assert plant.T is not None
        self.plant, n, p = plant, len(plant.A), len(plant.inputs) // 2
        self.axes, m = p, len(plant.outputs) - p
        A, self.b = plant.A, plant.B[:, :p]
        self.A = np.block([[A, plant.B[:, p:]], [np.zeros((p, n)), np.eye(p)]])
        self.B = np.vstack([self.b, np.zeros((p, p))])
        self.C = np.hstack([plant.C[:m], np.zeros((m, p))])
        # States are scaled by the response to control signals; otherwise digits are lost.
        self.size = pulse_sizes(A, self.b)
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
        """Return the controller that minimises the mean of ``x^2 + weight u^2`` over all axes."""
        # It also cancels static disturbances, and tracks references.
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
