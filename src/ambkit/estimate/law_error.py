"""What the force law of a filter leaves out of the machine's own."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.machine.force_laws import isolated_axes, models_of, weights_of
from ambkit.machine.loading import levitation_current
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, core_module, magnet_of, own_time

DISPLACED = 0.5  #: Operating points lie so far to either side of the middle [clearances].
WALKED = 12.0  #: And at the force that its random walk reaches in so many rotor time constants.


def law_variances(machine: Machine, magnet: Any, intensity: Sequence[float]) -> list[float]:
    """Return the mean square of a law's error at the operating points of each axis [N^2]."""
    # A filter with another law takes the error for a disturbance force, which it follows: position
    # and velocity stay right, and the stated error of the force alone lacks it. It is considered:
    # in stated errors and not in the gain (Schmidt 1966). intensity: [N^2/s].
    axes = isolated_axes(machine), models_of(magnet), weights_of(machine), intensity
    return [_of_axis(*item) for item in zip(*axes, strict=True)]


def _of_axis(axis: Machine, magnet: MagnetModel, weight: float, intensity: float) -> float:
    law = magnet_of(axis)
    true, known = (item.in_core(core_module()) for item in (law, magnet))

    def error(iu: float, x: float) -> float:
        point = np.array([iu]), np.array([x])
        return float(known.force(*point)[0] - true.force(*point)[0])

    force, x = math.sqrt(WALKED * own_time(axis) * intensity), DISPLACED * axis.clearance
    known_force = weight + law.bias_force
    points = [
        (levitation_current(axis, law, at, known_force + f_d), at)
        for at, f_d in itertools.product((-x, x), (-force, force))
    ]
    return float(np.mean([(error(*point) - error(0.0, 0.0)) ** 2 for point in points]))
