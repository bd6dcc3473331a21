"""What errors are measured by where the truth follows the model: a bound, and a finer filter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.kalman import ExtendedKalmanFilter, KalmanFilter
from ambkit.estimate.machine_model import several
from ambkit.estimate.noise_model import FilterNoise
from ambkit.machine.force_laws import bank_of
from ambkit.machine.magnets import ConstantStiffness, magnet_of

if TYPE_CHECKING:
    from ambkit.estimate.estimate import Estimate
    from ambkit.estimate.estimator import Estimator


FINER = 10  #: Steps in a sample of the filter that is compared with.


def settled_bound(estimator: Estimator, record: Record, W: Array, start: int) -> Array:
    """Return the least standard deviations once settled (quantities,), root mean square."""
    # With the tangents of the magnets where the rotor hovers the machine is linear and its noise
    # normal: the Cramer-Rao bound is then the covariance of the linear filter that knows them,
    # which depends on no reading (Tichavsky 1998).
    # W (quantities, states)
    view, tangents = estimator.view, []
    for axis, isolated in zip(view.machine.axes, view.isolated, strict=True):
        iu, s = (float(np.mean(record[signal(of, axis.name)])) for of in ("iu", "s"))
        k_i, k_s = magnet_of(isolated).tangent(iu, s)
        tangents.append(ConstantStiffness(float(k_i), float(k_s)))
    linear = KalmanFilter(
        view.machine, bank_of(tangents, view.machine), noise=FilterNoise(*estimator.variances),
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    linear.start_std = estimator.start_std
    believed = linear.run(record, covariance=True).covariance
    assert believed is not None
    rows, columns = np.triu_indices(W.shape[1])
    weights = np.where(rows == columns, 1.0, 2.0) * W[:, rows] * W[:, columns]
    return np.asarray(np.sqrt((believed[start:] @ weights.T).mean(axis=0)))


def finer_filter(estimator: Estimator) -> Estimator:
    """Return the extended filter of a machine's law with `FINER` steps in a sample."""
    # The noise of a control, held over a sample, is that of as many shorter ones together. Loads,
    # unbalance and runout grow as they do. A delay of the loop is taken out of its model and put
    # into the control signals, see `run_finer`.
    machine, variances = estimator.machine, estimator.variances
    control = estimator.view.plain([FINER * item for item in several(variances.control)])
    other = ExtendedKalmanFilter(
        machine.replace(sampling_time=machine.sampling_time / FINER, delay=None),
        noise=FilterNoise(variances.measurement, control, variances.disturbance),
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    other.start_std = estimator.start_std
    return other


def run_finer(other: Estimator, record: Record, delay: float) -> Estimate:
    """Return what the finer filter says at all its steps along a record."""
    machine, n = other.machine, (len(record) - 1) * FINER + 1
    late = round(delay / machine.sampling_time)
    signals: dict[str, Array] = {}
    for reading in machine.readings:
        measurement = np.full(n, np.nan)
        measurement[::FINER] = record[signal("y", reading.name)]
        signals[signal("y", reading.name)] = measurement
    for axis in machine.axes:
        held = np.repeat(record[signal("u", axis.name)], FINER)
        signals[signal("u", axis.name)] = np.concatenate([np.full(late, held[0]), held])[:n]
    T = record.t[1] - record.t[0]
    speed = np.interp(np.arange(n) / FINER, np.arange(len(record)), record["speed"])
    units = {name: "m" if name[0] == "y" else "V" for name in signals}
    t = T / FINER * np.arange(n)
    return other.run(Record(t, signals | {"speed": speed}, units | {"speed": "rad/s"}))
