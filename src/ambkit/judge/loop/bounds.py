"""The lowest peaks of S and T that any controller could reach with a plant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ambkit.models.linear import EDGE, LinearSystem
from ambkit.models.model import Array


def least_peaks(plant: LinearSystem) -> tuple[float, float]:
    """The least peaks of S and T, by largest singular values, with any stabilising control."""
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
    # What costs nothing but the measurements' squares: closed so, the plant is N.
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


def least_peak_of_delay(plant: LinearSystem, delay: float) -> float:
    """Return what no controller in continuous time is below, by the dead time alone [1]."""
    # Sampling, zeros, and that control is late for other reasons make it only worse. It is ``e^(p
    # delay)`` of the fastest pole where the poles' directions are at right angles.
    from scipy.linalg import expm, solve_continuous_lyapunov

    if not len(plant.unstable()):
        return 1.0
    edge = EDGE * float(np.abs(plant.poles()).max())
    R, unstable_block = _growing(plant.A, lambda pole: pole.real > edge)
    seen = plant.C @ R
    own, gramian = (
        solve_continuous_lyapunov(unstable_block.T, item.T @ item)
        for item in (seen, seen @ expm(delay * unstable_block))
    )
    return _ratio(gramian, own)


def _scaled(plant: LinearSystem) -> tuple[Array, Array, Array]:
    """Return A, B, C with states counted in what a pulse of the controls makes of them."""
    pulsed = [plant.B]
    for _ in plant.A:
        pulsed.append(plant.A @ pulsed[-1])
    size = np.abs(pulsed).max(axis=(0, 2))
    A, B, C = plant.A * size / size[:, None], plant.B / size[:, None], plant.C * size
    return A, B / np.abs(B).max(), C / np.abs(C).max()


def _growing(A: Array, grows: Callable[[complex], bool]) -> tuple[Array, Array]:
    """Return a basis (n, k) of the states that the unstable poles move, and its own A (k, k)."""
    from scipy.linalg import schur

    def sort(real: float, imaginary: float = 0.0) -> bool:
        return grows(complex(real, imaginary))

    form, basis, k = schur(A, sort=sort)
    return basis[:, :k], form[:k, :k]


def _ratio(gramian: Any, own: Any) -> float:
    """Return the root of the greatest ratio of two quadratic forms, or 1."""
    from scipy.linalg import eigh

    return max(1.0, float(np.sqrt(eigh(gramian, own, eigvals_only=True)[-1])))
