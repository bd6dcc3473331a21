"""Force and flux linkage over currents and displacements, cached for each drawing.

Both are derivatives of one spline of the coenergy, fitted to both, so closed loops do no work.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.base.threads import one_thread
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.field import FieldSolver

NODES = (11, 7)  #: Number of currents and displacements of a map.
VERSION = 3  #: Version of the computation; maps of others are solved again.


class Box(NamedTuple):
    """Bias current and ranges of a map."""

    bias: float  #: [A]
    low: float  #: Minimum control current [A].
    high: float  #: Maximum control current [A].
    displacement_range: float  #: Maximum displacement in both directions [m].


@dataclass(frozen=True, eq=False)
class MagnetMap:
    """Map of one axis of a magnet, with a spline of the coenergy."""

    # The spline is of the coenergy times a weight, which makes it a polynomial for ideal iron.

    gap: float  #: [m]
    two_sided: bool
    current: Array  #: (n,) Control current [A].
    displacement: Array  #: (m,) [m]
    force: Array  #: (m, n) [N]
    flux: Array  #: (m, n) Flux linkage per control current [Vs].
    left_out: Array  #: (3, k) Current, displacement and force of points that are not fitted.

    def __len__(self) -> int:
        return self.force.size

    def weight(self, x: Array) -> tuple[Array, Array]:
        """Return the weight of the coenergy, and its derivative [1/m], at displacements [m]."""
        u = x / self.gap
        return (1 - u**2, -2 * u / self.gap) if self.two_sided else (1 - u, -1 / self.gap + 0 * u)

    @cached_property
    def _spline(self) -> tuple[Any, float]:
        """The weighted coenergy over (current, displacement), and its error at the points."""
        from scipy.interpolate import NdBSpline

        axes = self.current, self.displacement
        knots, orders = zip(*(_knots(axis) for axis in axes), strict=True)
        sides = [len(t) - k - 1 for t, k in zip(knots, orders, strict=True)]
        terms = np.eye(sides[0] * sides[1]).reshape(*sides, -1)
        places = np.stack([at.ravel() for at in np.meshgrid(*axes)], axis=1)
        force, flux = self._slopes(NdBSpline(knots, terms, orders), places)
        sizes = [np.abs(of).max() for of in (self.force, self.flux)]
        rows = np.vstack([force / sizes[0], flux / sizes[1]])
        right = np.concatenate([self.force.ravel() / sizes[0], self.flux.ravel() / sizes[1]])
        with one_thread():
            coefficients = np.linalg.lstsq(rows, right, rcond=1e-12)[0]
        error = float(np.abs(rows @ coefficients - right).max())
        return NdBSpline(knots, coefficients.reshape(sides), orders), error

    @property
    def inconsistency(self) -> float:
        """Largest deviation from a field with one energy, relative."""
        return self._spline[1]

    def _slopes(self, spline: Any, places: Array) -> tuple[Array, Array]:
        """Return force and flux linkage of a weighted coenergy at places (n, 2)."""
        w, slope = self.weight(places[:, 1])
        by_x, by_i, value = (spline(places, nu=nu).T for nu in ((0, 1), (1, 0), (0, 0)))
        return ((by_x - value * slope / w) / w).T, (by_i / w).T

    def _at(self, iu: ArrayLike, x: ArrayLike) -> tuple[Array, Array]:
        iu, x = np.broadcast_arrays(np.asarray(iu, float), np.asarray(x, float))
        places = np.stack([iu.ravel(), x.ravel()], axis=1)
        force, flux = self._slopes(self._spline[0], places)
        return force.reshape(iu.shape), flux.reshape(iu.shape)

    def force_at(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the force [N] at places (iu [A], x [m]), of shapes that broadcast."""
        return self._at(iu, x)[0]

    def flux_at(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the flux linkage [Vs] at places (iu [A], x [m]), of shapes that broadcast."""
        return self._at(iu, x)[1]

    def off(self, force: Callable[[Array, Array], Array]) -> tuple[float, float]:
        """Return the largest and the rms error [N] of a force at the points left out."""
        off = force(*self.left_out[:2]) - self.left_out[2]
        return float(np.abs(off).max()), float(np.sqrt(np.mean(off**2)))


def _knots(nodes: Array) -> tuple[Array, int]:
    """Return the knots of a spline with one more coefficient than nodes, and its order."""
    order = min(len(nodes), 5 if len(nodes) > 8 else 7)
    inner = np.linspace(nodes[0], nodes[-1], len(nodes) - order + 2)
    return np.concatenate([[nodes[0]] * order, inner, [nodes[-1]] * order]), order


def box_of(drawing: Drawing) -> Box:
    """Return the bias current and the ranges of a drawing."""
    bias, limit = drawing.bias_current, drawing.limit
    low = -min(limit, bias) if drawing.geometry.sides == "one-sided" else -limit
    return Box(bias, low, limit, drawing.displacement_range)


def map_of(
    drawing: Drawing, box: Box | None = None, nodes: tuple[int, int] = NODES, fineness: float = 1.0
) -> MagnetMap:
    """Return the map of a drawing, cached."""
    one_sided = drawing.geometry.sides == "one-sided"
    box = box_of(drawing) if box is None else box
    about = drawing.geometry.air_gap, not one_sided
    key = drawing.key(box, nodes, fineness, VERSION)
    return MagnetMap(*about, *kept(key, lambda: _solved(drawing, box, nodes, fineness)))


def kept(key: str, solve: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return arrays from the user's cache, after solving them if they are missing."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ambkit" / "magnets"
    path = root / f"{key}.npz"
    with suppress(OSError, ValueError, KeyError, EOFError, BadZipFile), np.load(path) as file:
        return tuple(file[name] for name in file.files)
    arrays = solve()
    with suppress(OSError, AmbkitError):
        files.make_folder(root)
        with files.replacing(path) as temporary, temporary.open("wb") as opened:
            np.savez(opened, *arrays)
    return arrays


def _solved(
    drawing: Drawing, box: Box, nodes: tuple[int, int], fineness: float
) -> tuple[Array, ...]:
    """Solve the points of a map; half of them if the others follow by symmetry."""
    layout = drawing.layout
    current = np.linspace(box.low, box.high, nodes[0])
    displacement = -box.displacement_range * np.cos(np.pi * np.arange(nodes[1]) / (nodes[1] - 1))
    displacement[nodes[1] // 2] *= nodes[1] % 2 == 0  # the middle is 0
    mirrored = drawing.geometry.sides == "two-sided" and not layout.opposed and -box.low == box.high
    begin = nodes[0] // 2 if mirrored else 0
    between = 0.5 * (current[1:] + current[:-1])
    left_out = [
        (float(between[(3 * row + 1) % len(between)]), float(x))
        for row, x in enumerate(0.5 * (displacement[1:] + displacement[:-1]))
    ]
    solver, result = FieldSolver(layout, fineness), np.zeros((2, nodes[1], nodes[0]))
    count = nodes[1] * (nodes[0] - begin) + len(left_out)
    with progress("solving the magnetic field", count) as done:

        def point(iu: float, x: float, start: Array | None = None) -> tuple[Array, Array]:
            done()
            at = solver.at(x * layout.directions[0])
            s = at.solve(box.bias * layout.bias + iu * layout.control[0], start)
            return np.array([s.force[0], layout.control[0] @ s.flux]), s.a

        for row, x in enumerate(displacement.tolist()):
            start = None
            for column in range(begin, nodes[0]):
                result[:, row, column], start = point(float(current[column]), x, start)
        forces = np.array([point(*at)[0][0] for at in left_out])
        if layout.opposed:  # an equal core behind the rotor, with opposite current and displacement
            forces -= np.array([point(-iu, -x)[0][0] for iu, x in left_out])
    if layout.opposed:
        result = result - result[:, ::-1, ::-1]
    if mirrored:
        result[:, :, :begin] = -result[:, ::-1, : -begin - 1 : -1]
    return current, displacement, *result, np.array([*zip(*left_out, strict=True), forces])
