"""Timoshenko beam elements of a shaft, with rotary inertia and gyroscopics.

Each node has a transverse deflection w [m] and a rotation th of its cross section [rad], positive
where w increases along the shaft. With the shear parameter ``Phi = 12 E I / (kappa G A L^2)`` the
shape functions of Przemieniecki (Theory of Matrix Structural Analysis, 1968, ch. 5) solve the
static beam exactly, with consistent masses (Nelson, A finite rotating shaft element using
Timoshenko beam theory, 1980).
"""

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ambkit.base.arrays import Array

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Exact for polynomials of degree 7; the masses have degree 6."""


RIGID = 1e-3  #: Squared frequency of a rigid-body mode, over that of the first bending mode.


class Element(NamedTuple):
    """A piece of shaft with constant cross section."""

    length: float  #: L [m].
    outer: float  #: Outer diameter [m].
    inner: float  #: Inner diameter, 0 for a solid shaft [m].
    density: float  #: [kg/m^3].
    youngs: float  #: Young's modulus E [Pa].
    poisson: float  #: Poisson's ratio [1].

    @property
    def area(self) -> float:
        """Cross section A [m^2]."""
        return math.pi / 4 * (self.outer**2 - self.inner**2)

    @property
    def second_moment(self) -> float:
        """Second moment I of the area about a diameter [m^4]."""
        return math.pi / 64 * (self.outer**4 - self.inner**4)

    @property
    def shear(self) -> float:
        """Shear parameter Phi [1]."""
        nu, ratio = self.poisson, (self.inner / self.outer) ** 2
        # Cowper, The shear coefficient in Timoshenko's beam theory, 1966: the hollow circle.
        square = (1 + ratio) ** 2
        kappa = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * ratio)
        G = self.youngs / (2 * (1 + nu))
        return 12 * self.youngs * self.second_moment / (kappa * G * self.area * self.length**2)


class Shapes(NamedTuple):
    """Shape functions (points, 4) of (w, th) at both ends, at relative places of an element."""

    w: Array  #: Deflection [m/m, m/rad].
    slope: Array  #: Its slope [1/m, 1].
    th: Array  #: Rotation of the cross section [1/m, 1].
    bend: Array  #: Its derivative along the shaft [1/m^2, 1/m].


def shapes(share: Array, length: float, shear: float) -> Shapes:
    """Return the shape functions of an element."""
    # share (points,) [1]
    s, L, P = np.asarray(share, float), length, shear
    one = np.ones_like(s)
    w = (1 - 3 * s**2 + 2 * s**3 + P * (1 - s), L * (s - 2 * s**2 + s**3 + P / 2 * (s - s**2)),
         3 * s**2 - 2 * s**3 + P * s, L * (s**3 - s**2 + P / 2 * (s**2 - s)))  # fmt: skip
    slope = ((6 * s**2 - 6 * s - P) / L, 1 - 4 * s + 3 * s**2 + P / 2 * (1 - 2 * s),
             (6 * s - 6 * s**2 + P) / L, 3 * s**2 - 2 * s + P / 2 * (2 * s - 1))  # fmt: skip
    th = (6 * (s**2 - s) / L, 1 - 4 * s + 3 * s**2 + P * (1 - s),
          6 * (s - s**2) / L, 3 * s**2 - 2 * s + P * s)  # fmt: skip
    bend = (6 * (2 * s - 1) / L**2, (6 * s - 4 - P) / L,
            6 * (one - 2 * s) / L**2, (6 * s - 2 + P) / L)  # fmt: skip
    return Shapes(*(np.stack(item, axis=-1) / (1 + P) for item in (w, slope, th, bend)))


@dataclass(frozen=True, eq=False)
class Matrices:
    """A rotor in one plane along its shaft: ``M q'' + (D - j speed G) q' + K q = f``."""

    # q: w and th of each node in sequence; both planes as x + j y. SI: metres, radians.

    M: Array  #: Masses (2 nodes, 2 nodes).
    K: Array  #: Stiffnesses.
    G: Array  #: Polar inertias: symmetric.
    D: Array | None  #: Non-rotating damping, or None.
    place: Array  #: Places of the nodes along the shaft, ascending (nodes,) [m].
    shear: Array
    """Phi of each element between them (nodes - 1,); 0: the rotation is the slope of w."""
    D_internal: Array | None = None
    """Rotating damping: ``D_internal (q' - j speed q)``."""

    @cached_property
    def free_modes(self) -> tuple[Array, Array]:
        """Squared frequencies (all,) [1/s^2] and bending modes (2 nodes, all) of unit mass."""
        from scipy.linalg import eigh

        # Rotations are scaled by the length of the shaft, against loss of digits.
        size = np.ones(len(self.M))
        size[1::2] = 2 / (self.place[-1] - self.place[0])
        scale = np.outer(size, size)
        squares, vectors = eigh(self.K * scale, self.M * scale)
        first = squares[2]
        if not first > 0:
            raise ValueError("K bends without a force: more than the two rigid motions have none")
        if np.abs(squares[:2]).max() > RIGID * first:
            rigid = math.sqrt(np.abs(squares[:2]).max()) / (2 * math.pi)
            raise ValueError(
                f"K must leave the rotor free, without bearings; it holds the rigid body at "
                f"{rigid:.4g} Hz"
            )
        return squares[2:], vectors[:, 2:] * size[:, None]


def element_matrices(element: Element) -> tuple[Array, Array, Array]:
    """Return M, K and G (4, 4) of an element."""
    share, weights = (_POINTS + 1) / 2, _WEIGHTS / 2 * element.length
    N = shapes(share, element.length, element.shear)

    def over_length(a: Array) -> Array:
        return np.asarray((a.T * weights) @ a)

    rotary_inertia = element.density * element.second_moment * over_length(N.th)
    M = element.density * element.area * over_length(N.w) + rotary_inertia
    K = element.youngs * element.second_moment * over_length(N.bend)
    if element.shear > 0:
        stiff = 12 * element.youngs * element.second_moment / (element.shear * element.length**2)
        K = K + stiff * over_length(N.slope - N.th)
    return M, K, 2 * rotary_inertia


class Disc(NamedTuple):
    """A rigid disc on a node."""

    place: float  #: Distance from the start of the shaft [m].
    mass: float  #: [kg].
    transverse_inertia: float  #: About a diameter [kg m^2].
    polar_inertia: float  #: About the shaft [kg m^2].


def assemble(elements: list[Element], discs: list[Disc]) -> Matrices:
    """Return the matrices of a shaft with discs."""
    place = np.concatenate([[0.0], np.cumsum([item.length for item in elements])])
    n = 2 * len(place)
    M, K, G = np.zeros((3, n, n))
    for k, element in enumerate(elements):
        here = slice(2 * k, 2 * k + 4)
        for matrix, part in zip((M, K, G), element_matrices(element), strict=True):
            matrix[here, here] += part
    for disc in discs:
        w = 2 * int(np.argmin(np.abs(place - disc.place)))
        M[w, w] += disc.mass
        M[w + 1, w + 1] += disc.transverse_inertia
        G[w + 1, w + 1] += disc.polar_inertia
    return Matrices(M, K, G, None, place, np.array([item.shear for item in elements]))


FINEST = 60  #: Minimum number of elements per shaft length, except for sections of one element.


def divided(sections: list[Element], cuts: list[float]) -> list[Element]:
    """Return sections divided at all cuts, into short elements."""
    longest = sum(item.length for item in sections) / FINEST
    result, start = [], 0.0
    for section in sections:
        end = start + section.length
        inside = sorted({cut for cut in cuts if start < cut < end})
        near = 1e-9 * longest
        ends = [start, *(cut for cut in inside if cut - start > near and end - cut > near), end]
        for first, last in pairwise(ends):
            count = math.ceil((last - first) / longest * (1 - 1e-9))
            result += [section._replace(length=(last - first) / count)] * count
        start = end
    return result
