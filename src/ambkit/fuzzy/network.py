"""The fuzzy basis function network in C, and the scaling of its inputs."""

from types import ModuleType
from typing import Any, Literal

import numpy as np

from ambkit._core import Fuzzy
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.stiffness import StiffnessMap

Scaling = Literal["grid", "unit"] | tuple[float, float]


def network(core: ModuleType, expert: Any, widths: Array, weights: Array) -> Fuzzy:
    """Build the network of an expert in C, with other widths and weights (2, rules)."""
    scaled = expert.centres * np.array([[expert.per_ampere], [expert.per_metre]])
    sharpness = 0.5 / widths**2
    (iu_min, iu_max), (x_min, x_max) = expert.current_range, expert.displacement_range
    net: Fuzzy = core.Fuzzy(
        centre_iu=scaled[0],
        centre_x=scaled[1],
        sharpness_k_i=sharpness[0],
        weight_k_i=np.ascontiguousarray(weights[0]),
        sharpness_k_s=sharpness[1],
        weight_k_s=np.ascontiguousarray(weights[1]),
        per_ampere=expert.per_ampere,
        per_metre=expert.per_metre,
        iu_min=iu_min,
        iu_max=iu_max,
        x_min=x_min,
        x_max=x_max,
        normalised=expert.normalised,
    )
    return net


def scale_factors(stiff: StiffnessMap, scaling: Scaling) -> tuple[float, float]:
    """Return the scale factors of currents and displacements, (1/A, 1/m); see `Expert`."""
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
