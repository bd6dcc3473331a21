"""The family of estimators: one interface, one C core.

A kind of its own is a class here and a file in ``core/src``; `family` lists them by the names that
the commands know.
"""

from ambkit.estimators.adaptive_noise import AdaptiveNoise
from ambkit.estimators.base import Estimator, check_sampling
from ambkit.estimators.kalman import (
    AdaptiveKalmanFilter,
    ExtendedKalmanFilter,
    KalmanFilter,
    SquareRootKalmanFilter,
)
from ambkit.estimators.low_pass import LowPass
from ambkit.estimators.magnet_scale import FiveStateKalmanFilter, MultipleModelFilter
from ambkit.estimators.noise import FilterNoise, Variances
from ambkit.estimators.observer import ExtendedStateObserver, SteadyStateKalmanFilter
from ambkit.estimators.unscented import UnscentedKalmanFilter

__all__ = [
    "AdaptiveKalmanFilter",
    "AdaptiveNoise",
    "Estimator",
    "ExtendedKalmanFilter",
    "ExtendedStateObserver",
    "FilterNoise",
    "FiveStateKalmanFilter",
    "KalmanFilter",
    "LowPass",
    "MultipleModelFilter",
    "SquareRootKalmanFilter",
    "SteadyStateKalmanFilter",
    "UnscentedKalmanFilter",
    "Variances",
    "check_sampling",
]
