"""The closed loop of sim/ in numba: nonlinear plant by Runge-Kutta, PID, linear filter in the loop.

The same equations, substeps and outputs as `amb_loop_run`, without its checks and its status.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

import ambkit
from benchmarks.closed_loop import ClosedLoop
from benchmarks.numba_filters import Start, displacement, njit, predict, update
from benchmarks.work import Settings

Array = NDArray[np.float64]
Plant = tuple[float, float, float]  # x, v, x_m
# Signals (7, n) x, v, x_m, y, u, iu, force; means (n, 4); covariances (n, 10); stops touched.
Run = tuple[Array, Array, Array, int]


class Loop(NamedTuple):
    """Plant, amplifier and controller of a two-sided bearing; names as in sim/ and controller.h."""

    k: float
    s0: float
    i0: float
    m: float
    f_0: float
    K_sen: float
    T_sen: float
    travel: float
    substeps: int
    T: float
    k_ui: float
    iu_min: float
    iu_max: float
    kp: float
    ki: float
    kd: float
    T_t: float
    k_i: float
    k_s: float
    x_max: float


@njit
def clamp(a: float, low: float, high: float) -> float:
    return min(max(a, low), high)


@njit
def magnet_force(p: Loop, iu: float, x: float) -> float:
    """Eq. 1 with the difference of squares as a product, as in core/src/magnet.c [N]."""
    gaps = (p.s0 - x) * (p.s0 + x)
    return 4 * p.k * (p.i0 * p.s0 + iu * x) * (p.i0 * x + iu * p.s0) / (gaps * gaps)


@njit
def halted(p: Loop, x: float, v: float) -> tuple[float, float, bool]:
    """At a stop the rotor stays until the force pulls it off."""
    if x >= p.travel or x <= -p.travel:
        x = clamp(x, -p.travel, p.travel)
        return x, (min(v, 0.0) if x > 0 else max(v, 0.0)), True
    return x, v, False


@njit
def slope(p: Loop, x: float, v: float, x_m: float, iu: float, f: float) -> Plant:
    there = clamp(x, -p.travel, p.travel)
    return v, (magnet_force(p, iu, there) + f) / p.m, (p.K_sen * there - x_m) / p.T_sen


@njit
def textbook(p: Loop, x: float, v: float, x_m: float, h: float, iu: float, f: float) -> Plant:
    """One step of classical Runge-Kutta, as it stands in every book."""
    a0, a1, a2 = slope(p, x, v, x_m, iu, f)
    b0, b1, b2 = slope(p, x + h / 2 * a0, v + h / 2 * a1, x_m + h / 2 * a2, iu, f)
    c0, c1, c2 = slope(p, x + h / 2 * b0, v + h / 2 * b1, x_m + h / 2 * b2, iu, f)
    d0, d1, d2 = slope(p, x + h * c0, v + h * c1, x_m + h * c2, iu, f)
    return (
        x + h / 6 * (a0 + 2 * (b0 + c0) + d0),
        v + h / 6 * (a1 + 2 * (b1 + c1) + d1),
        x_m + h / 6 * (a2 + 2 * (b2 + c2) + d2),
    )


@njit
def arranged(p: Loop, x: float, v: float, x_m: float, h: float, iu: float, f: float) -> Plant:
    """The same step arranged as in sim/plant.c, which says why."""
    half, sixth, per_mass, per_lag = h / 2, h / 6, 1 / p.m, 1 / p.T_sen
    g = f * per_mass
    coasting, halfway = x + h * v + h * half * g, x + half * v
    x2 = clamp(halfway, -p.travel, p.travel)
    f1, f2 = magnet_force(p, iu, x), magnet_force(p, iu, x2)
    x3 = clamp(halfway + half * half * g + half * half * per_mass * f1, -p.travel, p.travel)
    x4 = clamp(coasting + h * half * per_mass * f2, -p.travel, p.travel)
    f3, f4 = magnet_force(p, iu, x3), magnet_force(p, iu, x4)
    d1 = (p.K_sen * x - x_m) * per_lag
    d2 = (p.K_sen * x2 - (x_m + half * d1)) * per_lag
    d3 = (p.K_sen * x3 - (x_m + half * d2)) * per_lag
    d4 = (p.K_sen * x4 - (x_m + h * d3)) * per_lag
    return (
        coasting + h * sixth * per_mass * (f1 + f2 + f3),
        v + h * g + sixth * per_mass * (f1 + 2 * (f2 + f3) + f4),
        x_m + sixth * (d1 + 2 * (d2 + d3) + d4),
    )


def closed_loop(step: Callable[..., Plant]) -> Callable[..., Run]:
    """Compile the loop around one way to step the plant."""

    @njit
    def simulate(
        p: Loop,
        h: Settings,
        start: Start,
        x: float,
        integral: float,
        r: Array,
        f_d: Array,
        noise_u: Array,
        noise_y: Array,
    ) -> Run:
        n, s, v, x_m, iu = r.size, start, 0.0, p.K_sen * x, 0.0
        signals = np.empty((7, n))  # x, v, x_m, y, u, iu, force
        mean, cov, stiffness = np.empty((n, 4)), np.empty((n, 10)), np.empty((2, n))
        innovation, variance, touched = np.empty(n), np.empty(n), 0
        for k in range(n):
            y = x_m + noise_y[k]
            if k > 0:
                held = clamp(p.k_ui * signals[4, k - 1], p.iu_min, p.iu_max)
                force = p.k_i * held + p.k_s * displacement(h, s) + h.f_0
                s = predict(h, force, p.k_i, p.k_s, s)
            s, innovation[k], variance[k] = update(h, y, s)
            for i in range(4):
                mean[k, i] = s[i]
            for i in range(10):
                cov[k, i] = s[4 + i]
            stiffness[0, k], stiffness[1, k] = p.k_i, p.k_s
            error = r[k] - s[0]
            demanded = p.kp * error + integral - p.kd * s[1]
            limited = clamp(demanded, p.iu_min, p.iu_max)
            integral += p.T * (p.ki * error + (limited - demanded) / p.T_t)
            u = limited / p.k_ui
            iu = clamp(p.k_ui * (u + noise_u[k]), p.iu_min, p.iu_max)
            signals[0, k], signals[1, k], signals[2, k], signals[3, k] = x, v, x_m, y
            signals[4, k], signals[5, k] = u, iu
            signals[6, k] = magnet_force(p, iu, x)
            hit = False
            for _ in range(p.substeps):
                x, v, x_m = step(p, x, v, x_m, p.T / p.substeps, iu, p.f_0 + f_d[k])
                x, v, at_stop = halted(p, x, v)
                hit = hit or at_stop
            touched += hit
        return signals, mean, cov, touched

    return simulate


TEXTBOOK, ARRANGED = closed_loop(textbook), closed_loop(arranged)


def parameters_of(loop: ClosedLoop) -> Loop:
    """Return what `closed_loop` is told of a loop."""
    b, pid = loop.bearing, loop.scenario.controller
    k = ambkit.ConstantStiffness.of(b)
    return Loop(
        k=b.magnet.magnet_constant,
        s0=b.magnet.air_gap,
        i0=b.magnet.bias_current,
        m=b.rotor.mass,
        f_0=b.weight,
        K_sen=b.sensor.gain,
        T_sen=b.sensor.lag,
        travel=b.clearance,
        substeps=loop.scenario.substeps,
        T=b.sampling_time,
        k_ui=b.amplifier.gain,
        iu_min=b.current_min,
        iu_max=b.current_max,
        kp=pid.kp,
        ki=pid.ki,
        kd=pid.kd,
        T_t=pid.anti_windup,
        k_i=k.k_i,
        k_s=k.k_s,
        x_max=b.clearance,
    )


def started(loop: ClosedLoop) -> Start:
    """Return mean and covariance with which the filter starts, reset."""
    loop.filter.reset()
    cov = loop.filter.core.covariance[np.triu_indices(4)]
    return (*loop.filter.mean.tolist(), *cov.tolist())


def run(loop: ClosedLoop, simulate: Callable[..., Run]) -> Run:
    """Run `loop` with TEXTBOOK or ARRANGED."""
    start = started(loop)
    outside = (loop.r, loop.f_d, loop.noise_u, loop.noise_y)
    return simulate(parameters_of(loop), loop.settings, start, 0.0, loop.integral, *outside)


@numba.njit(error_model="numpy", parallel=True)  # type: ignore[untyped-decorator]
def many(
    p: Loop,
    h: Settings,
    start: Start,
    integral: float,
    r: Array,
    f_d: Array,
    noise_u: Array,
    noise_y: Array,
    errors: Array,
) -> None:
    """Run the arranged loop with each row of noise (runs, n); RMS errors of x, v, f_d (runs, 3)."""
    for i in numba.prange(len(noise_u)):
        signals, mean, _, _ = ARRANGED(p, h, start, 0.0, integral, r, f_d, noise_u[i], noise_y[i])
        for j in range(3):
            total = 0.0
            for k in range(1, r.size):
                truth = f_d[k] if j == 2 else signals[j, k]
                total += (mean[k, j] - truth) ** 2
            errors[i, j] = np.sqrt(total / (r.size - 1))
