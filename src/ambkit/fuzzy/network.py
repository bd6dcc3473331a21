"""From arrays to a fuzzy basis function network in C, and how its inputs are scaled."""

from __future__ import annotations

from types import ModuleType
from typing import TYPE_CHECKING, Literal

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit._core import Fuzzy
    from ambkit.machine.stiffness import StiffnessMap

Scaling = Literal["grid", "unit"] | tuple[float, float]


def network(
    core: ModuleType,
    *,
    centres: Array,
    widths: Array,
    weights: Array,
    scale: tuple[float, float],
    box: tuple[float, float, float, float],
    normalised: bool,
) -> Fuzzy:
    """Build a network in C."""
    # centres (2, rules); widths (2, rules); weights (2, rules)
    scaled = centres * np.array(scale)[:, np.newaxis]
    sharpness = 0.5 / widths**2
    net: Fuzzy = core.Fuzzy(
        centre_iu=scaled[0],
        centre_x=scaled[1],
        sharpness_k_i=sharpness[0],
        weight_k_i=np.ascontiguousarray(weights[0]),
        sharpness_k_s=sharpness[1],
        weight_k_s=np.ascontiguousarray(weights[1]),
        per_ampere=scale[0],
        per_metre=scale[1],
        iu_min=box[0],
        iu_max=box[1],
        x_min=box[2],
        x_max=box[3],
        normalised=normalised,
    )
    return net


def scale_factors(stiff: StiffnessMap, scaling: Scaling) -> tuple[float, float]:
    """Return what currents and displacements are multiplied with, (1/A, 1/m); see `Expert`."""
    if scaling == "unit":
        return 1.0, 1e3
    if scaling == "grid":
        steps_current, steps_displacement = stiff.current.size - 1, stiff.displacement.size - 1
        return (
            steps_current / float(np.ptp(stiff.current)),
            steps_displacement / float(np.ptp(stiff.displacement)),
        )
    if isinstance(scaling, tuple) and len(scaling) == 2:
        return float(scaling[0]), float(scaling[1])
    raise AmbkitError(f'scaling must be "grid", "unit" or two factors (1/A, 1/m), is {scaling!r}')


def default_width(stiff: StiffnessMap, scale: tuple[float, float]) -> float:
    """Return half the larger node step, in scaled units."""
    return 0.5 * max(
        scale[0] * float(np.max(np.diff(stiff.current))),
        scale[1] * float(np.max(np.diff(stiff.displacement))),
    )
