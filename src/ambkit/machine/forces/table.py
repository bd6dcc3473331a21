"""A force known at the nodes of a grid, and there exactly: from a field computation."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError


class ForceTable:
    """Force function from a table, to be given to :func:`ambkit.stiffness_map` as ``force``."""

    # It goes through all values; for those that scatter there is
    # :class:`~ambkit.machine.forces.force_surface.ForceSurface`. Bicubic between the nodes
    # (not-a-knot spline). Outside, its last polynomial goes on for up to one node step, which is
    # where the nine points of an edge node lie (paper, eq. 27).
    # current (ni,) Nodes of the control current [A], ascending, at least 4.
    # displacement (nx,) Nodes of the displacement [m], ascending, at least 4.
    # values (nx, ni) Force [N], bias force included; rows are displacements.

    def __init__(
        self,
        current: ArrayLike,
        displacement: ArrayLike,
        values: ArrayLike,
    ) -> None:
        from scipy.interpolate import RegularGridInterpolator
        from scipy.sparse.linalg import spsolve

        self.current = np.array(current, dtype=float)
        self.displacement = np.array(displacement, dtype=float)
        self.values = np.array(values, dtype=float)
        check_nodes("current", self.current, "A", least=4)
        check_nodes("displacement", self.displacement, "m", least=4)
        expected = (self.displacement.size, self.current.size)
        if self.values.shape != expected:
            raise AmbkitError(
                f"values must have shape {expected}, a row for each displacement and a column for "
                f"each current, has {self.values.shape}"
            )
        if not np.all(np.isfinite(self.values)):
            row, column = np.argwhere(~np.isfinite(self.values))[0]
            raise AmbkitError(
                f"values[{row}, {column}] must be finite, is {self.values[row, column]}"
            )
        # Counted in whole ranges: micrometres beside amperes would be badly conditioned.
        self._spline = RegularGridInterpolator(
            (
                _in_ranges(self.displacement, self.displacement),
                _in_ranges(self.current, self.current),
            ),
            self.values,
            method="cubic",
            bounds_error=False,
            fill_value=None,  # the last polynomial goes on
            solver=spsolve,
        )

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Force [N] at the points (iu [A], x [m]), of shapes that broadcast."""
        iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
        for name, places, nodes, unit in (
            ("iu", iu, self.current, "A"),
            ("x", x, self.displacement, "m"),
        ):
            low, high = 2 * nodes[0] - nodes[1], 2 * nodes[-1] - nodes[-2]
            beyond = ~((places >= low) & (places <= high))  # NaN is beyond, too
            if np.any(beyond):
                raise AmbkitError(
                    f"{name} = {places[beyond][0]:g} {unit} is more than one node step outside the "
                    f"force table, {nodes[0]:g} to {nodes[-1]:g} {unit}"
                )
        points = _in_ranges(x, self.displacement), _in_ranges(iu, self.current)
        return np.asarray(self._spline(np.stack(points, axis=-1)))


def check_nodes(name: str, nodes: Array, unit: str, *, least: int = 2) -> None:
    """Raise AmbkitError unless nodes are a list of finite, ascending numbers, ``least`` or more."""
    if nodes.ndim != 1 or nodes.size < least:
        raise AmbkitError(
            f"{name} must be a list of at least {least} nodes, has shape {nodes.shape}"
        )
    if not np.all(np.isfinite(nodes)):
        raise AmbkitError(f"{name} must be finite, has {nodes[~np.isfinite(nodes)][0]} {unit}")
    descents = np.flatnonzero(np.diff(nodes) <= 0)
    if descents.size:
        before, after = nodes[descents[0]], nodes[descents[0] + 1]
        raise AmbkitError(f"{name} must ascend, has {before:g} {unit} before {after:g} {unit}")


def _in_ranges(values: Array, nodes: Array) -> Array:
    """Count from the first node in ranges of the nodes."""
    origin, extent = float(nodes[0]), float(nodes[-1] - nodes[0])
    return (values - origin) / extent
