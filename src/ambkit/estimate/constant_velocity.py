"""Baseline: a Kalman filter of position and velocity without a magnet model.

A filter with a model must be better than the raw sensor and this filter. Its velocity is a random
walk (white acceleration; Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking
and Navigation, 2001, ch. 6.2). It models no force, current or sensor lag, and has one parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.axes import force_laws, isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel, own_time
from ambkit.machine.parts import GRAVITY
from ambkit.models.parts.free import free_parts


def usual_acceleration(machine: Machine) -> float:
    """Return the intensity of an acceleration of 1 g over the rotor's time constant [m^2/s^3]."""
    # Singer 1970; Bar-Shalom, Li and Kirubarajan 2001, eq. 8.2.2-11: 2 sigma^2 tau.
    return 2 * GRAVITY**2 * min(own_time(axis) for axis in isolated_axes(machine))


def no_force_of(machine: Machine) -> MagnetModel:
    """Return magnets without force."""
    return force_laws([ConstantStiffness(0.0, 0.0)] * len(machine.axes), machine)


class ConstantVelocity(KalmanFilter):
    """Kalman filter of position and velocity without forces: white acceleration only.

    It models neither magnet, weight and currents nor the sensor's lag. Its disturbance force is
    zero, with the initial variance.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Not used.
    acceleration : float or str, optional
        Intensity of the white acceleration [m^2/s^3]. Default: ``2 g^2`` times the plant's time
        constant ``sqrt(m/k_s)``.
    **options
        As for :class:`KalmanFilter`, except gravity and synchronous.

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
    has_noise_estimate = False
    by_model = estimates_force = False
    predicts = "constant velocity, and white acceleration"

    def __init__(
        self,
        machine: Machine,
        magnet: MagnetModel | None = None,
        *,
        acceleration: QuantityLike | None = None,
        **options: Any,
    ) -> None:
        acceleration_si = in_si("acceleration", acceleration, "m^2/s^3")
        self.acceleration = (
            usual_acceleration(machine) if acceleration_si is None else acceleration_si
        )
        if not 0 < self.acceleration < math.inf:
            raise ValueError(
                f"acceleration must be greater than 0 m^2/s^3 and finite, got {acceleration_si!r}"
            )
        if options.get("synchronous"):
            raise ValueError(
                f"{self.name}: it has no force in its model, so synchronous cannot be estimated"
            )
        self._parts = partial(free_parts, acceleration=self.acceleration)
        known = options | {"gravity": "disturbance"}
        super().__init__(machine, no_force_of(machine), **known)


DECADES = (-14, 4)  #: Range of the search, in decades of ``q T^3 / R``.

DIFFUSE = 3e3
"""Initial standard deviations, over that of the noise: the widest for which the core uses a
measurement completely.
"""


@cache
def _in_samples() -> ConstantVelocity:
    """Return the filter of any record, with its sampling time as the unit of time."""
    machine = Machine.preset("zittau_axial").replace(sampling_time=1.0)  # only T matters
    return ConstantVelocity(machine, acceleration=1.0, frozen_limit=0, outlier_limit=0)


class ConstantVelocityFilter:
    """Kalman filter of position and velocity with white acceleration."""

    # The core's `ConstantVelocity`, for a record instead of a machine: no outliers are rejected,
    # and the first two measurements define its start. Missing measurements (NaN) are predicted.

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
        """Return innovations [m] and their variances [m^2]."""
        # y (n,) [m]; e (n,); S (n,)
        _, _, e, S = self._filtered(y)
        return e, S

    def _filtered(self, y: ArrayLike) -> Array:
        """Return x, v, innovations and their variances (4, n)."""
        y = np.asarray(y, dtype=float)
        if y.ndim != 1:
            raise ValueError(f"y must have one dimension, has {y.ndim}")
        result = np.full((4, y.size), np.nan)
        first, second = (*np.flatnonzero(np.isfinite(y))[:2], y.size, y.size)[:2]
        if first == y.size:
            return result
        kf = self._core(y)
        std = DIFFUSE * math.sqrt(self.R) * np.array([1.0, 1 / (second - first), 1.0])
        kf.reset(np.array([y[first], 0.0, 0.0]), std)
        history = kf.run(y[first:], np.zeros(y.size - first))
        result[:, first:] = *history["mean"].T[:2], history["innovation"], history["variance"]
        result[1] /= self.T
        result[2:, : second + 1] = result[2:, ~np.isfinite(y)] = np.nan
        return result

    def _core(self, y: Array) -> Any:
        """Return the core's filter with this noise, and with caps beyond any such record."""
        n, q = float(y.size), self.q * self.T**3
        largest = float(np.max(np.abs(y[np.isfinite(y)])))
        cap = DIFFUSE * (n * largest + math.sqrt((self.R + q) * n**3))
        caps = {"cap": [cap] * 3, "travel": [cap], "x_max": [cap]}
        model = _in_samples()
        settings = model._settings | caps | {"var_d": [0.0, q], "var_y": [self.R]}
        magnet = model.magnet.in_core(model.engine.core)
        return model.engine.core.Kalman(magnet, model.engine.model_of_core, **settings)


def tune(
    y: ArrayLike | Sequence[ArrayLike],
    T: float,
    *,
    R: float | None = None,
    truth: ArrayLike | Sequence[ArrayLike] | None = None,
    first: int = 0,
) -> ConstantVelocityFilter:
    """Tune the filter: by maximum likelihood, or by the truth if that is known."""
    # The search is that of :func:`ambkit.workflow.tuning.tune_disturbance`: every decade of the
    # range, then the best of them to a fiftieth of a decade. y (n,) [m]
    from scipy.optimize import minimize_scalar

    records, truths = _several(y), None if truth is None else _several(truth)
    if truths is not None and [t.shape for t in truths] != [r.shape for r in records]:
        raise ValueError("truth must have the shape of y")
    if not any(np.isfinite(r).sum() > 2 and np.nanmax(r) > np.nanmin(r) for r in records):
        raise ValueError("y must hold three measurements or more that are not all the same")

    @cache
    def likeliest(decade: float) -> tuple[float, float]:
        """Return R, by default the likeliest, and twice the negative log likelihood."""
        kf = ConstantVelocityFilter(1.0, 10**decade, 1.0)
        e, S = np.hstack([kf.innovations(record) for record in records])
        variance = float(np.nanmean(e**2 / S)) if R is None else R
        return variance, float(np.nansum(np.log(variance * S) + e**2 / (variance * S)))

    @cache
    def cost(decade: float) -> float:
        if truths is None:
            return likeliest(decade)[1]
        kf = ConstantVelocityFilter(1.0, 10**decade, 1.0)  # positions depend on the ratio only
        errors = [(kf.run(r)[0] - t)[first:] for r, t in zip(records, truths, strict=True)]
        return float(np.nanmean(np.concatenate(errors) ** 2))

    best = float(min(np.arange(DECADES[0], DECADES[1] + 0.5), key=cost))
    around = (max(DECADES[0], best - 1), min(DECADES[1], best + 1))
    result = minimize_scalar(cost, bounds=around, method="bounded", options={"xatol": 0.02})
    at = min(best, float(result.x), key=cost)
    variance = likeliest(at)[0] if R is None else R
    return ConstantVelocityFilter(T, variance * 10**at / T**3, variance)


def _several(y: ArrayLike | Sequence[ArrayLike]) -> list[Array]:
    """Return one record or several as a list of them."""
    rows: Any = y if np.ndim(y[0]) else [y]  # type: ignore[index]
    return [np.asarray(row, dtype=float) for row in rows]
