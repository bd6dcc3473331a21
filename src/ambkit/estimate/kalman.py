"""Kalman filters: linear, adaptive (paper, eq. 7-21 and Fig. 8), and extended.

The first two are the same C code with different magnet models.
"""

from __future__ import annotations

from typing import Any

from ambkit.estimate.estimator import Estimator
from ambkit.machine.axes import ideal_laws
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel


class KalmanFilter(Estimator):
    """Linear Kalman filter with the stiffnesses of the operating point (paper, eq. 7-21).

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the constant stiffnesses at the origin.
    **options
        Of :class:`ambkit.Estimator`: noise, gravity, precision, frozen_limit, gate,
        outlier_limit, as_printed.

    Raises
    ------
    ValueError
        `gravity` or `precision` is unknown, a limit is negative, or `gate` is not positive.
    """

    name = "linear Kalman filter"
    binding = "Kalman"
    steady = "through_origin"
    can_smooth = True


class AdaptiveKalmanFilter(KalmanFilter):
    """Kalman filter with k_i and k_s from a network at every sample (paper, Fig. 8).

    The stiffnesses are evaluated at the estimated displacement and the control current.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : Expert, StiffnessMap, ClosedLaw or ConstantStiffness
        Magnet model: the trained expert, its table, or the force law itself.
    **options
        As for :class:`KalmanFilter`.
    """

    name = "adaptive Kalman filter"

    def __init__(self, machine: Machine, magnet: MagnetModel, **options: Any) -> None:
        super().__init__(machine, magnet, **options)


class ExtendedKalmanFilter(Estimator):
    """Extended Kalman filter: the force in the mean, its tangents in the covariance.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the machine's force law.
    **options
        As for :class:`KalmanFilter`.

    References
    ----------
    Jazwinski, Stochastic Processes and Filtering Theory, 1970.
    """

    name = "extended Kalman filter"
    binding = "Extended"
    _default_magnet = staticmethod(ideal_laws)
    steady = "tangent"
    can_smooth = True


class UDKalmanFilter(ExtendedKalmanFilter):
    """Extended Kalman filter with the factor U D U' of its covariance, for single precision.

    In exact arithmetic it equals the extended filter; with constant stiffnesses, the linear one. In
    float32 its covariance remains positive definite, because no variance is a difference.

    Parameters
    ----------
    machine : Machine
        Machine to estimate.
    magnet : optional
        Magnet model; by default the machine's force law.
    **options
        As for :class:`KalmanFilter`.

    References
    ----------
    Thornton, Triangular Covariance Factorizations for Kalman Filtering, 1976; Bierman,
    Factorization Methods for Discrete Sequential Estimation, 1977.
    """

    name = "UD-factorised Kalman filter"
    binding = "UD"
