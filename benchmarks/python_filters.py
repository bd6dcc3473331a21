"""The same filter with NumPy and with filterpy: dense matrices, a few calls a sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.work import Settings, Work

Array = NDArray[np.float64]

H = np.array([[0.0, 0.0, 0.0, 1.0]])


def transition(h: Settings, k_s: float) -> Array:
    """A of eq. 20 (4, 4), with the sensor's lag exact; the magnet is asked at x + v T/2."""
    L = np.array(
        [[1.0, h.T, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [h.b, h.c, 0.0, h.a]]
    )
    return L + np.outer(force_input(h), [k_s, k_s * h.T / 2, 1.0, 0.0])


def force_input(h: Settings) -> Array:
    """How a force on the rotor moves the state (4,)."""
    return np.array([0.5 * h.T**2 / h.m, h.T / h.m, 0.0, h.d])


def numpy_run(work: Work) -> Array:
    """NumPy's matrix products; the covariance is made symmetric again after each update.

    Without that, this textbook form diverges on this unstable plant.
    """
    h, x, P = work.settings, work.mean.copy(), work.cov.copy()
    b = force_input(h)
    bb, growth = np.outer(b, b), h.Q
    out = np.empty((work.y.size, 4))
    innovation, variance = np.empty(work.y.size), np.empty(work.y.size)
    for k in range(work.y.size):
        if k > 0:
            A, g = transition(h, work.k_s[k - 1]), work.k_i[k - 1] * h.k_ui
            x = A @ x + b * (g * work.u[k - 1] + h.f_0)
            P = A @ P @ A.T + bb * (g * g * h.var_u) + growth
        innovation[k], variance[k] = work.y[k] - x[3], P[3, 3] + h.r
        K = P[:, 3] / variance[k]
        x = x + K * innovation[k]
        P = P - np.outer(K, P[3])
        P = 0.5 * (P + P.T)
        out[k] = x
    return out


def filterpy_run(work: Work) -> Array:
    """filterpy's KalmanFilter with its own Joseph update."""
    from filterpy.kalman import KalmanFilter  # type: ignore[import-untyped]

    h = work.settings
    b = force_input(h)
    bb, growth = np.outer(b, b), h.Q
    kf = KalmanFilter(dim_x=4, dim_z=1, dim_u=1)
    kf.x, kf.P, kf.H, kf.B = work.mean.reshape(4, 1), work.cov.copy(), H, b.reshape(4, 1)
    kf.R = np.array([[h.r]])
    out = np.empty((work.y.size, 4))
    innovation, variance = np.empty(work.y.size), np.empty(work.y.size)
    for k in range(work.y.size):
        if k > 0:
            g = work.k_i[k - 1] * h.k_ui
            kf.predict(
                u=np.array([[g * work.u[k - 1] + h.f_0]]),
                F=transition(h, work.k_s[k - 1]),
                Q=bb * (g * g * h.var_u) + growth,
            )
        kf.update(work.y[k])
        out[k], innovation[k], variance[k] = kf.x[:, 0], kf.y[0, 0], kf.S[0, 0]
    return out
