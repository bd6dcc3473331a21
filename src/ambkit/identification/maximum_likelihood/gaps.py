"""A filter along a record with gaps in the control signal.

The core holds the last control signal, with the certainty of a recorded one. The true one has moved
the rotor elsewhere: a tenth of an ampere for one sample changes the velocity by more than all
noise. A search would take that for control noise, or for an offset. Here the filter's covariance is
therefore increased by the possible motion.
"""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Bools, stretches
from ambkit.estimate.estimate import Status
from ambkit.estimate.estimator import Estimator
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, own_time


def filled(u: Array) -> Array:
    """Return a signal (n,) with missing values replaced by the last; at the start by the first."""
    known = np.isfinite(u)
    if known.all():
        return u
    if not known.any():
        return np.zeros_like(u)
    last = np.maximum.accumulate(np.where(known, np.arange(u.size), -1))
    return np.asarray(u[np.where(last < 0, np.argmax(known), last)])


def typical_change(u: Array, samples: int) -> float:
    """Return the rms change of a signal (n,) over some samples."""
    lag = int(np.clip(samples, 1, max(1, u.size // 2)))
    change = u[lag:] - u[:-lag]
    known = np.isfinite(change)
    return math.sqrt(float(np.mean(change[known] ** 2))) if known.any() else 0.0


def run_with_gaps(
    kalman: Estimator,
    machine: Machine,
    y: Array,
    u: Array,
    unknown: Bools,
    recorded: Array,
    h: float,
) -> dict[str, Any]:
    """Run a started filter, as its core's ``run``, over gaps of the control signal."""
    # Measurements within a gap are rejected. After a gap shorter than the plant's time constant the
    # filter continues, with variance for the unknown control; after a longer one it restarts, and
    # counts again after that time. y (n,) [m]; u (n,) [V]; unknown (n,)
    law = ConstantStiffness.of(machine)
    own = round(own_time(machine) / h)
    typical = cache(partial(typical_change, recorded))  # most gaps have the length of others
    per_sample = max(1, round(machine.sampling_time / h))
    y = y.copy()
    parts: list[dict[str, Any]] = []
    begin, skip = 0, 0

    def run_to(end: int) -> None:
        out = kalman.core.run(y[begin:end], u[begin:end])
        out["status"][:skip] |= np.uint16(Status.MISSING)
        parts.append(out)

    for first, after in stretches(unknown):
        y[first + 1 : after] = np.nan
        if after == u.size:
            break
        measured, y[after] = y[after], np.nan
        run_to(after + 1)  # to the state before the measurement that starts the next part
        parts[-1] = {name: values[:-1] for name, values in parts[-1].items()}
        y[after], steps = measured, after - first
        begin, skip = after, 0
        if steps <= own:
            # The typical change, or the actual one: a signal with jumps may be lost at one.
            change = max(typical(-(-steps // per_sample)), float(abs(u[after] - u[first])))
            kalman.core.widen(_pushed(kalman, law, change, steps * h))
        else:
            known = y[after:][np.isfinite(y[after:])]
            start = float(known[0]) if known.size else 0.0
            kalman.reset(kalman.equilibrium_state(start / machine.sensor.gain, start))
            skip = own
    run_to(u.size)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _pushed(kalman: Estimator, law: ConstantStiffness, change: float, duration: float) -> Array:
    """Return the effect of a control error of `change` [V] over a time [s] on the states (n,)."""
    machine = kalman.machine
    m = machine.rotor.mass
    rate = math.sqrt(law.k_s / m)
    acceleration = law.k_i * machine.amplifier.gain * change / m
    x = acceleration / rate**2 * (math.cosh(rate * duration) - 1)
    far = {
        "position": x,
        "velocity": acceleration / rate * math.sinh(rate * duration),
        "sensor": machine.sensor.gain * x,
    }
    return np.array([far.get(state.role, 0.0) for state in kalman.states])
