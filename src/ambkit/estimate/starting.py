"""Where an estimator starts: how sure it is, and what holds the rotor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ambkit.estimate.noise import Variances
from ambkit.machine.bearing import GRAVITY
from ambkit.machine.hovering import hover_current
from ambkit.machine.magnets import MagnetModel, bias_force_of, own_time
from ambkit.models.model import Descriptor

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing, Sensor


def rounding_std(sensor: Sensor) -> float:
    """Return the standard deviation of a sensor's rounding, a step over sqrt(12) [m]."""
    return (sensor.quantisation or 0.0) / math.sqrt(12)


def start_std(
    bearing: Bearing, variances: Variances, states: Sequence[Descriptor]
) -> tuple[float, ...]:
    """Return the standard deviations with which a filter starts; see `Estimator.reset`."""
    sigma = 3 * math.hypot(math.sqrt(variances.measurement), rounding_std(bearing.sensor))
    by_role = {
        "position": sigma / abs(bearing.sensor.gain),
        "velocity": 0.1 * bearing.rotor.travel_limit / own_time(bearing),
        "disturbance force": bearing.rotor.mass * GRAVITY,
        "sensor": sigma,
        "current": bearing.amplifier.current_limit,
        "past control": bearing.amplifier.current_limit,
    }
    return tuple(by_role.get(state.role, state.size) for state in states)


def hovering(
    bearing: Bearing,
    magnet: MagnetModel,
    states: Sequence[Descriptor],
    known: float | None = None,
) -> tuple[float, float]:
    """Return the current that holds the rotor in the middle [A], and its slope there [A/m]."""
    # Without a current among the states nobody asks: 0. The weight is there, whether a filter knows
    # it or takes it for a disturbance; or what else is `known` [N].
    if not {"current", "past control"} & {state.role for state in states}:
        return 0.0, 0.0
    balance = bearing.weight + bias_force_of(magnet, bearing) if known is None else known
    step = 0.1 * bearing.rotor.travel_limit
    less, middle, more = (hover_current(bearing, magnet, x, balance) for x in (-step, 0.0, step))
    return middle, (more - less) / (2 * step)
