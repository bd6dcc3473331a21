"""The self-test's samples: a simulated run with faults in it, and what Python's filter says."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.machine.bearing import GRAVITY

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing

STEPS = 200


class Vectors(NamedTuple):
    """Measurements and control signals as the rig has them, and the estimate of them."""

    y: NDArray[np.float64]  # (n,) or (n, readings)
    u: NDArray[np.float64]  # (n,) or (n, axes)
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

    if estimator.whole is not None:
        return _of_machine(estimator)
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


def _of_machine(estimator: Estimator) -> Vectors:
    """Let a machine hover under a load, spoil a few samples, and run the estimator."""
    from ambkit.simulation.flight import Disturbance, Flight
    from ambkit.simulation.machine import simulate_machine
    from ambkit.simulation.waveforms import Step

    machine, whole = estimator.bearing, estimator.whole
    assert whole is not None
    T = machine.sampling_time
    tenth = Step(amplitude=0.1 * machine.rotor.mass * GRAVITY, time=20 * T)
    force = Disturbance(axis=machine.axes[0].name, force=tenth)
    record = simulate_machine(
        machine, Flight(duration=(STEPS - 1) * T, disturbance=(force,))
    ).record
    y, u = whole.signals(record)
    far = 1e3 * whole.gains * whole.travel_seen
    y[100:103] = far, -far, far  # all of them
    y[110, 0] = far[0]  # one of them
    y[120:136] = y[120]
    y[140:156, -1] = y[140, -1]
    for k, sign in ((160, 1.0), (170, -1.0)):
        u[k] = [2 * sign * b.amplifier.current_limit / b.amplifier.gain for b in whole.alone]
    names = [f"y_{r.name}" for r in machine.readings] + [f"u_{a.name}" for a in machine.axes]
    number = np.dtype(estimator.precision).type
    y, u = (values.astype(number).astype(float) for values in (y, u))
    signals = dict(zip(names, np.column_stack([y, u]).T, strict=True))
    units = {name: "m" if name.startswith("y_") else "V" for name in names}
    return Vectors(y, u, estimator.run(Record(record.t, signals, units)))


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
