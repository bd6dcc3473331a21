"""Sensitivity peak, crossings and margins of one axis, and Bode's integral, between grid points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Complex
from ambkit.base.root import root
from ambkit.control.linear.closed_loop import Loop

LOWEST = 1e-6  #: Lower end of a grid, over half the sampling rate.

UNDAMPED = 1e-9
"""Damping ratio of a pole below which L is infinite at its frequency by rounding; S is zero."""

GRID = 3000  #: Points of a grid, before refinement.


def grid(loop: Loop, points: int = GRID, near: int = 31) -> Array:
    """Return frequencies (k,) [Hz] up to half the sampling rate, dense enough for all features."""
    # Logarithmic, linear, and dense about each pole of the open and the closed loop.
    top = loop.nyquist
    poles = np.concatenate([loop.closed.poles(), loop.plant.poles(), loop.compensator.poles()])
    logs = np.log(poles[np.abs(poles) > 1e-6])
    logs = logs[np.abs(logs.real) >= UNDAMPED * np.abs(logs)]
    about = [np.abs(at.imag) + abs(at.real) * np.linspace(-3, 3, near) for at in logs]
    f = np.concatenate([
        np.geomspace(LOWEST * top, top, points), np.linspace(0, top, points),
        np.concatenate([np.zeros(0), *about]) * loop.nyquist / math.pi,
    ])  # fmt: skip
    return np.unique(f[(f >= LOWEST * top) & (f <= top)])


def highest(
    of: Callable[[Array], NDArray[Any]], f: Array, seen: NDArray[Any] | None = None
) -> tuple[float, float]:
    """Return the peak of a magnitude and its frequency [Hz], refined between the grid's points."""
    # f (k,) [Hz]; seen (k,)

    def gain(at: Array) -> Array:
        return np.asarray(np.abs(of(at.ravel())).reshape(at.shape))

    value, place = tops_of(gain, f[None], np.abs(of(f) if seen is None else seen)[None])
    return float(value[0]), float(place[0])


TOPS, PARTS, REFINED = 6, 5, 8
"""Number of highest peaks of a grid that are refined, and how often each is divided in parts."""


def tops_of(gain: Callable[[Array], Array], f: Array, seen: Array) -> tuple[Array, Array]:
    """Return the maxima of curves (n,), each refined between grid points, and their places."""
    # Many frequencies at once cost little more than one; the last step is a parabola's vertex.
    # f, seen (n, m)
    beside = np.pad(seen, ((0, 0), (1, 1)), constant_values=-np.inf)
    tops = np.where((seen >= beside[:, :-2]) & (seen >= beside[:, 2:]), seen, -np.inf)
    best = np.argsort(-tops, axis=1, kind="stable")[:, :TOPS]
    ends = np.stack([np.maximum(best - 1, 0), np.minimum(best + 1, f.shape[1] - 1)])
    row = np.arange(len(f))[:, None]
    (low, high), (at_low, at_high) = f[row, ends], seen[row, ends]
    shares = np.linspace(0, 1, PARTS + 1)
    for _ in range(REFINED):
        places = low[..., None] + (high - low)[..., None] * shares
        inner = gain(places[..., 1:-1].reshape(len(f), -1)).reshape(*low.shape, -1)
        gains = np.concatenate([at_low[..., None], inner, at_high[..., None]], axis=-1)
        top = inner.argmax(axis=-1)[..., None] + np.arange(3)
        low, middle, high = np.moveaxis(np.take_along_axis(places, top, -1), -1, 0)
        at_low, at_middle, at_high = np.moveaxis(np.take_along_axis(gains, top, -1), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        off = (at_high - at_low) / (2 * at_middle - at_low - at_high)
    vertex = middle + 0.25 * (high - low) * np.clip(np.where(np.isfinite(off), off, 0.0), -2, 2)
    f, seen = np.hstack([f, vertex, middle]), np.hstack([seen, gain(vertex), at_middle])
    at = np.argmax(seen, axis=1)[:, None]
    return np.take_along_axis(seen, at, 1)[:, 0], np.take_along_axis(f, at, 1)[:, 0]


AXIS_GRID = 160
"""Number of frequencies for each axis of a loop, besides those of its poles."""


def axis_peaks(loop: Loop, top: float) -> Array:
    """Return the peaks of abs(S) of a stable loop's axes (a,) up to a frequency [Hz]."""
    closed, m = loop.closed, loop.measurements
    to: Any = np.eye(m) if loop.added is None else loop.added
    seen: Any = np.eye(m) if loop.measured is None else loop.measured
    B, C = closed.B[:, :m] @ to, seen @ closed.C[:m]
    through = np.diag(seen @ (np.eye(m) + closed.D[:m, :m]) @ to)
    # Opened at one axis: its position is fed back with the opposite sign.
    opened = np.linalg.eigvals(closed.A - B.T[:, :, None] * C[:, None, :] / through[:, None, None])
    poles = np.broadcast_to(closed.poles().astype(complex), opened.shape)
    return np.asarray(through * peaks_by_poles(opened.astype(complex), poles, loop.T, top))


def peaks_by_poles(opened: Complex, closed: Complex, T: float, top: float) -> Array:
    """Return the highest abs(S) of loops up to a frequency (n,) [1]."""
    # The sensitivity of an axis with all other loops closed is a ratio of two polynomials with
    # known roots: ``S(z) = d det(zI - A_open)/det(zI - A_closed)``, where A_open has the loop of
    # that axis open. This needs no linear system at any frequency. opened (n, a); closed (n, b)

    def gain(f: Array) -> Array:
        """Return log abs(S) of each loop at frequencies of its own (n, k)."""
        z = np.exp(2j * np.pi * T * f)
        with np.errstate(divide="ignore"):  # S is zero at an open-loop pole on the unit circle
            return np.asarray(np.log(np.abs(_product(z, opened) / _product(z, closed))), float)

    lowest = AXIS_LOWEST * top
    own = np.abs(np.angle(closed)) / (2 * np.pi * T)
    common = np.broadcast_to(np.geomspace(lowest, top, AXIS_GRID), (len(closed), AXIS_GRID))
    f = np.sort(np.hstack([common, np.clip(own, lowest, top)]), axis=1)
    return np.asarray(np.exp(tops_of(gain, f, gain(f))[0]))


AXIS_LOWEST = 1e-4  #: Start of these, over the end of the range.


def _product(z: Complex, poles: Complex) -> Complex:
    """Return the product of z (n, k) minus each of the poles (n, m) of its row."""
    result = z - poles[:, :1]
    for k in range(1, poles.shape[1]):
        result *= z - poles[:, k : k + 1]
    return result


def zeros(of: Callable[[Array], Array], f: Array) -> Iterator[float]:
    """Yield the sign changes of a real function of the frequency [Hz]."""
    # f (k,) [Hz]
    seen = of(f)
    for k in np.flatnonzero(seen[:-1] * seen[1:] < 0):
        low, high = float(f[k]), float(f[k + 1])
        yield root(lambda x: float(of(np.array([x]))[0]), low, high, 1e-13 * high)


@dataclass(frozen=True)
class Margins:
    """Stability margins of one axis's loop, with all other loops closed."""

    # Seiler, Packard, Gahinet, An introduction to disk margins, 2020.

    #: Maximum of abs(S) up to half the sampling rate [1], and its frequency [Hz]; its inverse is
    #: the least distance of the Nyquist curve from -1.
    peak: float
    peak_frequency: float
    complementary_peak: float  #: Maximum of abs(T) [1].
    gain_up: float  #: Factors by which the loop gain can grow and shrink [1].
    gain_down: float
    phase: float  #: Phase margin, in both directions [rad]; infinite if abs(L) is nowhere 1.
    delay: float  #: Additional dead time up to instability [s].
    #: Largest symmetric disk margin: simultaneous change of gain and phase [1].
    disk: float
    crossover: float  #: Highest frequency with abs(L) of 1 [Hz]; NaN if there is none.
    #: Frequency up to which disturbances are attenuated by 3 dB: abs(S) first reaches 1/sqrt(2)
    #: from below [Hz]; NaN if it does not.
    bandwidth: float

    @property
    def disk_gain(self) -> tuple[float, float]:
        """Gain factors permitted by the disk."""
        if self.disk >= 2:
            return 0.0, math.inf
        return (2 - self.disk) / (2 + self.disk), (2 + self.disk) / (2 - self.disk)

    @property
    def disk_phase(self) -> float:
        """Phase change permitted by the disk, in both directions [rad]."""
        return 2 * math.atan(self.disk / 2)


def margins(
    loop: Loop, axis: int = 0, f: Array | None = None, seen: Complex | None = None
) -> Margins:
    """Return the margins of one axis's loop with all other loops closed."""
    # f (k,); seen (k,)
    f = grid(loop) if f is None else f
    there = loop.of_axis(axis, f) if seen is None else seen

    single = loop.measurements == 1 and loop.measured is None
    open_there = loop.open(f)[:, 0, 0] if single else 1 / there - 1

    def S(at: Array) -> Complex:
        return there if at is f else loop.of_axis(axis, at)

    def L(at: Array) -> Complex:
        if at is f:
            return np.asarray(open_there)
        return loop.open(at)[:, 0, 0] if single else np.asarray(1 / S(at) - 1)

    ends = [complex(value) for value in L(f[[0, -1]])]
    real = [at.real for at in ends if abs(at.imag) < 1e-3 * abs(at.real)]
    real += [float(L(np.array([at]))[0].real) for at in zeros(lambda x: L(x).imag, f)]
    factors = [-1 / value for value in real if value < 0]
    crossings = list(zeros(lambda x: np.abs(L(x)) - 1, f))
    turns = [float(np.angle(-L(np.array([at]))[0])) for at in crossings]
    peak, where = highest(S, f)
    rising = [
        at for at in zeros(lambda x: np.abs(S(x)) - math.sqrt(0.5), f)
        if abs(S(np.array([1.0001 * at]))[0]) > math.sqrt(0.5)
    ]  # fmt: skip
    return Margins(
        peak=peak,
        peak_frequency=where,
        complementary_peak=highest(lambda x: 1 - S(x), f)[0],
        gain_up=min((at for at in factors if at > 1), default=math.inf),
        gain_down=max((at for at in factors if at < 1), default=0.0),
        phase=min((abs(at) for at in turns), default=math.inf),
        delay=min(
            (
                at % (2 * math.pi) / (2 * math.pi * x)
                for at, x in zip(turns, crossings, strict=True)
            ),
            default=math.inf,
        ),
        disk=1 / highest(lambda x: S(x) - 0.5, f)[0],
        crossover=max(crossings, default=math.nan),
        bandwidth=min(rising, default=math.nan),
    )  # fmt: skip


class UnstablePole(NamedTuple):
    """An unstable pole of a closed loop; of a pair the one with positive imaginary part."""

    frequency: float  #: [Hz]; 0 for a real pole.
    growth: float  #: Growth rate [1/s]; 0 on the stability limit.

    @property
    def doubling(self) -> float:
        """Time to double [s]."""
        return math.log(2) / self.growth if self.growth > 0 else math.inf


def rates(loop: Loop) -> Complex:
    """Return the poles of a closed, sampled loop as rates (n,) [1/s], but for those at z = 0."""
    z = loop.closed.poles().astype(complex)
    return np.asarray(np.log(z[np.abs(z) > 1e-9]) / loop.T)


def unstable_poles(loop: Loop) -> list[UnstablePole]:
    """Return the unstable poles of a closed, sampled loop, the fastest first."""
    grow = [rate for rate in rates(loop).tolist() if rate.real >= 0 and rate.imag >= 0]
    results = [UnstablePole(item.imag / (2 * math.pi), item.real) for item in grow]
    return sorted(results, key=lambda entry: -entry.growth)


@dataclass(frozen=True)
class BodeIntegral:
    """Bode's integral: attenuation at one frequency costs amplification at another."""

    # Freudenberg, Looze, Frequency domain properties of scalar and multivariable feedback systems,
    # 1988; Sung, Hara, Properties of sensitivity and complementary sensitivity functions in
    # single-input single-output digital control systems, 1988.

    integral: (
        float  #: The integral of ln abs(det S) over a period of the angle of z, over 2 pi [1].
    )
    #: Sum over the unstable poles p of the open loop of ln abs(p): equal to the integral if the
    #: closed loop is stable.
    poles: float

    @property
    def holds(self) -> bool:
        """Whether both agree to six digits, of the larger of poles and 0.01."""
        return abs(self.integral - self.poles) <= 1e-6 * max(self.poles, 0.01)


def bode_integral(loop: Loop) -> BodeIntegral:
    """Return both sides of Bode's integral."""
    # By Gauss's rule in the logarithm of the angle, between the angles of all poles and refined
    # towards each: an integrator makes S zero at 0, an undamped pole elsewhere.
    poles = np.concatenate([loop.closed.poles(), loop.plant.poles(), loop.compensator.poles()])
    angles = np.log(poles[np.abs(poles) > 1e-6]).imag
    sharp = angles[(angles > 1e5 * LEAST_ANGLE) & (angles < math.pi)]
    ends = np.unique(np.log([*sharp, LEAST_ANGLE, math.pi]))
    finer = 0.5 * GRADED ** np.arange(LEVELS)
    shares = np.concatenate([[0.0], finer[::-1], 1 - finer[1:], [1.0]])
    cuts = np.unique([a + (b - a) * shares for a, b in pairwise(ends)])
    nodes, weights = np.polynomial.legendre.leggauss(16)
    half = np.diff(cuts)[:, None] / 2
    angle = np.exp(cuts[:-1, None] + half * (1 + nodes)).ravel()
    det = np.linalg.det(np.eye(loop.measurements) + loop.open(angle / (2 * math.pi * loop.T)))
    over_logarithm = (-np.log(np.abs(det)) * angle / math.pi).reshape(len(half), -1)
    lost = float(np.log(np.abs(loop.unstable_poles())).sum())
    return BodeIntegral(float((over_logarithm * weights * half).sum()), lost)


LEAST_ANGLE = 1e-12  #: Start of the integral.
#: Ratio by which panels shrink towards a pole's frequency, and their number.
GRADED, LEVELS = 0.3, 16
