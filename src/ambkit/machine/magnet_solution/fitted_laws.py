"""Force laws fitted to a map, judged at points that it was not made of."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.force_law import MU_0, IsolatedAxis
from ambkit.machine.laws import ClosedLaw, SaturatingLaw
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.magnet_map import MagnetMap


class LawError(NamedTuple):
    """How far a law is from forces that it was not fitted to."""

    name: str
    key: str
    largest: float  #: [N]
    rms: float  #: [N]


def law_errors(drawing: Drawing, solved: MagnetMap, between: Array) -> list[LawError]:
    """Return the errors of laws and of the map's splines at points (3, n) between its own."""
    from scipy.optimize import least_squares

    w, k, s0 = drawing.winding, drawing.magnet_constant, drawing.geometry.air_gap
    iu, x = np.meshgrid(solved.current, solved.displacement)

    def magnet(constant: float, gap: float, iron: float = 0.0, knee: float = 0.0) -> IsolatedAxis:
        m = SimpleNamespace(
            type=drawing.geometry.sides, bias_current=w.bias_current, magnet_constant=constant,
            air_gap=gap, iron_length=2 * iron, relative_permeability=1.0,
            turns=2 * knee / MU_0, saturation=1.0,
        )  # fmt: skip
        return cast("IsolatedAxis", SimpleNamespace(magnet=m))

    def fitted(law: Callable[..., Any], start: list[float]) -> Any:
        def off(change: Array) -> Array:
            force = law(magnet(*(np.exp(change) * start))).force(iu, x)
            return np.asarray(force - solved.force).ravel()

        change = least_squares(off, np.zeros(len(start))).x
        return law(magnet(*(np.exp(change) * start)))

    knee = s0 / (4 * (w.bias_current + w.limit))
    laws: dict[str, tuple[str, Callable[[Array, Array], Array]]] = {
        "ideal": ("ideal iron, from the drawing", ClosedLaw(magnet(k, s0)).force),
        "closed": ("closed law, fitted", fitted(ClosedLaw, [k, s0]).force),
        "saturating": (
            "saturating law, fitted",
            fitted(SaturatingLaw, [k, s0, 0.05 * s0, knee]).force,
        ),
        "map": ("map", solved.force_at),
    }
    errors = []
    for key, (name, force) in laws.items():
        off = force(between[0], between[1]) - between[2]
        errors.append(
            LawError(name, key, float(np.abs(off).max()), float(np.sqrt(np.mean(off**2))))
        )
    return errors
