"""Textbook versions of what the C core computes: full matrices, plain loops, nothing shared.

They are slow and written down as the paper prints them, so that they can be checked by eye. The
tests hold the core to them; no other code uses them.
"""

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ambkit import Machine

Array = NDArray[np.float64]
Settings = dict[str, Any]  # Settings of a filter, by the names of ``amb_kalman_settings``, SI.


def settings_of(bearing: Machine, **changes: float) -> Settings:
    """Write down what a filter of the bearing is set to, without asking ambkit's own filters."""
    sign = {"-x": -1.0, "+x": 1.0, "none": 0.0}[bearing.rotor.gravity]
    bias = 0.0 if bearing.magnet.type == "two-sided" else magnet_force(bearing, 0.0, 0.0)
    weight = sign * bearing.rotor.mass * 9.81
    return {
        "T": bearing.sampling_time,
        "m": bearing.rotor.mass,
        "K_sen": bearing.sensor.gain,
        "T_sen": bearing.sensor.lag,
        "k_ui": bearing.amplifier.gain,
        "f_0": weight + bias,
        "iu_min": -bearing.amplifier.current_limit,
        "iu_max": bearing.amplifier.current_limit,
        "x_max": bearing.clearance,
        "var_u": bearing.amplifier.noise_variance,
        "var_d": bearing.sampling_time * (2 * weight) ** 2,
        "var_y": bearing.sensor.noise_variance,
        "rise": bearing.sensor.position_noise,
        "step": 0.0,
        "dwell": 0.0,
        "frozen_limit": 10,
        "gate": 8.0,
        "outlier_limit": 3,
        "as_printed": False,
    } | changes


def magnet_force(bearing: Machine, iu: float, x: float) -> float:
    """Whole force of the magnet [N], eq. 1, first equality; one-sided: its first term."""
    k, s0, i0 = bearing.magnet.magnet_constant, bearing.magnet.air_gap, bearing.magnet.bias_current
    upper = ((i0 + iu) / (s0 - x)) ** 2
    lower = ((i0 - iu) / (s0 + x)) ** 2
    return k * (upper - lower) if bearing.magnet.type == "two-sided" else k * upper


def least_squares_stiffness(
    force: Callable[[float, float], float], iu: float, x: float, d_iu: float, d_x: float
) -> tuple[float, float]:
    """k_i [N/A], k_s [N/m] from the nine points about (iu, x), eq. 27-31, no intercept."""
    points = [(iu + a * d_iu, x + b * d_x) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    A = np.array([(i / d_iu, d / d_x) for i, d in points])
    Y = np.array([force(i, d) - force(0.0, 0.0) for i, d in points])
    theta = np.linalg.lstsq(A, Y, rcond=None)[0]
    return float(theta[0] / d_iu), float(theta[1] / d_x)


def network_output(
    p: Array, centres: Array, widths: Array, weights: Array, *, normalised: bool
) -> float:
    """One output of the network at the scaled input p (2,); centres (rules, 2). Eq. 32, 33."""
    u = np.array(
        [
            math.exp(-np.sum((p - c) ** 2) / (2 * sigma**2))
            for c, sigma in zip(centres, widths, strict=True)
        ]
    )
    y = float(np.sum(weights * u))
    return y / float(np.sum(u)) if normalised else y


def held_force(s: Settings) -> tuple[Array, Array, Array]:
    """L (4, 4) and b (4,) of X+ = L X + b F, and N (4, 4), the covariance of a growth of 1."""
    return _held_force(s["T"], s["m"], s["T_sen"], s["K_sen"], s["as_printed"])


@cache
def _held_force(
    T: float, m: float, T_sen: float, K: float, as_printed: bool
) -> tuple[Array, Array, Array]:
    """From the exponential of the continuous model, in units in which the entries are alike.

    As printed, by hand.
    """
    if as_printed:
        keep = math.exp(-T / T_sen)
        L = np.array([[1, T, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [K * (1 - keep), 0, 0, keep]])
        return L, np.array([T**2 / (2 * m), T / m, 0, 0]), np.diag([0.0, 0, 1, 0])
    z = T / T_sen  # time in samples, v in m per sample, forces in kg m per sample squared
    F = np.array([[0, 1, 0, 0, 0], [0, 0, 0, 0, 1], [0] * 5, [K * z, 0, 0, -z, 0], [0] * 5])
    whole = expm(F)
    unit = np.array([1, 1 / T, m / T**2, 1])
    L = whole[:4, :4] * np.outer(unit, 1 / unit)
    b = whole[:4, 4] * unit / (m / T**2)
    driven = F[:4, :4].copy()
    driven[1, 2] = 1.0
    at, weights = np.polynomial.legendre.leggauss(60)
    left = expm(driven * ((1 + at) / 2)[:, None, None])[:, :, 2]  # of a growth, that time after it
    N = np.einsum("k,ki,kj->ij", weights / 2, left, left) * np.outer(unit, unit) / unit[2] ** 2
    return L, b, N


def system_matrices(s: Settings, k_i: float, k_s: float) -> tuple[Array, Array, Array]:
    """A (4, 4), B (4,) of eq. 20 and H (4,) of eq. 21; the magnet is asked at x + v T/2."""
    L, b, _ = held_force(s)
    h = np.array([k_s, 0.0 if s["as_printed"] else k_s * s["T"] / 2, 1.0, 0.0])
    return L + np.outer(b, h), b * k_i * s["k_ui"], np.array([0.0, 0, 0, 1])


class Kalman:
    """Eq. 9-13 with full matrices.

    Eq. 13, P = (I - K H) P, loses the symmetry of a full matrix, and on this plant diverges after
    some 2,000 steps: long runs take the form of Joseph, equal in exact arithmetic.
    """

    def __init__(self, s: Settings, mean: Array, std: Array, *, joseph: bool = True) -> None:
        self.s, self.joseph = s, joseph
        self.X, self.P = np.array(mean, dtype=float), np.diag(np.square(std))
        self.innovation = self.S = math.nan

    def predict(self, k_i: float, k_s: float, u: float) -> None:
        """Eq. 9, 10; the weight acts as f_d does. Q = B var B', and the growth of f_d."""
        s = self.s
        A, B, _ = system_matrices(s, k_i, k_s)
        _, b, N = held_force(s)
        held = min(max(s["k_ui"] * u, s["iu_min"]), s["iu_max"]) / s["k_ui"]
        Q = s["var_u"] * np.outer(B, B) + s["var_d"] * N
        self.X = A @ self.X + B * held + b * s["f_0"]
        self.P = A @ self.P @ A.T + Q

    def update(self, y: float) -> None:
        """Eq. 11-13."""
        _, _, H = system_matrices(self.s, 0.0, 0.0)
        R = self.s["var_y"]
        self.S = H @ self.P @ H + R
        K = self.P @ H / self.S
        self.innovation = y - H @ self.X
        self.X = self.X + K * self.innovation
        I_KH = np.eye(4) - np.outer(K, H)
        if self.joseph:
            self.P = I_KH @ self.P @ I_KH.T + R * np.outer(K, K)
        else:
            self.P = I_KH @ self.P

    def run(self, y: Array, u: Array, k_i: Array, k_s: Array) -> Mapping[str, Array]:
        """Filter a whole record; u[k], k_i[k], k_s[k] act from sample k to k + 1."""
        mean, cov, S = np.empty((len(y), 4)), np.empty((len(y), 4, 4)), np.empty(len(y))
        for k in range(len(y)):
            if k > 0:
                self.predict(k_i[k - 1], k_s[k - 1], u[k - 1])
            self.update(y[k])
            mean[k], cov[k], S[k] = self.X, self.P, self.S
        return {"mean": mean, "covariance": cov, "variance": S}


class Pid:
    """Output ``kp e + ki integral(e) - kd dx/dt`` with filtered derivative and back-calculation."""

    def __init__(self, T: float, kp: float, ki: float, kd: float, T_f: float, T_t: float,
                 limits: tuple[float, float], integral: float = 0.0) -> None:  # fmt: skip
        self.T, self.kp, self.ki, self.kd, self.T_f, self.T_t = T, kp, ki, kd, T_f, T_t
        self.low, self.high = limits
        self.integral, self.velocity, self.last_x = integral, 0.0, math.nan

    def step(self, r: float, x: float, velocity: float | None = None) -> float:
        """One sample; returns the control current demanded [A]."""
        if velocity is not None:
            self.velocity = velocity
        elif not math.isnan(self.last_x):
            # T_f v' + v = x' by backward differences
            slope = (x - self.last_x) / self.T
            self.velocity = (self.T_f * self.velocity + self.T * slope) / (self.T_f + self.T)
        self.last_x = x
        expected = self.kp * (r - x) + self.integral - self.kd * self.velocity
        given = min(max(expected, self.low), self.high)
        if self.T_t > 0:
            self.integral += self.T * (self.ki * (r - x) + (given - expected) / self.T_t)
        elif given == expected:
            self.integral += self.T * self.ki * (r - x)
        return given
