"""What the errors of a whole machine's estimators are measured by: a bound, and a finer filter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.kalman import ExtendedKalmanFilter, KalmanFilter
from ambkit.estimate.noise import FilterNoise
from ambkit.machine.bank import Bank
from ambkit.machine.magnets import ConstantStiffness, magnet_of

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.estimate.estimate import Estimate
    from ambkit.machine.machine import Machine

Array = NDArray[np.float64]

FINER = 10
"""Steps in a sample of the filter that is compared with."""


def bound(estimator: Estimator, record: Record, W: Array, start: int) -> Array:
    """Return the least standard deviations once settled (quantities,), root mean square."""
    # With the tangents of the magnets where the rotor hovers the machine is linear and its noise
    # normal: the Cramer-Rao bound is then the covariance of the linear filter that knows them,
    # which depends on no reading (Tichavsky 1998).
    # W (quantities, states)
    whole = estimator.whole
    assert whole is not None
    tangents = []
    for axis, alone in zip(whole.machine.axes, whole.alone, strict=True):
        iu, s = (float(np.mean(record[f"{of}_{axis.name}"])) for of in ("iu", "s"))
        k_i, k_s = magnet_of(alone).tangent(iu, s)
        tangents.append(ConstantStiffness(float(k_i), float(k_s)))
    linear = KalmanFilter(
        whole.machine, Bank(tangents), noise=FilterNoise(*estimator.variances),
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    linear.start_std = estimator.start_std
    believed = variances(linear.run(record, covariance=True), W, start)
    return np.asarray(np.sqrt(believed.mean(axis=0)))


def variances(estimate: Estimate, W: Array, start: int = 0) -> Array:
    """Return the variances that an estimate believes of quantities W (n - start, quantities)."""
    assert estimate.covariance is not None
    n = W.shape[1]
    rows, columns = np.triu_indices(n)
    weights = np.where(rows == columns, 1.0, 2.0) * W[:, rows] * W[:, columns]
    return np.asarray(estimate.covariance[start:] @ weights.T)


def finer(estimator: Estimator) -> Estimator:
    """Return the extended filter of a machine's law with `FINER` steps in a sample."""
    # The noise of a control, held over a sample, is that of as many shorter ones together. Loads,
    # unbalance and runout grow as they do. A delay of the loop is taken out of its model and put
    # into the control signals, see `run_finer`.
    machine = _machine(estimator)
    given = estimator.variances
    noise = FilterNoise(
        given.measurement, tuple(FINER * each for each in given.control), given.disturbance
    )
    other = ExtendedKalmanFilter(
        machine.replace(sampling_time=machine.sampling_time / FINER, delay=None), noise=noise,
        synchronous=estimator.engine.synchronous, frozen_limit=0, outlier_limit=0,
    )  # fmt: skip
    other.start_std = estimator.start_std
    return other


def run_finer(other: Estimator, record: Record, delay: float) -> Estimate:
    """Return what the finer filter says at the samples of a record."""
    whole = other.whole
    assert whole is not None
    machine, n = whole.machine, (len(record) - 1) * FINER + 1
    late = round(delay / machine.sampling_time)
    signals: dict[str, Array] = {}
    y, u = whole.signals(record)
    for k, reading in enumerate(machine.readings):
        shown = np.full(n, np.nan)
        shown[::FINER] = y[:, k]
        signals[signal("y", reading.name)] = shown
    for k, axis in enumerate(machine.axes):
        held = np.repeat(u[:, k], FINER)
        signals[signal("u", axis.name)] = np.concatenate([np.full(late, held[0]), held])[:n]
    T = record.t[1] - record.t[0]
    speed = np.interp(np.arange(n) / FINER, np.arange(len(record)), record["speed"])
    units = {name: "m" if name[0] == "y" else "V" for name in signals}
    t = T / FINER * np.arange(n)
    return other.run(Record(t, signals | {"speed": speed}, units | {"speed": "rad/s"}))


def _machine(estimator: Estimator) -> Machine:
    whole: Any = estimator.whole
    machine: Machine = whole.machine
    return machine
