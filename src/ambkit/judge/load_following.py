"""Tracking of a disturbance step by an estimate, from the filter's model and gain."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.arrays import Array
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.control.linear.steady_state_filter import settled_gain, tangents_known, tells
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.machine.axes import isolated_axes, load_capacity
from ambkit.machine.magnets import own_time

STEP = 0.5  #: Step of the disturbance force, over the load capacity.

REQUIRED, LONGEST = 1.0, 3.0
"""Required rise time of the estimate to 63 %, in time constants ``sqrt(m/k_s)`` of the rotor:
target where the data leaves the intensity open, and limit. A free rotor departs by a factor of e
in one time constant, by 20 in three. With the first the peak of abs(S) is about that of zone A,
with the second beyond zone C.
"""

FOLLOWING = (
    f"least with which a step of {STEP:.0%} of the load capacity is followed in {REQUIRED:g} "
    "sqrt(m/k_s)"
)
"""Origin of a process noise intensity that the records bound from above only."""


class Following(NamedTuple):
    """Response of an estimate to a step of 1 N."""

    axis: int
    time: float  # rise time to 63 % [s]
    own: float  # the rotor's time constant [s]
    wrong: float  # the maximum error of the position [m/N]
    noise: float  # rms of the estimated force due to sensor noise [N]


def following(estimator: Estimator) -> list[Following]:
    """Return the response of an estimate to a step of each disturbance, by model and gain."""
    # The error of the state obeys ``e+ = A (I - K H) e`` from the step on, independent of the
    # control.
    plant = estimator.machine
    point, isolated = operating_point(plant), isolated_axes(plant)
    model = estimator.linear_model(*tangents_known(estimator.magnet, "tangent", point))
    state_indices: Any = np.arange(len(estimator.states))
    if isinstance(getattr(estimator, "gain", None), np.ndarray):
        K: Array = estimator.gain[:, None]  # type: ignore[attr-defined]
    else:
        K, state_indices = settled_gain(estimator, point)
    A, H = model.A[np.ix_(state_indices, state_indices)], model.H[:, state_indices]
    roles = [estimator.states[k].role for k in state_indices]
    loads = [k for k, role in enumerate(roles) if role == "disturbance force"]
    owns = [own_time(b) for b in isolated]
    if len(loads) < len(isolated):  # a disturbance with zero intensity is never tracked
        return [Following(k, math.inf, own, math.inf, 0.0) for k, own in enumerate(owns)]
    rows = estimator.view.along_axes(estimator.states)[0][:, state_indices]
    M, T = A @ (np.eye(len(state_indices)) - K @ H), estimator.model.T
    n, p = max(8, math.ceil(4 * LONGEST * max(owns) / T)), len(loads)
    noisy = A @ K * np.sqrt(np.atleast_1d(model.R))
    e = np.hstack([np.eye(len(state_indices))[:, loads], noisy])
    left, wrong, square = np.empty((n, p)), np.zeros(p), np.zeros(p)
    for k in range(n):
        square += (e[loads, p:] ** 2).sum(axis=1)
        e = M @ e
        left[k] = np.abs(e[loads, range(p)])
        wrong = np.maximum(wrong, np.abs(rows @ e[:, :p]).max(axis=0))
    results = []
    for k, own in enumerate(owns):
        beyond = np.flatnonzero(~(left[:, k] <= math.exp(-1)))
        time = T * (beyond[-1] + 2) if beyond.size else T
        time = math.inf if beyond.size and beyond[-1] == n - 1 else float(time)
        results.append(Following(k, time, own, float(wrong[k]), float(np.sqrt(square[k]))))
    return results


def least_process_noise(make: Callable[[float], Estimator], result: float) -> float:
    """Return the process noise intensity [N^2/s] that tracks the stated disturbance."""
    first = make(result)
    plant = first.machine
    loads = zip(isolated_axes(plant), load_capacity(plant), strict=True)
    most = max((STEP * load) ** 2 / (REQUIRED * own_time(b)) for b, load in loads)

    def late(intensity: float) -> bool:
        return any(item.time > REQUIRED * item.own for item in following(make(intensity)))

    if result >= most or not late(result):
        return result
    low, high = math.log(max(result, 1e-12 * most)), math.log(most)
    while high - low > 0.05:
        middle = (low + high) / 2
        low, high = (middle, high) if late(math.exp(middle)) else (low, middle)
    return float(f"{math.exp(high):.3g}")


def settling(kalman: Estimator) -> Estimator:
    """Return an estimator with a steady-state gain: itself, its inner one, or the nearest kind."""
    kalman = kalman.nominal
    if tells(kalman):
        return kalman
    return ExtendedKalmanFilter(
        kalman.machine, kalman.magnet, noise=FilterNoise(*kalman.variances),
        synchronous=kalman.options.get("synchronous", ()),
    )  # fmt: skip


@lru_cache(maxsize=64)
def operating_point(of: Any) -> OperatingPoint:
    """Return the operating point at which a machine holds its rotor in the centre."""
    return OperatingPoint.of_machine(of)
