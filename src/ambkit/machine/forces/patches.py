"""A smooth force over current and displacement, as bicubic patches for the C core."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cached_property
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.force_law import Law, symmetric_current_limit
from ambkit.machine.forces.force_points import ForcePoints

if TYPE_CHECKING:
    from ambkit._core import Magnet


ACCURACY = 1e-4  #: Maximum error of the patches, over the rms force.

FIRST, FINEST = 8, 64
"""Initial and maximum number of cells from the origin to the farther end of an axis."""


class Patches(NamedTuple):
    """The force minus that at the origin, and its derivatives, at the nodes of a grid."""

    current: Array  #: Nodes of the control current (columns,) [A], equidistant, including 0.
    displacement: Array  #: Nodes of the displacement (rows,) [m], equidistant, including 0.
    force: Array  #: (rows, columns) [N].
    by_current: Array  #: dF/diu (rows, columns) [N/A].
    by_displacement: Array  #: dF/dx (rows, columns) [N/m].
    by_both: Array  #: Mixed derivative (rows, columns) [N/(A m)].
    error: float
    """Largest error that was observed [N], at the centres of the cells."""


def patches(
    force: Callable[[Array, Array], Array],
    currents: tuple[float, float],
    displacements: tuple[float, float],
) -> Patches:
    """Sample a force, halving the cells until the error at their centres is small."""
    # The derivatives at the nodes are those of the bicubic spline, so the patches reproduce it.
    from scipy.interpolate import RectBivariateSpline

    cells = FIRST
    while True:
        current, displacement = _nodes(*currents, cells), _nodes(*displacements, cells)
        values = evaluated(force, *np.meshgrid(current, displacement))
        values = values - values[np.searchsorted(displacement, 0.0), np.searchsorted(current, 0.0)]
        spline = RectBivariateSpline(displacement, current, values)
        between = [0.5 * (nodes[1:] + nodes[:-1]) for nodes in (current, displacement)]
        origin = float(evaluated(force, np.zeros(1), np.zeros(1))[0])
        off = spline(between[1], between[0]) - (evaluated(force, *np.meshgrid(*between)) - origin)
        error, size = float(np.abs(off).max()), float(np.sqrt(np.mean(values**2)))
        if error <= ACCURACY * size:
            break
        if cells >= FINEST:
            raise AmbkitError(
                f"the force is not smooth enough: at {values.shape[1]} x {values.shape[0]} nodes "
                f"it is still {error:.3g} N off between them, and {ACCURACY * size:.3g} N is asked"
            )
        cells *= 2
    across, along, both = (
        np.asarray(spline(displacement, current, dx=dx, dy=dy))
        for dx, dy in ((0, 1), (1, 0), (1, 1))
    )
    return Patches(current, displacement, values, across, along, both, error)


def _nodes(low: float, high: float, cells: int) -> Array:
    step = max(-low, high) / cells
    first, last = (round(np.ceil(end / step - 1e-9)) for end in (-low, high))
    return step * np.arange(-first, last + 1)


def evaluated(force: Callable[[Array, Array], ArrayLike], iu: Array, x: Array) -> Array:
    """Evaluate the force function, and check for one finite force per point."""
    answer = np.asarray(force(iu, x), dtype=float)
    if answer.shape != iu.shape:
        raise AmbkitError(
            f"force must return an array of shape {iu.shape}, like its arguments; has shape "
            f"{answer.shape}"
        )
    if not np.all(np.isfinite(answer)):
        worst = np.unravel_index(np.argmin(np.isfinite(answer)), answer.shape)
        raise AmbkitError(
            f"force must be finite, is {answer[worst]} at {iu[worst]:g} A, {x[worst]:g} m"
        )
    return answer


class PatchedForce(Law):
    """A magnet whose force is a function of current and displacement."""

    points: ForcePoints
    """Measured points."""
    _scale = 1.0

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Force [N] at places (iu [A], x [m]), of shapes that broadcast."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Self:
        """Return the same for a force multiplied by a factor."""
        other = copy.copy(self)
        other._scale = factor * self._scale
        p = self.patches
        other.patches = Patches(
            p.current, p.displacement, factor * p.force, factor * p.by_current,
            factor * p.by_displacement, factor * p.by_both, factor * p.error,
        )  # fmt: skip
        return other

    @cached_property
    def patches(self) -> Patches:
        """Patches for the C core, over the machine's currents and displacements."""
        b, travel = self.machine, self.machine.clearance
        return patches(self, (b.current_min, b.current_max), (-travel, travel))

    def in_core(self, core: ModuleType) -> Magnet:
        p = self.patches
        nodes = (p.force, p.by_current, p.by_displacement, p.by_both)
        return core.Surface(  # type: ignore[no-any-return]
            p.displacement[0],
            p.displacement[1] - p.displacement[0],
            p.current[0],
            p.current[1] - p.current[0],
            *(np.ascontiguousarray(values) for values in nodes),
            *symmetric_current_limit(self.machine),
        )

    @property
    def bias_force(self) -> float:
        """Force at iu = 0, x = 0 [N], including an offset of the points."""
        return float(self(0.0, 0.0))
