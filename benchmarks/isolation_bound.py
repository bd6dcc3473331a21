"""The bound of faults by name: how far the innovations of one fault are from those of any other.

A test on the same record, with the same knowledge, errs between two hypotheses at least as often as
the distance D of their innovations lets it: `D^2 = min sum of (s - s')^2 / S` over what the other
hypothesis leaves unknown, its sizes and its onset (Lehmann and Romano, Testing Statistical
Hypotheses, 3.1: a composite alternative is no farther than its nearest member). An onset that is
known, or signatures linear in the sizes, make D too large: a load that begins a sample later is
nearer to a gap than one that begins with it.

The innovations are those of an extended filter written here, which shares nothing with the C.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit import Machine
from ambkit.judge.isolation.isolation import ALIKE, FINE, LIMIT, MARGIN, NINE_IN_TEN
from ambkit.machine.magnets import own_time
from benchmarks.numba_filters import njit

Array = NDArray[np.float64]
Columns = NDArray[np.intp]

SIZES = (
    "magnet", "upper coil", "lower coil", "amplifier", "gap", "dead time", "sensor gain",
    "sensor offset", "sensor lag", "line noise", "line noise", "mass", "clock", "load",
)  # fmt: skip
"""Faults of the columns; noise at 50 Hz has a sine and a cosine from the onset on."""
(MAGNET, UPPER, LOWER, AMPLIFIER, GAP, DEAD, GAIN, OFFSET, LAG, SINE, COSINE, MASS, CLOCK,
 LOAD) = range(len(SIZES))  # fmt: skip
STEPS, PROBES = 12, 6  #: Of a fit, and of its onset in either direction.
LEAST = 16  #: Samples that a fault is judged by.
ALARM, APART = ((np.sqrt(at) + NINE_IN_TEN) ** 2 for at in (LIMIT, MARGIN))
"""Distances by which nine in ten pass the limit, and the margin to another fault."""


class Plant(NamedTuple):
    """A bearing; names as in the C."""

    T: float
    m: float
    g: float
    k: float
    s0: float
    i0: float
    two: float
    K_sen: float
    T_sen: float


class Filtered(NamedTuple):
    """An extended filter along a record of n samples, without a fault."""

    p: Plant
    i: Array  #: (n,) Current [A].
    X: Array  #: (n, 4) x, v, f_d, x_m after each sample.
    K: Array  #: (n, 4)
    e: Array  #: (n,) [m]
    S: Array  #: (n,) [m^2]
    read: Array  #: (n,) Predicted reading [m].
    scale: Array  #: (columns,) Typical sizes.


@njit
def force(p: Plant, i: float, s: float, by: Array) -> float:
    """Force of the magnet [N]."""
    s0 = p.s0 * (1 + by[GAP])
    i = i * (1 + by[AMPLIFIER])
    up = p.k * ((p.i0 + i) / max(s0 - s, 0.1 * s0)) ** 2 * (1 + by[UPPER])
    low = p.two * p.k * ((p.i0 - i) / max(s0 + s, 0.1 * s0)) ** 2 * (1 + by[LOWER])
    return (up - low) * (1 + by[MAGNET])


@njit
def step(p: Plant, X: Array, i: float, by: Array, out: Array) -> None:
    """One sample with a constant acceleration."""
    T = p.T * (1 + by[CLOCK])
    lag = max(p.T_sen + by[LAG], 0.02 * p.T)
    a = (force(p, i, X[0] + T / 2 * X[1], by) + X[2] + by[LOAD]) / (p.m * (1 + by[MASS])) + p.g
    r = np.exp(-T / lag)
    b = T * T / 2 - lag * T + lag * lag * (1 - r)
    out[3] = r * X[3] + p.K_sen * ((1 - r) * X[0] + (T - lag * (1 - r)) * X[1] + b * a)
    out[0] = X[0] + T * X[1] + T * T / 2 * a
    out[1] = X[1] + T * a
    out[2] = X[2]


@njit
def run(p: Plant, y: Array, i: Array, noise: Array, X: Array, P: Array, out: Array) -> None:
    """Run the filter; `noise`: variances of reading, current and load, of a sample each.

    `out` (n, 11): mean, gain, innovation, its variance, predicted reading.
    """
    none = np.zeros(len(SIZES))
    new, other, F = np.zeros(4), np.zeros(4), np.zeros((4, 4))
    Q, by_load = np.zeros((4, 4)), np.zeros(4)
    for n in range(len(y)):
        if n > 0:
            step(p, X, i[n - 1], none, new)
            for j in range(4):
                h = max(abs(X[j]), (1e-4 * p.s0, 1e-4 * p.s0 / p.T, p.m, 1e-4 * p.s0)[j]) * 1e-5
                moved = X.copy()
                moved[j] += h
                step(p, moved, i[n - 1], none, other)
                F[:, j] = (other - new) / h
            by_load[:] = F[:, 2]
            by_load[2] = 0.0
            h = 1e-5 * max(p.i0, 1e-3)
            more = force(p, i[n - 1] + h, X[0], none)
            k_i = (more - force(p, i[n - 1] - h, X[0], none)) / (2 * h)
            Q[:] = np.outer(by_load, by_load) * k_i * k_i * noise[1]
            Q[2, 2] = noise[2]
            P = F @ P @ F.T + Q
            X[:] = new
        S = P[3, 3] + noise[0]
        K = P[:, 3] / S
        e = y[n] - X[3]
        out[n, 9], out[n, 8], out[n, 10] = S, e, X[3]
        out[n, 4:8] = K
        X += K * e
        P = P - np.outer(K, K) * S
        P = (P + P.T) / 2
        out[n, :4] = X


@njit
def innovations(f: Filtered, by: Array, onset: int, out: Array) -> None:
    """Change of the innovations by faults from a sample on."""
    none = np.zeros(len(SIZES))
    d, X, own, new = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    whole = int(np.floor(by[DEAD]))
    late = by[DEAD] - whole
    for n in range(onset, len(f.e)):
        X[:] = f.X[n - 1]
        step(f.p, X, f.i[n - 1], none, own)
        X += d
        i = f.i[n - 1]
        if by[DEAD] != 0.0:
            at = min(max(n - 1 - whole, 0), n - 1)
            i = (1 - late) * f.i[at] + late * f.i[max(at - 1, 0)]
        step(f.p, X, i, by, new)
        d = new - own
        e = d[3] + by[GAIN] * (f.read[n] + d[3]) + by[OFFSET]
        turn = 2 * np.pi * 50 * f.p.T * n
        e += by[SINE] * np.sin(turn) + by[COSINE] * np.cos(turn)
        out[n] = e
        d = d - f.K[n] * e


@njit
def fit(f: Filtered, e: Array, columns: Columns, onset: int, start: Array) -> tuple[float, Array]:
    """Fit sizes by least squares (Levenberg, Marquardt); returns what is left, and the sizes."""
    count, n = len(columns), len(e)
    J, s, near = np.zeros((n, count)), np.zeros(n), np.zeros(n)
    w = 1 / np.sqrt(f.S)
    best, by = np.inf, start.copy()
    trial, damping = start.copy(), 1e-6
    for _ in range(STEPS):
        s[:] = 0.0
        innovations(f, trial, onset, s)
        left = np.sum(((e - s) * w) ** 2)
        if left < best:
            gain, best = best - left, left
            by[:] = trial
            if gain < 0.02 or gain < 1e-7 * best:
                break
            for j in range(count):
                moved = by.copy()
                h = 1e-4 * f.scale[columns[j]]
                moved[columns[j]] += h
                near[:] = 0.0
                innovations(f, moved, onset, near)
                J[:, j] = (near - s) / h * w * f.scale[columns[j]]
            M, g = J.T @ J, J.T @ ((e - s) * w)
            damping = damping / 10
        else:
            damping = max(100 * damping, 1e-4)
            if damping > 1e4:
                break
        A = M.copy()
        for j in range(count):
            A[j, j] += damping * M[j, j] + 1e-12
        delta = np.linalg.solve(A, g)
        trial[:] = by
        for j in range(count):
            trial[columns[j]] += min(max(delta[j], -3.0), 3.0) * f.scale[columns[j]]
    return best, by


@njit
def nearest(f: Filtered, e: Array, columns: Columns, onset: int, start: Array) -> float:
    """Return the least that faults of any sizes and onset leave of innovations."""
    best, by = fit(f, e, columns, onset, start)
    at = onset
    for way in (1, -1):
        probe = way
        for _ in range(PROBES):
            if not 1 <= at + probe <= len(e) - LEAST:
                break
            left, sizes = fit(f, e, columns, at + probe, by)
            if left < best - 0.02:
                best, by, at = left, sizes, at + probe
                probe *= 2
            elif probe != way:
                probe = way
            else:
                break
    return best


def filtered(machine: Machine, y: Array, u: Array, intensity: float, scale: Array) -> Filtered:
    """Run the filter along a record; `intensity`: of the load [N^2/s]."""
    magnet, sensor, amplifier = machine.magnet, machine.sensor, machine.amplifier
    m, T, s0 = machine.rotor.mass, machine.sampling_time, magnet.air_gap
    p = Plant(
        T, m, machine.weight / m, magnet.magnet_constant, s0, magnet.bias_current,
        float(magnet.type == "two-sided"), sensor.gain, machine.lag_of(sensor),
    )  # fmt: skip
    i = np.clip(amplifier.gain * u, machine.current_min, machine.current_max)
    noise = (sensor.noise_variance, amplifier.gain**2 * amplifier.noise_variance, intensity * T)
    std = np.array([0.1 * s0, 0.1 * s0 / own_time(machine), 0.1 * abs(machine.weight), 0.1 * s0])
    out = np.zeros((len(y), 11))
    start = np.array([y[0] / sensor.gain, 0.0, 0.0, y[0]])
    run(p, y, i, np.array(noise), start, np.diag(std**2), out)
    of = [np.ascontiguousarray(out[:, at]) for at in (slice(4), slice(4, 8), 8, 9, 10)]
    return Filtered(p, i, *of, np.abs(scale))


def can_be_named(f: Filtered, onset: int, true: dict[str, Array], group: dict[str, int]) -> bool:
    """Whether one or two faults of these sizes can be named in nine of ten, up to their groups."""
    by = np.zeros(len(SIZES))
    for name, size in true.items():
        by[_columns(name)] = size
    s = np.zeros(len(f.e))
    innovations(f, by, onset, s)
    most = float(np.sum(s**2 / f.S))

    def alike(j: str, k: str) -> bool:
        return j == k or 0 < group[j] == group[k]

    def left(*of: str) -> float:
        columns = np.concatenate([_columns(name) for name in of])
        starts = np.zeros((2, len(SIZES)))
        starts[1, columns] = by[columns]
        return min(nearest(f, s, columns, onset, start) for start in starts[: 1 + starts[1].any()])

    least = max(APART, 2 * FINE * most)
    if most < ALARM or (len(true) == 2 and alike(*true)):
        return False
    if len(true) == 1:
        return all(left(j) >= least for j in group if not alike(j, *true))
    a, b = true
    adds = {a: left(b), b: left(a)}

    def beyond(j: str) -> float:
        like = [3 * ALIKE * adds[k] for k in true if k != j and alike(j, k)]
        return max(ALARM, 3 * FINE * most, *like)

    others = [two for two in combinations(group, 2)
              if any(not alike(j, a) and not alike(j, b) for j in two)]  # fmt: skip
    others.sort(key=lambda two: -len(set(two) & set(true)))  # the nearest first
    return all(left(j) >= beyond(j) for j in group) and all(left(*two) >= least for two in others)


def _columns(name: str) -> Columns:
    return np.array([k for k, of in enumerate(SIZES) if of == name])
