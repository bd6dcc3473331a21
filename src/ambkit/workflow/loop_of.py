"""One bearing and one controller, and the linear loop that each filter makes with them."""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.loop.bounds import least_peaks
from ambkit.judge.loop.lqg import LQG, Noise
from ambkit.judge.loop.margins import grid, highest
from ambkit.machine.bearing import Bearing
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.pieces import WorkPoint, compensator, estimator_at, plant, tells
from ambkit.simulation.linear.pieces import controller as controller_of
from ambkit.simulation.scenario import PID

ZONES = (("A", 3.0), ("B", 4.0), ("C", 5.0))
"""Zones of ISO 14839-3, and the peaks of abs(S) below which they are; D is beyond."""

RANGE = 2000.0
"""Up to there the standard looks at least [Hz], or up to three times the speed."""

ZONE_A = ZONES[0][1]
"""Peak of abs(S) at which zone A ends."""

COARSE = 500
"""Points of a grid that finds a peak, where nothing else is asked."""


class OutOfReachError(AmbkitError):
    """A filter cannot be held to a ceiling on the peak of the sensitivity."""


def end_of_range(T: float, speed: float | None = None) -> float:
    """Return up to where the standard looks at a loop [Hz].

    Parameters
    ----------
    T : float
        Sampling time [s]: it looks no farther than half the sampling rate.
    speed : float, optional
        Of the rotor [rad/s].
    """
    return min(max(RANGE, 3 * (speed or 0.0) / (2 * math.pi)), 0.5 / T)


def zone_of(peak: float) -> str:
    """Return the zone of a peak of abs(S) [1], A to D; ``"unstable"`` of an infinite one."""
    if math.isinf(peak):
        return "unstable"
    return next((name for name, limit in ZONES if peak < limit), "D")


class LoopOf:
    """The loop of a bearing and a controller at a work point, with one filter or another.

    Parameters
    ----------
    bearing : Bearing
        The plant.
    controller : PID, optional
        What is not said of it is tuned to the bearing.
    x, load : float, optional
        Displacement [m] and constant load [N] at which it is linearised.

    Raises
    ------
    AmbkitError
        Nothing holds the rotor there.
    """

    def __init__(
        self, bearing: Bearing, controller: PID | None = None, x: float = 0.0, load: float = 0.0
    ) -> None:
        self.bearing = bearing
        self.point = WorkPoint.hovering(bearing, x, load)
        self.controller = (controller or PID()).completed(bearing)
        self.plant = plant(bearing, self.point)
        self.top = end_of_range(bearing.sampling_time, bearing.speed)

    def least(self) -> tuple[float, float]:
        """Return the peaks of abs(S) and abs(T) that no controller can be below [1]."""
        return least_peaks(self.plant.select(["y"], ["u"]))

    def loop(self, estimator: Estimator | None = None) -> Loop:
        """Return the loop whose controller is fed by an estimator, or by the measurement.

        Raises
        ------
        AmbkitError
            The estimator does not settle to a gain.
        """
        feedback = "estimate" if estimator else "measurement"
        fed = self.controller.model_copy(update={"feedback": feedback})
        inner = None if estimator is None else estimator_at(estimator, self.point)
        K = compensator(controller_of(fed, self.bearing), inner, self.bearing.sensor.gain)
        return Loop(self.plant, K)

    def lqg(self) -> Loop:
        """Return the loop of the linear-quadratic-Gaussian controller that needs least control.

        It has the state and the load from a Kalman filter of this very plant, told of the noise of
        sensor and amplifier and the usual growth of the load.
        """
        b = self.bearing
        growth = KalmanFilter(b).variances.disturbance
        noise = Noise(b.sensor.noise_variance, b.amplifier.noise_variance, growth)
        return Loop(self.plant, LQG(self.plant, noise).compensator())

    def peak(self, estimator: Estimator | None = None) -> float:
        """Return the peak of abs(S) within the standard's range [1].

        Infinite where the loop is unstable or the estimator has no gain that it could be told of.

        Parameters
        ----------
        estimator : Estimator, optional
            What feeds the controller; None: the measurement.
        """
        try:
            loop = self.loop(estimator)
        except AmbkitError:
            return math.inf
        if not loop.is_stable:
            return math.inf
        f = grid(loop, COARSE)
        within = np.append(f[f < self.top], self.top)
        return highest(lambda at: loop.sensitivity(at)[:, 0, 0], within)[0]

    def check(self, estimator: Estimator, ceiling: float) -> None:
        """Refuse a ceiling on the peak of abs(S) that this filter cannot be held to.

        Raises
        ------
        OutOfReachError
            The filter does not settle to a gain, or no controller can be below the ceiling.
        """
        if not tells(estimator):
            raise OutOfReachError(
                f"{estimator.name}: it does not settle to a gain, so that no peak of the "
                "sensitivity can be asked of it"
            )
        least = self.least()[0]
        if not (math.isfinite(ceiling) and ceiling > least):
            raise OutOfReachError(
                f"max_sensitivity must be above {least:.4g}, below which no linear controller "
                f"brings the peak of |S| of {self.bearing.name}; is {ceiling:g}"
            )
