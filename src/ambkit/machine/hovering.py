"""The current that holds a rotor where it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.machine.laws import MagnetModel, evaluate_force

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing


def hover_current(bearing: Bearing, plant: MagnetModel, x: float, balance: float) -> float:
    """Control current [A] that holds the rotor at x [m] against ``balance`` [N], within limits."""
    from scipy.optimize import brentq

    def force(iu: float) -> float:
        return float(evaluate_force(plant, iu, x)) + balance

    low, high = bearing.current_min, bearing.current_max
    if force(low) * force(high) > 0:
        # No current can hold it there: start from the end that comes closest.
        return low if abs(force(low)) < abs(force(high)) else high
    return float(brentq(force, low, high, xtol=1e-15 * (high - low)))
