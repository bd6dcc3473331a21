"""Force laws for the map of a magnet, judged at points that were left out of them."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.force_law import MU_0, IsolatedAxis, Law
from ambkit.machine.laws import ClosedLaw, SaturatingLaw
from ambkit.machine.magnetostatics.magnet_map import MagnetMap

ALIKE = 1.05  #: Of two laws whose errors differ by less, the simpler one is taken.


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
