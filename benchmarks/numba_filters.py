"""The same filter in numba: structured as hand_loop.c, with 25 rules, and with dense matrices.

numba compiles for the processor at hand, with all its instructions; ambkit and the hand loop are
built portably. ``error_model="numpy"`` spares numba the check for division by zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from ambkit import Expert
from benchmarks.work import Settings, Work

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])
Start = tuple[float, ...]


def njit(function: Function) -> Function:
    """Compile with numba; type checkers see the function as it is written."""
    return cast(Function, numba.njit(error_model="numpy")(function))


@njit
def predict(h: Settings, force: float, k_i: float, k_s: float, s: Start) -> Start:
    """Eq. 9, 10; `s` is the mean (4) and the upper triangle of the covariance (10)."""
    x0, x1, x2, x3, p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = s
    T, tm, c, a, b = h.T, h.T / h.m, 0.5 * h.T * h.T / h.m, h.a, h.b
    f, g = force + x2, k_i * h.k_ui
    a00, a10 = 1 + c * k_s, tm * k_s
    m00, m01 = a00 * p00 + T * p01 + c * p02, a00 * p01 + T * p11 + c * p12
    m02, m03 = a00 * p02 + T * p12 + c * p22, a00 * p03 + T * p13 + c * p23
    m10, m11 = a10 * p00 + p01 + tm * p02, a10 * p01 + p11 + tm * p12
    m12, m13 = a10 * p02 + p12 + tm * p22, a10 * p03 + p13 + tm * p23
    m30, m33 = b * p00 + a * p03, b * p03 + a * p33
    q = g * g * h.var_u
    return (
        x0 + T * x1 + c * f,
        x1 + tm * f,
        x2,
        b * x0 + a * x3,
        m00 * a00 + m01 * T + m02 * c + c * c * q,
        m00 * a10 + m01 + m02 * tm + c * tm * q,
        m02,
        m00 * b + m03 * a,
        m10 * a10 + m11 + m12 * tm + tm * tm * q,
        m12,
        m10 * b + m13 * a,
        p22 + h.var_d,
        b * p02 + a * p23,
        m30 * b + m33 * a,
    )


@njit
def update(h: Settings, y: float, s: Start) -> tuple[Start, float, float]:
    """Eq. 11-13; returns the state, the innovation and its variance."""
    x0, x1, x2, x3, p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = s
    S, e = p33 + h.r, y - x3
    inv = 1 / S
    g0, g1, g2, g3 = p03 * inv, p13 * inv, p23 * inv, p33 * inv
    new = (
        x0 + g0 * e,
        x1 + g1 * e,
        x2 + g2 * e,
        x3 + g3 * e,
        p00 - g0 * p03,
        p01 - g0 * p13,
        p02 - g0 * p23,
        p03 - g0 * p33,
        p11 - g1 * p13,
        p12 - g1 * p23,
        p13 - g1 * p33,
        p22 - g2 * p23,
        p23 - g2 * p33,
        p33 - g3 * p33,
    )
    return new, e, S


@njit
def structured(h: Settings, start: Start, y: Array, u: Array, k_i: Array, k_s: Array) -> Array:
    s = start
    mean, innovation, variance = np.empty((y.size, 4)), np.empty(y.size), np.empty(y.size)
    for k in range(y.size):
        if k > 0:
            force = k_i[k - 1] * h.k_ui * u[k - 1] + k_s[k - 1] * s[0] + h.f_0
            s = predict(h, force, k_i[k - 1], k_s[k - 1], s)
        s, innovation[k], variance[k] = update(h, y[k], s)
        mean[k, 0], mean[k, 1], mean[k, 2], mean[k, 3] = s[0], s[1], s[2], s[3]
    return mean


@numba.njit(error_model="numpy", parallel=True)  # type: ignore[untyped-decorator]
def parallel(
    h: Settings, start: Start, y: Array, u: Array, k_i: Array, k_s: Array, out: Array
) -> None:  # many runs (runs, n), means into out (runs, n, 4)
    for run in numba.prange(y.shape[0]):
        s = start
        for k in range(y.shape[1]):
            if k > 0:
                force = k_i[k - 1] * h.k_ui * u[run, k - 1] + k_s[k - 1] * s[0] + h.f_0
                s = predict(h, force, k_i[k - 1], k_s[k - 1], s)
            s, _, _ = update(h, y[run, k], s)
            for i in range(4):
                out[run, k, i] = s[i]


def stepper(work: Work) -> Callable[[Array, float, float], Array]:
    """One sample a call: ``step(state, y, u)`` changes the state (14,) and returns a new mean (4,).

    Parameters and stiffnesses are constants of the compiled function, which spares handing them
    over at each call.
    """
    h, k_i, k_s = work.settings, float(work.k_i[0]), float(work.k_s[0])

    @njit
    def step(state: Array, y: float, u: float) -> Array:
        s = (
            state[0], state[1], state[2], state[3], state[4], state[5], state[6],
            state[7], state[8], state[9], state[10], state[11], state[12], state[13],
        )  # fmt: skip
        s = predict(h, k_i * h.k_ui * u + k_s * s[0] + h.f_0, k_i, k_s, s)
        s, _, _ = update(h, y, s)
        for i in range(14):
            state[i] = s[i]
        return state[:4].copy()

    return step


class Rules(NamedTuple):
    """A normalised network with the same centres for both outputs, all (rules,)."""

    iu_min: float
    iu_max: float
    x_min: float
    x_max: float
    per_ampere: float
    per_metre: float
    centre_iu: Array  # scaled
    centre_x: Array
    sharpness_k_i: Array  # 1 / (2 sigma^2)
    sharpness_k_s: Array
    weight_k_i: Array
    weight_k_s: Array

    @classmethod
    def of(cls, expert: Expert) -> Rules:
        (k_i, k_s), (w_i, w_s) = 1 / (2 * expert.widths**2), expert.weights
        current = np.array([rule.current for rule in expert.rules])
        displacement = np.array([rule.displacement for rule in expert.rules])
        return cls(
            *expert.current_range,
            *expert.displacement_range,
            expert.per_ampere,
            expert.per_metre,
            current * expert.per_ampere,
            displacement * expert.per_metre,
            *(np.ascontiguousarray(a) for a in (k_i, k_s, w_i, w_s)),
        )


@njit
def ask(rules: Rules, iu: float, x: float) -> tuple[float, float]:
    """Eq. 32-33, normalised: k_i [N/A], k_s [N/m]."""
    p = min(max(iu, rules.iu_min), rules.iu_max) * rules.per_ampere
    q = min(max(x, rules.x_min), rules.x_max) * rules.per_metre
    sum_i = sum_s = all_i = all_s = 0.0
    for r in range(rules.centre_iu.size):
        square = (p - rules.centre_iu[r]) ** 2 + (q - rules.centre_x[r]) ** 2
        u_i = math.exp(-square * rules.sharpness_k_i[r])
        u_s = math.exp(-square * rules.sharpness_k_s[r])
        sum_i, sum_s = sum_i + rules.weight_k_i[r] * u_i, sum_s + rules.weight_k_s[r] * u_s
        all_i, all_s = all_i + u_i, all_s + u_s
    return sum_i / all_i, sum_s / all_s


@njit
def with_rules(h: Settings, rules: Rules, start: Start, y: Array, u: Array) -> Array:
    s = start
    mean, innovation, variance = np.empty((y.size, 4)), np.empty(y.size), np.empty(y.size)
    stiffness = np.empty((y.size, 2))
    for k in range(y.size):
        if k > 0:
            iu = h.k_ui * u[k - 1]
            k_i, k_s = ask(rules, iu, s[0])
            s = predict(h, k_i * iu + k_s * s[0] + h.f_0, k_i, k_s, s)
            stiffness[k, 0], stiffness[k, 1] = k_i, k_s
        s, innovation[k], variance[k] = update(h, y[k], s)
        mean[k, 0], mean[k, 1], mean[k, 2], mean[k, 3] = s[0], s[1], s[2], s[3]
    return mean


@njit
def dense(
    h: Settings, x: Array, P: Array, y: Array, u: Array, k_i: Array, k_s: Array
) -> Array:  # what one writes without thinking of zeros: 4 x 4 loops, work arrays made once
    tm, c = h.T / h.m, 0.5 * h.T * h.T / h.m
    A, AP, K = np.zeros((4, 4)), np.empty((4, 4)), np.empty(4)
    b, Q = np.array([c, tm, 0.0, 0.0]), np.array([0.0, 0.0, h.var_d, 0.0])
    A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2], A[3, 0], A[3, 3] = h.T, c, 1, tm, 1, h.b, h.a
    new = np.empty(4)
    mean, innovation, variance = np.empty((y.size, 4)), np.empty(y.size), np.empty(y.size)
    for k in range(y.size):
        if k > 0:
            A[0, 0], A[1, 0] = 1 + c * k_s[k - 1], tm * k_s[k - 1]
            g = k_i[k - 1] * h.k_ui
            force = g * u[k - 1] + h.f_0
            for i in range(4):
                new[i] = b[i] * force
                for j in range(4):
                    new[i] += A[i, j] * x[j]
                    AP[i, j] = 0.0
                    for m in range(4):
                        AP[i, j] += A[i, m] * P[m, j]
            x[:] = new
            for i in range(4):
                for j in range(i, 4):
                    entry = b[i] * b[j] * g * g * h.var_u
                    for m in range(4):
                        entry += AP[i, m] * A[j, m]
                    P[i, j] = P[j, i] = entry
                P[i, i] += Q[i]
        S, e = P[3, 3] + h.r, y[k] - x[3]
        for i in range(4):
            K[i] = P[i, 3] / S
            x[i] += K[i] * e
        new[:] = P[3]
        for i in range(4):
            for j in range(i, 4):
                P[i, j] -= K[i] * new[j]
                P[j, i] = P[i, j]
        mean[k, :] = x
        innovation[k], variance[k] = e, S
    return mean


def start_of(work: Work) -> Start:
    """Mean and upper triangle of the covariance at the start, 14 numbers."""
    return (*work.mean.tolist(), *work.cov[np.triu_indices(4)].tolist())


def structured_run(work: Work) -> Array:
    return structured(work.settings, start_of(work), work.y, work.u, work.k_i, work.k_s)


def dense_run(work: Work) -> Array:
    x, P = work.mean.copy(), work.cov.copy()
    return dense(work.settings, x, P, work.y, work.u, work.k_i, work.k_s)
