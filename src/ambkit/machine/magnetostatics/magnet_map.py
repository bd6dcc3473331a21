"""Force and flux linkage over currents and displacements, cached for each drawing.

Both are derivatives of one spline of the coenergy, fitted to both, so closed loops do no work.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.base.threads import one_thread
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.field import FieldSolver, Solution
from ambkit.machine.magnetostatics.layout import Points

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
    grid = np.stack(np.meshgrid(current[begin:], displacement)).reshape(2, -1)
    places = np.hstack([grid, np.transpose(left_out)])
    if layout.opposed:  # an equal core behind the rotor, with opposite current and displacement
        places = np.hstack([places, -np.transpose(left_out)])
    currents = box.bias * layout.bias + np.outer(places[0], layout.control[0])
    values = []
    with progress("solving the magnetic field", places.shape[1]) as done:
        ranges = np.array([[box.high - box.low], [2 * box.displacement_range]])
        for s in _fields(solver, currents, places[1] * layout.directions[0], places / ranges):
            values.append((s.force[0], layout.control[0] @ s.flux))
            done()
    on_grid, between_nodes = np.split(np.transpose(values), [grid.shape[1]], axis=1)
    result[:, :, begin:] = on_grid.reshape(2, nodes[1], -1)
    forces = between_nodes[0, : nodes[1] - 1]
    if layout.opposed:
        forces = forces - between_nodes[0, nodes[1] - 1 :]
    if layout.opposed:
        result = result - result[:, ::-1, ::-1]
    if mirrored:
        result[:, :, :begin] = -result[:, ::-1, : -begin - 1 : -1]
    return current, displacement, *result, np.array([*zip(*left_out, strict=True), forces])


def _fields(
    solver: FieldSolver, currents: Array, displacement: Points, places: Array
) -> Iterator[Solution]:
    """Yield the fields at places (axes, n); each solution starts at the nearest place before."""
    potentials: list[Array] = []
    for number, current in enumerate(currents):
        far = np.linalg.norm(places[:, :number] - places[:, number : number + 1], axis=0)
        start = potentials[far.argmin()] if number else None
        solution = solver.at(complex(displacement[number])).solve(current, start)
        potentials.append(solution.a)
        yield solution


DEGREE, OF_SUMS = 10, 6
POINTS, LEFT_OUT = 120, 12  #: Points solved for the fit; points for its validation.
FINENESS = 0.6  #: Fineness of the mesh; its forces differ by 0.05 % from those with 1.
NEAR, WEIGHT = 0.05, 300.0
"""Range of the slope fit in the centre, over that of the map, and its weight."""
SWAPPED = [1, 0, 3, 2]  #: Components of a term or a place with x and y exchanged.


@dataclass(frozen=True, eq=False)
class TwoAxisMap:
    """Coenergy over control currents and displacements of both axes, in Chebyshev polynomials."""

    # A place is (i_x, i_y, x, y), in amperes and metres.

    ranges: Array  #: (4,) Maximum of each, in both directions.
    #: (terms,) Coefficients of the coenergy [J], for `terms(DEGREE)` of place / range.
    coefficients: Array
    #: (terms of both orders,) Those of the sums of flux linkages of opposite quadrants [Vs].
    sums: Array
    error: float  #: Largest error of a force at the validation points [N].

    @cached_property
    def energy_terms(self) -> tuple[NDArray[np.intp], Array]:
        """Degrees (terms, 4) of all terms of the coenergy and their coefficients (terms,) [J]."""
        some = terms(DEGREE)
        return np.vstack([some, some[:, SWAPPED]]), np.tile(self.coefficients, 2)

    def derivative(self, place: ArrayLike, *by: int) -> Array:
        """Return the coenergy's derivative at places (4, ...) by the components `by`."""
        orders = [by.count(axis) for axis in range(4)]
        degrees, coefficients = self.energy_terms
        u = np.asarray(place, float) / self.ranges.reshape(4, *[1] * (np.ndim(place) - 1))
        factor = np.prod(self.ranges ** -np.array(orders, float))
        return np.asarray(factor * (_products(u.reshape(4, -1), degrees, orders) @ coefficients)
                          ).reshape(u.shape[1:])  # fmt: skip

    def force_at(self, place: ArrayLike) -> Array:
        """Return the forces (2, ...) [N] along x and y at places (4, ...)."""
        return np.stack([self.derivative(place, axis) for axis in (2, 3)])

    def flux_at(self, place: ArrayLike) -> Array:
        """Return the flux linkages (2, ...) [Vs] per control current."""
        return np.stack([self.derivative(place, axis) for axis in (0, 1)])

    def linkages_at(self, place: ArrayLike) -> Array:
        """Return the flux linkage (4, ...) [Vs] of the coils of each quadrant: x, y, -x, -y."""
        at = np.asarray(place, float)
        u = at.reshape(4, -1) / self.ranges[:, None]
        degrees = _both(OF_SUMS)
        sums = [_products(w, degrees, [0] * 4) @ self.sums for w in (u, u[SWAPPED])]
        added, less = np.reshape(sums, (2, *at.shape[1:])), self.flux_at(at)
        return np.asarray(0.5 * np.concatenate([added + less, added - less]))

    def scaled(self, factor: float) -> TwoAxisMap:
        """Return the same with forces multiplied by a factor."""
        return replace(
            self, coefficients=factor * self.coefficients, sums=factor * self.sums,
            error=factor * self.error,
        )  # fmt: skip

    @cached_property
    def coupling(self) -> float:
        """Largest change of a force by the other axis [N]."""
        box = np.stack(np.meshgrid(*(r * np.linspace(-1, 1, 7) for r in self.ranges)))
        single = box * np.array([1.0, 0.0, 1.0, 0.0]).reshape(4, 1, 1, 1, 1)
        return float(np.abs(self.force_at(box)[0] - self.force_at(single)[0]).max())

    def stiffness_at(self, place: ArrayLike) -> tuple[Array, Array]:
        """Return k_i [N/A] and k_s [N/m] (2, 2, ...): force by current and by displacement."""
        k_i, k_s = (
            np.stack([np.stack([self.derivative(place, force, by) for by in along])
                      for force in (2, 3)]) for along in ((0, 1), (2, 3))
        )  # fmt: skip
        return k_i, k_s


@cache
def _both(degree: int) -> NDArray[np.intp]:
    """Return the degrees (terms, 4) of terms that are invariant under reflections."""
    all_of = np.indices([degree + 1] * 4).reshape(4, -1).T
    even = (all_of[:, :2] + all_of[:, 2:]) % 2 == 0
    return np.asarray(all_of[even.all(axis=1) & (all_of.sum(axis=1) <= degree)], dtype=np.intp)


@cache
def terms(degree: int) -> NDArray[np.intp]:
    """Return the degrees (terms, 4), one of each pair with x and y exchanged."""
    every = _both(degree)
    return every[[tuple(one) <= tuple(one[SWAPPED]) for one in every]]


def _products(u: Array, degrees: NDArray[np.intp], orders: Sequence[int]) -> Array:
    """Return the products (n, terms) of Chebyshev polynomials' derivatives at u (4, n)."""
    result = np.ones((u.shape[1], len(degrees)))
    for axis, order in enumerate(orders):
        unit = np.eye(degrees.max() + 1)
        result *= chebyshev.chebval(u[axis], chebyshev.chebder(unit, order)).T[:, degrees[:, axis]]
    return result


def _places(count: int) -> Array:
    """Return places (4, 2 + count) in [-1, 1]: two near the centre, others in an eighth of it."""
    # Additive recurrence by the root of g^5 = g + 1 (Roberts 2018), which fills a box evenly.
    steps = 1.1673039782614187 ** -np.arange(1.0, 5.0)
    u = -np.cos(np.pi * ((0.5 + np.outer(steps, np.arange(count))) % 1.0))
    u = u * np.tile(np.where(u[:2] < 0, -1.0, 1.0), (2, 1))
    centre = NEAR * np.eye(4)[:, [0, 2]]
    return np.hstack([centre, np.where(u[0] < u[1], u[SWAPPED], u)])


def two_axis_map(drawing: Drawing, box: Box | None = None) -> TwoAxisMap:
    """Return the two-axis map of a radial bearing, cached."""
    box = box_of(drawing) if box is None else box
    ranges = np.repeat([max(box.high, -box.low), box.displacement_range], 2)
    key = drawing.key("both axes", box, POINTS, DEGREE, VERSION)
    coefficients, sums, error = kept(key, lambda: _fitted(drawing, box.bias, ranges))
    return TwoAxisMap(ranges, coefficients, sums, float(error))


def _fitted(drawing: Drawing, bias: float, ranges: Array) -> tuple[Array, ...]:
    layout, u = drawing.layout, _places(POINTS + LEFT_OUT)
    solved = []
    with progress("solving the magnetic field over both axes", u.shape[1]) as done:
        solver = FieldSolver(layout, FINENESS)
        currents = bias * layout.bias + (u[:2].T * ranges[:2]) @ layout.control
        places = u[2:] * ranges[2:, None]
        for s in _fields(solver, currents, places[0] + 1j * places[1], u):
            solved.append([s.coenergy, *(layout.control @ s.flux), *s.force, *s.flux])
            done()
    values = np.array(solved).T
    slopes = values[1:5] * ranges[:, None]  # per u
    some, fit = terms(DEGREE), slice(POINTS + 2)
    weight = np.where(np.arange(POINTS + 2) < 2, WEIGHT, 1.0)
    rows = [_products(u, degrees, orders) for degrees in (some, some[:, SWAPPED])
            for orders in np.vstack([np.zeros(4, int), np.eye(4, dtype=int)])]  # fmt: skip
    both = [one + other for one, other in zip(rows[:5], rows[5:], strict=True)]
    left = np.vstack([weight[:, None] * row[fit] for row in both])
    right = np.concatenate([weight * row[fit] for row in (values[0], *slopes)])
    coefficients = np.linalg.lstsq(left, right, rcond=None)[0]
    off = [both[1 + axis] @ coefficients - slopes[axis] for axis in (2, 3)]
    error = np.abs(off)[:, POINTS + 2 :].max() / ranges[2]
    added = values[5:7] + values[7:9]
    ways = np.vstack([_products(w[:, fit], _both(OF_SUMS), [0] * 4) for w in (u, u[SWAPPED])])
    sums = np.linalg.lstsq(ways, added[:, fit].ravel(), rcond=None)[0]
    return coefficients, sums, np.array(error)
