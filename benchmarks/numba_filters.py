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
def displacement(h: Settings, s: Start) -> float:
    """At which the magnet is asked: the mean over the sample."""
    return s[0] + 0.5 * h.T * s[1]


@njit
def predict(h: Settings, force: float, k_i: float, k_s: float, s: Start) -> Start:
    """Eq. 9, 10; `s` is the mean (4) and the upper triangle of the covariance (10)."""
    x0, x1, x2, x3, p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = s
    T, half, tm, a, b, c, d = h.T, 0.5 * h.T, h.T / h.m, h.a, h.b, h.c, h.d
    t2 = half * tm
    f, g = force + x2, k_i * h.k_ui
    e = g * g * h.var_u
    w0, w1 = k_s * (p00 + half * p01) + p02, k_s * (p01 + half * p11) + p12
    w2, w3 = k_s * (p02 + half * p12) + p22, k_s * (p03 + half * p13) + p23
    m00, m01 = p00 + T * p01 + t2 * w0, p01 + T * p11 + t2 * w1
    m02, m03 = p02 + T * p12 + t2 * w2, p03 + T * p13 + t2 * w3
    m10, m11, m12, m13 = p01 + tm * w0, p11 + tm * w1, p12 + tm * w2, p13 + tm * w3
    m30 = (b * p00 + c * p01) + a * p03 + d * w0
    m31 = (b * p01 + c * p11) + a * p13 + d * w1
    m32 = (b * p02 + c * p12) + a * p23 + d * w2
    m33 = (b * p03 + c * p13) + a * p33 + d * w3
    z0 = k_s * (m00 + half * m01) + (m02 + t2 * e)
    z1 = k_s * (m10 + half * m11) + (m12 + tm * e)
    z3 = k_s * (m30 + half * m31) + (m32 + d * e)
    return (
        x0 + T * x1 + t2 * f,
        x1 + tm * f,
        x2,
        b * x0 + c * x1 + a * x3 + d * f,
        (m00 + T * m01 + h.q00) + t2 * z0,
        (m01 + h.q01) + tm * z0,
        m02 + h.q02,
        (b * m00 + c * m01) + (a * m03 + h.q03) + d * z0,
        (m11 + h.q11) + tm * z1,
        m12 + h.q12,
        (b * m10 + c * m11) + (a * m13 + h.q13) + d * z1,
        p22 + h.q22,
        m32 + h.q23,
        (b * m30 + c * m31) + (a * m33 + h.q33) + d * z3,
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
            force = k_i[k - 1] * h.k_ui * u[k - 1] + k_s[k - 1] * displacement(h, s) + h.f_0
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
                held = k_i[k - 1] * h.k_ui * u[run, k - 1]
                force = held + k_s[k - 1] * displacement(h, s) + h.f_0
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
        s = predict(h, k_i * h.k_ui * u + k_s * displacement(h, s) + h.f_0, k_i, k_s, s)
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
            at = displacement(h, s)
            k_i, k_s = ask(rules, iu, at)
            s = predict(h, k_i * iu + k_s * at + h.f_0, k_i, k_s, s)
            stiffness[k, 0], stiffness[k, 1] = k_i, k_s
        s, innovation[k], variance[k] = update(h, y[k], s)
        mean[k, 0], mean[k, 1], mean[k, 2], mean[k, 3] = s[0], s[1], s[2], s[3]
    return mean


@njit
def dense(
    h: Settings, x: Array, P: Array, y: Array, u: Array, k_i: Array, k_s: Array
) -> Array:  # what one writes without thinking of zeros: 4 x 4 loops, work arrays made once
    tm, t2, half = h.T / h.m, 0.5 * h.T * h.T / h.m, 0.5 * h.T
    A, AP, K = np.zeros((4, 4)), np.empty((4, 4)), np.empty(4)
    b, Q = np.array([t2, tm, 0.0, h.d]), np.empty((4, 4))
    Q[0, 0], Q[0, 1], Q[0, 2], Q[0, 3] = h.q00, h.q01, h.q02, h.q03
    Q[1, 1], Q[1, 2], Q[1, 3] = h.q11, h.q12, h.q13
    Q[2, 2], Q[2, 3], Q[3, 3] = h.q22, h.q23, h.q33
    A[0, 2], A[1, 2], A[2, 2], A[3, 2], A[3, 3] = t2, tm, 1, h.d, h.a
    new = np.empty(4)
    mean, innovation, variance = np.empty((y.size, 4)), np.empty(y.size), np.empty(y.size)
    for k in range(y.size):
        if k > 0:
            s = k_s[k - 1]
            A[0, 0], A[1, 0], A[3, 0] = 1 + t2 * s, tm * s, h.b + h.d * s
            A[0, 1], A[1, 1], A[3, 1] = h.T + t2 * s * half, 1 + tm * s * half, h.c + h.d * s * half
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
                    entry = b[i] * b[j] * g * g * h.var_u + Q[i, j]
                    for m in range(4):
                        entry += AP[i, m] * A[j, m]
                    P[i, j] = P[j, i] = entry
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
