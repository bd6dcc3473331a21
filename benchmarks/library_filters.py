"""The linear filter, with constant stiffnesses, in libraries that are there if one installs them.

The state is counted in micrometres, because statsmodels takes innovation variances below 1e-12 for
singular: in metres it would be wrong by a third here. JAX and simdkalman do not mind.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.python_filters import H, force_input, transition
from benchmarks.work import Work

Array = NDArray[np.float64]
Run = Callable[[], Array]

MICRO = np.array([1e-6, 1e-6, 1.0, 1e-6])  # units of x, v, f_d, x_m


class Model:
    """``X(k+1) = A X(k) + B u(k) + c``, ``y = H X`` in micrometres."""

    def __init__(self, work: Work) -> None:
        h = work.settings
        scale, inverse = np.diag(MICRO), np.diag(1 / MICRO)
        b = inverse @ force_input(h)
        g = float(work.k_i[0]) * h.k_ui
        self.A = inverse @ transition(h, float(work.k_s[0])) @ scale
        self.B = b * g
        self.c = b * h.f_0
        self.Q = np.outer(b, b) * g * g * h.var_u + inverse @ h.Q @ inverse
        self.R = h.r * 1e12
        self.mean = inverse @ work.mean
        self.cov = inverse @ work.cov @ inverse


def jax_batch(work: Work, y: Array, u: Array) -> Run:
    """A `scan` along the record, with the covariance as dense matrices, compiled by XLA."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    m = Model(work)
    A, B, c, Q, R = (jnp.asarray(a) for a in (m.A, m.B, m.c, m.Q, m.R))

    def step(state, signals):  # type: ignore[no-untyped-def]
        x, P = state
        y, u, moved = signals
        x = jnp.where(moved, A @ x + B * u + c, x)
        P = jnp.where(moved, A @ P @ A.T + Q, P)
        S, e = P[3, 3] + R, y - x[3]
        K = P[:, 3] / S
        x = x + K * e
        P = P - jnp.outer(K, P[3])
        P = 0.5 * (P + P.T)
        return (x, P), (x, e, S)

    moved = np.arange(y.shape[1]) > 0
    acted = np.concatenate([u[:, :1], u[:, :-1]], axis=1)

    @jax.jit
    def batch(y, u):  # type: ignore[no-untyped-def]
        def one(y, u):  # type: ignore[no-untyped-def]
            return jax.lax.scan(step, (jnp.asarray(m.mean), jnp.asarray(m.cov)), (y, u, moved))[1]

        return jax.vmap(one)(y, u)

    small = y * 1e6
    return lambda: np.asarray(batch(small, acted)[0]) * MICRO


def simdkalman_batch(work: Work, y: Array, u: Array) -> Run:
    """simdkalman knows no control signal: what it does is taken out of the measurements before.

    Estimates of a linear filter superpose; the path by the control alone is not timed.
    """
    import simdkalman

    m = Model(work)
    path = np.zeros((*y.shape, 4))
    for k in range(1, y.shape[1]):
        path[:, k] = path[:, k - 1] @ m.A.T + u[:, k - 1, None] * m.B + m.c
    kf = simdkalman.KalmanFilter(
        state_transition=m.A,
        process_noise=m.Q,
        observation_model=H,
        observation_noise=np.array([[m.R]]),
    )
    rest = y * 1e6 - path[:, :, 3]

    def run() -> Array:
        out = kf.compute(
            rest, 0, initial_value=m.mean, initial_covariance=m.cov, smoothed=False, filtered=True,
            states=True, observations=False,
        )  # fmt: skip
        return np.asarray((out.filtered.states.mean + path) * MICRO)

    return run


def statsmodels_run(work: Work, y: Array, u: Array) -> Run:
    """statsmodels' state-space filter, in Cython; the control is an intercept of each sample."""
    from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

    m = Model(work)
    kf = KalmanFilter(k_endog=1, k_states=4)
    kf.bind(y * 1e6)
    kf["design"], kf["transition"] = H, m.A
    kf["selection"], kf["state_cov"] = np.eye(4), m.Q
    kf["obs_cov"] = np.array([[m.R]])
    kf["state_intercept"] = np.outer(m.B, u) + m.c[:, None]
    kf.initialize_known(m.mean, m.cov)
    return lambda: np.asarray(kf.filter().filtered_state.T * MICRO)
