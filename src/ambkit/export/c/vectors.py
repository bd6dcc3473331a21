"""The self-test's samples: a simulated run with faults in it, and what Python's filter says."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.estimate import Estimate

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing

STEPS = 200


class Vectors(NamedTuple):
    """Measurements (n,) and control signals (n,) as the rig has them, and the estimate of them."""

    y: NDArray[np.float64]
    u: NDArray[np.float64]
    estimate: Estimate


def make(estimator: Estimator) -> Vectors:
    """Simulate a step of half the expert's reach, spoil a few samples, and run the estimator.

    Parameters
    ----------
    estimator : Estimator
        Of the precision that is exported.
    """
    from ambkit.simulation.run import simulate
    from ambkit.simulation.scenario import PID, Scenario
    from ambkit.simulation.waveforms import Step

    bearing = estimator.bearing
    T = bearing.sampling_time
    scenario = Scenario(
        duration=(STEPS - 1) * T,
        reference=Step(amplitude=bearing.rotor.travel_limit / 4, time=0.1 * STEPS * T),
        controller=PID.for_bearing(bearing),
    )
    record = simulate(bearing, scenario)
    y, u = _spoilt(bearing, record["y"], record["u"])
    of = estimator.inputs
    y, u = of.y.numbers(y), of.u.numbers(u)
    return Vectors(y, u, estimator.run_raw(y, u))


def _spoilt(
    bearing: Bearing, y: NDArray[np.float64], u: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Put in measurements far away, a frozen sensor, and demands beyond the limits."""
    y, u = y.copy(), u.copy()
    far = 1e3 * bearing.sensor.gain * bearing.rotor.travel_limit
    y[100:103] = far, -far, far
    y[120:136] = y[120]
    for k, limit in ((160, bearing.current_max), (170, bearing.current_min)):
        u[k] = (
            limit + np.copysign(bearing.amplifier.current_limit, limit)
        ) / bearing.amplifier.gain
    return y, u
