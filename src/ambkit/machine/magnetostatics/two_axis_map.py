"""The force map of a radial bearing over the currents and displacements of both axes.

One polynomial of the coenergy is fitted to coenergy, forces and flux linkages of the field, so
closed loops do no work. By the symmetry of the bearing (quarter turns and reflections) an eighth of
the box is solved, and a polynomial of degree 10 has 155 terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from ambkit.base.arrays import Array
from ambkit.base.progress import progress
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.field import FieldSolver
from ambkit.machine.magnetostatics.magnet_map import VERSION, Box, box_of, kept

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
        for place in (u.T * ranges).tolist():
            currents = bias * layout.bias + np.array(place[:2]) @ layout.control
            s = solver.at(complex(*place[2:])).solve(currents)
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
