"""What is odd in a filtered record: lost control signals, an expert asked beyond its box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.plausibility import longest_run
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Estimator
from ambkit.fuzzy.expert import Expert
from ambkit.machine.force_laws import isolated_axes, models_of

OUTSIDE = 0.01
"""An expert that is asked outside of its box in more than this part of the samples is noted."""


@dataclass(frozen=True)
class OutsideOperatingRange:
    """How often an expert was asked beyond the box that it was trained for."""

    share: float  #: Of the samples.
    #: Of each direction: the ends of the box [A] or [m], and the share beyond them.
    current: tuple[float, float, float]
    displacement: tuple[float, float, float]


def missing_control(record: Record) -> tuple[int, int]:
    """Return how many samples lack the control signal, and how many in a row at most."""
    # Nobody knows what acted on the rotor then: filters hold the last value, and are less sure for
    # a while than they say.
    controls = [record[n] for n in record if n.partition("_")[0] == "u"]
    lost = np.any(~np.isfinite(controls), axis=0)
    if not lost.any():
        return 0, 0
    return int(lost.sum()), longest_run(lost)[1]


def outside_operating_range(
    estimator: Estimator, estimate: Estimate, record: Record
) -> dict[str, OutsideOperatingRange]:
    """Return of each axis how often its expert was asked beyond its box, if worth a word."""
    machine, result = estimator.machine, {}
    parts = zip(machine.axes, models_of(estimator.magnet), isolated_axes(machine), strict=True)
    for axis, expert, b in parts:
        if not isinstance(expert, Expert):
            continue
        current = np.clip(
            b.amplifier.gain * record[signal("u", axis.name)], b.current_min, b.current_max
        )
        x = sum(form * estimate[q] for q, form in axis.line.form.items())
        one = _outside(expert, current, np.asarray(x))
        if one.share > OUTSIDE:
            result[axis.name] = one
    return result


def _outside(expert: Expert, current: Array, x: Array) -> OutsideOperatingRange:
    """Return how often an expert was asked beyond its box, at currents [A] and positions [m]."""
    box = expert.current_range, expert.displacement_range
    # The ends may be off by a rounding; what is missing is not outside.
    slack = [1e-9 * (high - low) for low, high in box]
    beyond = [
        (at < low - s) | (at > high + s)
        for at, (low, high), s in zip((current, x), box, slack, strict=True)
    ]
    share = float(np.mean(beyond[0] | beyond[1]))
    ends = [(low, high, float(np.mean(b))) for (low, high), b in zip(box, beyond, strict=True)]
    return OutsideOperatingRange(share, ends[0], ends[1])
