"""Force laws fitted to measured points, and to the map of a drawing."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.force_law import MU_0
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.laws import ClosedLaw, SaturatingLaw, law_of

if TYPE_CHECKING:
    from ambkit.machine.force_law import IsolatedAxis, Law
    from ambkit.machine.magnetostatics.magnet_map import MagnetMap

ForceFunction = Callable[[Any, Any], Array]

ALIKE = 1.05  #: Of two laws whose errors differ by less, the simpler one is taken.


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


class LawError(NamedTuple):
    """How far a law is from the points left out."""

    name: str
    key: str
    law: Law | None  #: None of the map itself.
    largest: float  #: [N]
    rms: float  #: [N]


def law_errors(magnet: Any, solved: MagnetMap) -> list[LawError]:
    """Return the laws for a map, from the simplest on, by their errors at points left out."""
    # magnet: type, bias current, magnet constant and air gap, as the drawing has them
    from scipy.optimize import least_squares

    k, s0 = magnet.magnet_constant, magnet.air_gap
    iu, x = np.meshgrid(solved.current, solved.displacement)

    def of(constant: float, gap: float, iron: float = 0.0, knee: float = 0.0) -> IsolatedAxis:
        m = SimpleNamespace(
            type=magnet.type, bias_current=magnet.bias_current, magnet_constant=constant,
            air_gap=gap, iron_length=2 * iron, relative_permeability=1.0,
            turns=2 * knee / MU_0, saturation=1.0,
        )  # fmt: skip
        return cast("IsolatedAxis", SimpleNamespace(magnet=m))

    def fitted(law: Callable[..., Law], start: list[float]) -> Law:
        def off(change: Array) -> Array:
            return (law(of(*(np.exp(change) * start))).force(iu, x) - solved.force).ravel()

        change = least_squares(off, np.zeros(len(start))).x
        return law(of(*(np.exp(change) * start)))

    knee = s0 / (4 * (magnet.bias_current + float(solved.current[-1])))
    laws = {
        "ideal": ("ideal iron, from the drawing", ClosedLaw(of(k, s0))),
        "closed": ("closed law, fitted", fitted(ClosedLaw, [k, s0])),
        "saturating": (
            "saturating law, fitted", fitted(SaturatingLaw, [k, s0, 0.05 * s0, knee]),
        ),
    }  # fmt: skip
    errors = [LawError(name, key, law, *solved.off(law.force)) for key, (name, law) in laws.items()]
    return [*errors, LawError("map", "map", None, *solved.off(solved.force_at))]


def preferred(errors: list[LawError]) -> LawError:
    """Return the law whose error is the least, the simpler one of those alike."""
    limit = ALIKE * min(error.rms for error in errors)
    return next(error for error in errors if error.rms <= limit)
