"""Tuning a filter by the likelihood of a record, where there is no truth to tune by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ambkit.bearing import GRAVITY
from ambkit.estimate import Estimate, Status
from ambkit.estimators import Estimator

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.record import Record

DECADES = (-8.0, 1.0)
"""Range of the search, in decades around ``(2 m g)^2`` a second."""


def default_disturbance(bearing: Bearing) -> float:
    """Growth of the disturbance force's variance that an untuned filter assumes [N^2/s]."""
    return float((2 * bearing.rotor.mass * GRAVITY) ** 2)


def log_likelihood(estimate: Estimate, first: int = 1) -> float:
    """Log likelihood of the measurements that a filter took in (Schweppe 1965), up to a constant.

    ``-1/2 sum(ln S + e^2/S)`` over the innovations e and the variances S that the filter expected;
    the first sample, which the filter starts from, does not count, nor what is before sample
    `first`. An outlier does: a filter that leaves out what it did not expect is not the more likely
    for it.
    """
    taken = estimate.used | (estimate.status & np.uint16(Status.OUTLIER) != 0)
    taken[: max(1, first)] = False
    return float(-0.5 * np.sum(np.log(estimate.innovation_variance[taken]) + estimate.nis[taken]))


def most_likely_disturbance(
    bearing: Bearing, record: Record, make: Callable[[float], Estimator]
) -> float:
    """Find the growth of the disturbance force under which a record is most likely.

    The paper leaves it to experiment. Too small, and the filter is sure of a wrong force; too
    large, and it takes the noise of the sensor for forces.

    Parameters
    ----------
    bearing : Bearing
        Its weight sets the range of the search, see `DECADES`.
    record : Record
        With ``y`` [m] and ``u`` [V].
    make : callable
        ``make(disturbance)`` builds the filter that assumes this growth [N^2/s].

    Returns
    -------
    float
        Growth of the variance of the disturbance force [N^2/s].
    """
    from scipy.optimize import minimize_scalar

    own = default_disturbance(bearing)

    def cost(decade: float) -> float:
        return -log_likelihood(make(own * 10**decade).run(record))

    # The likelihood can have a flat or second hill: look everywhere first, then go up the highest.
    grid = np.arange(DECADES[0], DECADES[1] + 0.5)
    best = grid[int(np.argmin([cost(decade) for decade in grid]))]
    found = minimize_scalar(cost, bounds=(best - 1, best + 1), method="bounded",
                            options={"xatol": 0.02})  # fmt: skip
    return float(own * 10**found.x)
