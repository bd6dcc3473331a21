"""Segmentation of a log: levitation, rest, contact, saturation.

A rotor is levitated while its acceleration is that of magnet and weight. This holds for small
motions as well, and does not depend on the noise of a log.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ambkit.base.arrays import Array, Bools, interpolated
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.noise import white_noise
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, magnet_of, own_time

UNEXPLAINED = 0.5
"""Unexplained acceleration, over that of the levitation force, above which a part is no levitation.
"""

AFTER = 40  #: Excluded time after other segments, in time constants of the plant.
SHORTEST = 40  #: Minimum duration of levitation, in time constants of the plant.

SMOOTHED = 0.25
"""Ratio to the noise of other logs or the machine, below which a position was smoothed."""

KINDS = ("flight", "fetched", "saturated", "landed", "rest")


@dataclass(frozen=True)
class Stretch:
    """A segment of a log."""

    #: One of `KINDS`. ``saturated``: sensor or current at its limit; ``landed``: at rest at a stop;
    #: ``rest``: at rest elsewhere, without levitation; ``fetched``: just after one of these, or not
    #: explained by magnet and weight.
    kind: str
    begin: float  #: Times of its first sample and of the one after its last [s].
    end: float


def cut(record: Record, model: LoopModel) -> list[Stretch]:
    """Divide a log into segments."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d
    from scipy.signal import savgol_filter

    machine, T = model.isolated, record.sampling_time
    y, u = interpolated(record["y"]), interpolated(record["u"])
    own = max(own_time(machine) / T, 2.0)
    width = 2 * round(own) + 1
    if y.size < 2 * width:
        return []
    gap = 0.98 * machine.magnet.air_gap
    x = np.clip(y / machine.sensor.gain, -gap, gap)
    current = np.clip(machine.amplifier.gain * u, machine.current_min, machine.current_max)
    force = np.asarray(magnet_of(machine).force(current, x)) + machine.weight
    force += interpolated(model.force_of_others(record))
    acceleration = savgol_filter(x, width, 3, deriv=2, delta=T)
    model_acceleration = savgol_filter(force / machine.rotor.mass, width, 2)
    k_i = ConstantStiffness.of(machine).k_i
    hold = abs(machine.weight) or 0.2 * k_i * machine.amplifier.current_limit
    astray = np.abs(acceleration - model_acceleration) > UNEXPLAINED * hold / machine.rotor.mass

    saturated = _at_its_end(y, machine.sensor.gain * machine.clearance)
    i = machine.amplifier.gain * u
    saturated |= (i >= 0.999 * machine.current_max) | (i <= 0.97 * machine.current_min)
    saturated = maximum_filter1d(saturated, width)
    local_range = maximum_filter1d(y, width) - minimum_filter1d(y, width)
    still = local_range < 10 * max(white_noise(record["y"]), 1e-12)
    ends = (y <= y.min() + 0.02 * np.ptp(y)) | (y >= y.max() - 0.02 * np.ptp(y))
    kind = np.zeros(y.size, int)
    kind[astray] = KINDS.index("fetched")
    kind[astray & still] = KINDS.index("rest")
    kind[astray & still & ends] = KINDS.index("landed")
    kind[saturated] = KINDS.index("saturated")
    other = np.flatnonzero(kind > 0)
    for last in other[np.diff(np.append(other, y.size)) > 1] if other.size else ():
        after = kind[last + 1 : last + 1 + round(AFTER * own)]
        after[after == 0] = KINDS.index("fetched")
    edges = np.r_[0, np.flatnonzero(np.diff(kind)) + 1, y.size]
    t = np.append(record.t, record.t[-1] + T)
    return [Stretch(KINDS[kind[a]], float(t[a]), float(t[b])) for a, b in pairwise(edges.tolist())]


def flights(record: Record, stretches: list[Stretch], machine: Machine) -> list[Record]:
    """Return the levitated segments of a log that are long enough for identification."""
    least = SHORTEST * own_time(machine)
    return [
        record.between(s.begin, s.end)
        for s in stretches
        if s.kind == "flight" and s.end - s.begin >= least
    ]


def _at_its_end(y: Array, travel: float) -> Bools:
    """Return where a sensor repeats its minimum or maximum, or a stop."""
    still = np.r_[False, np.diff(y) == 0]
    ends = (y == y.min()) | (y == y.max())
    return np.asarray((still & ends) | (np.abs(y) >= 0.99 * abs(travel)))
