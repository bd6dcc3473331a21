"""The naive baseline: a Kalman filter that knows positions and no magnet.

A filter with a model has to beat two things that know nothing of the bearing: the raw sensor, and
this one. Its rotor keeps its velocity but for white acceleration (Bar-Shalom, Li and Kirubarajan,
Estimation with Applications to Tracking and Navigation, 2001, ch. 6.2). It knows no force, no
current, no lag of the sensor; it has one figure to tune.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import Given, in_si
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.force_laws import bank_of, isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel, own_time
from ambkit.machine.parts import GRAVITY
from ambkit.models.declaration import Part
from ambkit.models.parts.free import free_parts


def usual_acceleration(bearing: Machine) -> float:
    """Return the intensity of an acceleration of 1 g over the rotor's time constant [m^2/s^3]."""
    # Singer 1970; Bar-Shalom, Li and Kirubarajan 2001, eq. 8.2.2-11: 2 sigma^2 tau.
    return 2 * GRAVITY**2 * min(own_time(axis) for axis in isolated_axes(bearing))


def no_force_of(bearing: Machine) -> MagnetModel:
    """Return magnets without force."""
    machine = bearing.long
    return bank_of([ConstantStiffness(0.0, 0.0)] * len(machine.axes), machine)


class ConstantVelocity(KalmanFilter):
    """Kalman filter of position and velocity that knows no force: white acceleration alone.

    It is the naive filter that one with a model has to beat. It knows neither magnet, weight and
    currents nor the sensor's lag. Its disturbance force is zero, with the variance of the start.

    Parameters
    ----------
    bearing : Machine
        What is filtered.
    magnet : optional
        Not used.
    acceleration : float or str, optional
        Intensity of the white acceleration [m^2/s^3]. Default: ``2 g^2`` times the plant's own
        time ``sqrt(m/k_s)``.
    **options
        As for :class:`KalmanFilter`, without gravity and synchronous.

    Raises
    ------
    ValueError
        `acceleration` is not positive and finite, or there are synchronous states.

    References
    ----------
    Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001,
    ch. 6.2.
    """

    name = "constant-velocity Kalman filter"
    estimates_noise = False
    by_model = False
    predicts = "constant velocity, and white acceleration"

    def __init__(
        self,
        bearing: Machine,
        magnet: MagnetModel | None = None,
        *,
        acceleration: Given | None = None,
        **options: Any,
    ) -> None:
        acceleration_si = in_si("acceleration", acceleration, "m^2/s^3")
        self.acceleration = (
            usual_acceleration(bearing) if acceleration_si is None else acceleration_si
        )
        if not 0 < self.acceleration < math.inf:
            raise ValueError(
                f"acceleration must be greater than 0 m^2/s^3 and finite, got {acceleration_si!r}"
            )
        if options.get("synchronous"):
            raise ValueError(
                f"{self.name}: it has no force in its model, so synchronous cannot be estimated"
            )
        known = options | {"gravity": "disturbance"}
        super().__init__(bearing, no_force_of(bearing), **known)

    @property
    def _parts(self) -> Callable[..., list[Part]]:
        return partial(free_parts, acceleration=self.acceleration)


DECADES = (-14, 4)
"""Range of the search, in decades of ``q T^3 / R``."""

CONVERGED = 1e-13
"""Relative change of a gain in a sample below which it no longer changes."""


class ConstantVelocityFilter:
    """Kalman filter of position and velocity, driven by white acceleration."""

    # The first measurement is where it starts, the second gives the velocity (two-point start,
    # which assumes nothing). Gains follow from there on by the exact covariance, and once they have
    # settled the record goes through a linear filter of fixed coefficients: a million samples take
    # some hundredths of a second. Missing measurements (NaN) are predicted over.

    def __init__(self, T: float, q: float, R: float) -> None:
        for name, value, unit in (("T", T, "s"), ("q", q, "m^2/s^3"), ("R", R, "m^2")):
            if not 0 < value < math.inf:
                raise ValueError(f"{name} must be greater than 0 {unit} and finite, is {value!r}")
        self.T, self.q, self.R = T, q, R

    def run(self, y: ArrayLike) -> tuple[Array, Array]:
        """Filter a record."""
        # y (n,) [m]; x (n,) [m]; v (n,) [m/s]
        x, v, *_ = self._filtered(y)
        return x, v

    def predict(self, y: ArrayLike, ahead: int) -> Array:
        """Predict the measurement ``ahead`` samples after each sample of a record."""
        # y (n,) [m]; returns (n - ahead,)
        if ahead < 1:
            raise ValueError(f"ahead must be 1 sample or more, is {ahead}")
        x, v = self.run(y)
        return (x + ahead * self.T * v)[:-ahead]

    def innovations(self, y: ArrayLike) -> tuple[Array, Array]:
        """Return innovations [m] and the variances that it expects of them [m^2]."""
        # y (n,) [m]; e (n,); S (n,)
        _, _, e, S = self._filtered(y)
        return e, S

    def log_likelihood(self, y: ArrayLike) -> float:
        """Log likelihood of a record, up to a constant (Schweppe 1965)."""
        # y (n,) [m]
        e, S = self.innovations(y)
        known = np.isfinite(e)
        return float(-0.5 * np.sum(np.log(S[known]) + e[known] ** 2 / S[known]))

    def _filtered(self, y: ArrayLike) -> tuple[Array, Array, Array, Array]:
        """Return x, v, e, S. Inside, the unit of time is T and that of variance R."""
        y = np.asarray(y, dtype=float)
        if y.ndim != 1:
            raise ValueError(f"y must have one dimension, has {y.ndim}")
        x, v, e, S = (np.full(y.size, np.nan) for _ in range(4))
        measured = np.flatnonzero(np.isfinite(y))
        if measured.size == 0:
            return x, v, e, S
        first = int(measured[0])
        second = int(measured[1]) if measured.size > 1 else y.size
        x[first:second], v[first:second] = y[first], 0.0
        if second < y.size:
            gap = second - first
            x[second], v[second] = y[second], (y[second] - y[first]) / gap
            lam = self.q * self.T**3 / self.R
            P = (1.0, 1 / gap, 2 / gap**2 + lam * gap / 3)
            missing = np.append(np.flatnonzero(np.isnan(y)), y.size)
            _advance(y, lam, second, P, missing, x, v, e, S)
        return x, v / self.T, e, S * self.R


def _advance(
    y: Array,
    lam: float,
    at: int,
    P: tuple[float, float, float],
    missing: NDArray[np.intp],
    x: Array,
    v: Array,
    e: Array,
    S: Array,
) -> None:
    """Go on from sample ``at``, in the filter's own units, and fill x, v, e, S."""
    # Sample by sample while the gains change, which they do after the start and after each missing
    # measurement; between these in one go.
    a, b, c = P
    alpha = beta = math.inf  # gains of position and velocity
    pos, vel = float(x[at]), float(v[at])
    k = at + 1
    while k < y.size:
        a, b, c = a + 2 * b + c + lam / 3, b + c + lam / 2, c + lam
        pos += vel
        if math.isnan(y[k]):
            alpha = math.inf
        else:
            s, was, before = a + 1, alpha, beta
            alpha, beta = a / s, b / s
            a, b, c = alpha, b / s, c - beta * b
            error = float(y[k]) - pos
            pos, vel = pos + alpha * error, vel + beta * error
            e[k], S[k] = error, s
            if max(abs(was - alpha), abs(before - beta) * alpha / beta) <= CONVERGED * alpha:
                x[k], v[k] = pos, vel
                end = int(missing[np.searchsorted(missing, k)])
                _settled(y[k + 1 : end], alpha, beta, pos, vel, x[k + 1 : end], v[k + 1 : end])
                e[k + 1 : end] = y[k + 1 : end] - x[k : end - 1] - v[k : end - 1]
                S[k + 1 : end] = s
                pos, vel, k = float(x[end - 1]), float(v[end - 1]), end
                continue
        x[k], v[k] = pos, vel
        k += 1


def _settled(
    y: Array, alpha: float, beta: float, pos: float, vel: float, x: Array, v: Array
) -> None:
    """Filter with fixed gains from a state at the sample before, and fill x and v."""
    from scipy.signal import lfilter

    if y.size == 0:
        return
    below = np.array([1.0, alpha + beta - 2, 1 - alpha])
    step = np.array([[1 - alpha, 1 - alpha], [-beta, 1 - beta]])  # without a measurement of its own
    one = step @ [pos, vel]
    two = step @ one
    for out, above, place in ((x, [alpha, beta - alpha], 0), (v, [beta, -beta], 1)):
        rest = [one[place], two[place] + below[1] * one[place]]
        out[:], _ = lfilter(above, below, y, zi=rest)


def tune(
    y: ArrayLike | Sequence[ArrayLike],
    T: float,
    *,
    R: float | None = None,
    truth: ArrayLike | Sequence[ArrayLike] | None = None,
    first: int = 0,
) -> ConstantVelocityFilter:
    """Tune the filter: by what it does not expect, or by the truth where that is known."""
    # The search is that of :func:`ambkit.workflow.tuning.tune_disturbance`: every decade of the
    # range, then the best of them to a fiftieth of a decade.
    # y (n,) [m]
    from scipy.optimize import minimize_scalar

    records, truths = _several(y), None if truth is None else _several(truth)
    if truths is not None and [t.shape for t in truths] != [r.shape for r in records]:
        raise ValueError("truth must have the shape of y")
    if not any(np.isfinite(r).sum() > 2 and np.nanmax(r) > np.nanmin(r) for r in records):
        raise ValueError("y must hold three measurements or more that are not all the same")

    def made(decade: float) -> ConstantVelocityFilter:
        known = _variance(records, decade) if R is None else R
        return ConstantVelocityFilter(T, known * 10**decade / T**3, known)

    def cost(decade: float) -> float:
        if truths is None:
            kf = made(decade)
            return -sum(kf.log_likelihood(r) for r in records)
        kf = ConstantVelocityFilter(1.0, 10**decade, 1.0)  # positions ask for the ratio only
        errors = [(kf.run(r)[0] - t)[first:] for r, t in zip(records, truths, strict=True)]
        return float(np.nanmean(np.concatenate(errors) ** 2))

    grid = np.arange(DECADES[0], DECADES[1] + 0.5)
    costs = [cost(float(decade)) for decade in grid]
    best = float(grid[int(np.argmin(costs))])
    around = (max(DECADES[0], best - 1), min(DECADES[1], best + 1))
    result = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 0.02})
    return made(best if min(costs) <= result.fun else float(result.x))


def _several(y: ArrayLike | Sequence[ArrayLike]) -> list[Array]:
    """Return one record or several as a list of them."""
    if isinstance(y, np.ndarray) and y.ndim == 1:
        return [np.asarray(y, dtype=float)]
    rows = [np.asarray(row, dtype=float) for row in y]  # type: ignore[union-attr]
    return rows if rows and rows[0].ndim else [np.array(rows)]


def _variance(records: Sequence[Array], decade: float) -> float:
    """Most likely R for a given ``q T^3/R``: innovations are then as large as expected."""
    kf = ConstantVelocityFilter(1.0, 10**decade, 1.0)
    pairs = [kf.innovations(record) for record in records]
    return float(np.nanmean(np.concatenate([e**2 / S for e, S in pairs])))
