"""A machine's force law with magnet constant and air gap fitted to measured points."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.law_choice import law_of

if TYPE_CHECKING:
    from ambkit.machine.force_law import IsolatedAxis, Law

ForceFunction = Callable[[Any, Any], Array]


def refitted(machine: Any, points: ForcePoints) -> Any:
    """Return the machine with magnet constant and air gap fitted to measured points."""
    # By least squares, with a constant force for the zero of the load cell.
    constant, gap = fitted_law(machine, points)[0]
    return machine.replace(**machine.magnet.with_constant(constant), magnet__air_gap=gap)


def fitted_law(
    machine: IsolatedAxis, points: ForcePoints
) -> tuple[tuple[float, float], Law, ForceFunction]:
    """Return the fitted magnet constant and air gap, the law, and its force with the offset."""
    from scipy.optimize import least_squares

    weight = 1.0 if points.standard_error is None else 1 / points.standard_error
    m, at = machine.magnet, (points.current, points.displacement)

    def values(p: Array) -> tuple[float, float]:
        return float(m.magnet_constant * np.exp(p[0])), float(m.air_gap * np.exp(p[1]))

    def law(p: Array) -> Law:
        constant, gap = values(p)
        # Not checked: the search may pass a machine that could not hold its rotor.
        return law_of(_changed(machine, magnet=_changed(m, magnet_constant=constant, air_gap=gap)))

    def force(p: Array) -> ForceFunction:
        own = law(p)
        return lambda iu, x: np.asarray(own.force(iu, x)) + p[2]

    def off(p: Array) -> Array:
        return np.asarray(weight * (np.asarray(force(p)(*at), dtype=float) - points.force))

    least = np.log(1.02 * float(np.abs(points.displacement).max()) / m.air_gap)
    low = [np.log(1e-2), min(max(np.log(0.2), least), -1e-9), -np.inf]
    size = float(np.ptp(points.force)) or 1.0
    result = least_squares(
        off, np.zeros(3), bounds=(low, [np.log(1e2), np.log(5.0), np.inf]), x_scale=[1, 1, size]
    )
    return values(result.x), law(result.x), force(result.x)


def _changed(part: Any, **values: Any) -> Any:
    """Return a copy, not checked, of a machine, its magnet, or their equivalents."""
    if hasattr(part, "model_copy"):
        return part.model_copy(update=values)
    return SimpleNamespace(**vars(part) | values)
