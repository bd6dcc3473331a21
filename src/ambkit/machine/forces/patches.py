"""A smooth force of current and displacement, as bicubic patches for the C core."""

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
from ambkit.machine.force_law import Law, equally_far
from ambkit.machine.forces.force_points import ForcePoints

if TYPE_CHECKING:
    from ambkit._core import Magnet


ACCURACY = 1e-4  #: How far the patches may be from the force, in parts of its root mean square.

FIRST, FINEST = 8, 64
"""Cells from the origin to the farther end of an axis: at first, and at most."""


class Patches(NamedTuple):
    """Force less that at the origin, and its derivatives, at the nodes of a grid."""

    current: Array  #: Nodes of the control current (columns,) [A], evenly spaced, one of them 0.
    displacement: Array  #: Nodes of the displacement (rows,) [m], evenly spaced, one of them 0.
    force: Array  #: (rows, columns) [N].
    by_current: Array  #: dF/diu (rows, columns) [N/A].
    by_displacement: Array  #: dF/dx (rows, columns) [N/m].
    by_both: Array  #: Mixed derivative (rows, columns) [N/(A m)].
    error: float
    """The largest distance from the force that was found [N], in the middles between nodes."""


def patches(
    force: Callable[[Array, Array], Array],
    currents: tuple[float, float],
    displacements: tuple[float, float],
) -> Patches:
    """Sample a force, each time twice as finely, until the middles between the nodes are right."""
    # The derivatives at the nodes are those of the bicubic spline through them, which the patches
    # then are.
    from scipy.interpolate import RectBivariateSpline

    cells = FIRST
    while True:
        current, displacement = _nodes(*currents, cells), _nodes(*displacements, cells)
        values = _asked(force, current, displacement)
        values -= values[np.searchsorted(displacement, 0.0), np.searchsorted(current, 0.0)]
        spline = RectBivariateSpline(displacement, current, values)
        between = [0.5 * (nodes[1:] + nodes[:-1]) for nodes in (current, displacement)]
        origin = float(_asked(force, np.zeros(1), np.zeros(1))[0, 0])
        off = spline(between[1], between[0]) - (_asked(force, *between) - origin)
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


def _asked(force: Callable[[Array, Array], Array], current: Array, displacement: Array) -> Array:
    iu, x = np.meshgrid(current, displacement)
    values = np.array(force(iu, x), dtype=float)
    if not np.isfinite(values).all():
        at = np.unravel_index(np.argmin(np.isfinite(values)), values.shape)
        raise AmbkitError(f"force must be finite, is {values[at]} at {iu[at]:g} A, {x[at]:g} m")
    return values


class PatchedForce(Law):
    """A magnet whose force is a function of current and displacement."""

    points: ForcePoints
    """Points that it goes through."""
    _scale = 1.0

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Force [N] at places (iu [A], x [m]), of shapes that broadcast."""
        raise NotImplementedError

    def scaled(self, factor: float) -> Self:
        """Return the same for a force so many times as large."""
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
        """What the C core has of it, over the machine's currents and its travel."""
        b, travel = self.machine, self.machine.clearance
        return patches(self, (b.current_min, b.current_max), (-travel, travel))

    def in_core(self, core: ModuleType) -> Magnet:
        """Build the C implementation."""
        p = self.patches
        nodes = (p.force, p.by_current, p.by_displacement, p.by_both)
        return core.Surface(  # type: ignore[no-any-return]
            p.displacement[0],
            p.displacement[1] - p.displacement[0],
            p.current[0],
            p.current[1] - p.current[0],
            *(np.ascontiguousarray(values) for values in nodes),
            *equally_far(self.machine),
        )

    @property
    def bias_force(self) -> float:
        """Force at iu = 0, x = 0 [N], with all that the points have in common."""
        return float(self(0.0, 0.0))
