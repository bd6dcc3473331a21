"""Isoparametric triangles of second order: shape functions, gradients, quadrature, assembly.

Zienkiewicz, Taylor and Zhu 2013, chapter 5 and 6; quadrature of degree 4 by Dunavant 1985.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from ambkit.base.arrays import Array
from ambkit.machine.magnetostatics.layout import Points

_A, _B = 0.445948490915965, 0.091576213509771
_AT = np.array([(p, q) for x in (_A, _B) for p, q in ((x, x), (1 - 2 * x, x), (x, 1 - 2 * x))])
_WEIGHT = np.repeat([0.223381589678011, 0.109951743655322], 3) / 2


def _shapes(at: Array) -> tuple[Array, Array]:
    """Return shape functions (points, 6) and their derivatives (points, 6, 2) at places (r, s)."""
    r, s = at.T
    l, zero = 1 - r - s, 0 * r  # noqa: E741
    N = [l * (2 * l - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * s, 4 * s * l, 4 * l * r]
    by_r = [1 - 4 * l, 4 * r - 1, zero, 4 * s, -4 * s, 4 * (l - r)]
    by_s = [1 - 4 * l, zero, 4 * s - 1, 4 * r, 4 * (l - s), -4 * r]
    return np.stack(N, 1), np.stack([np.stack(by_r, 1), np.stack(by_s, 1)], 2)


ALL = slice(None)

N, _DN = _shapes(_AT)  #: Shape functions (points, 6) at the points of the quadrature.


class Elements:
    """Gradients and weights of a mesh at one displacement of its nodes."""

    # With `common` (m, q, 6), all triangles share one more unknown, whose gradient is that of these
    # nodal values at each quadrature point.

    def __init__(
        self, nodes: Points, triangles: NDArray[np.intp], common: Array | None = None
    ) -> None:
        self.triangles, self.count, self.N = triangles, len(nodes), N
        x = nodes[triangles]
        x_r, x_s = x @ _DN[:, :, 0].T, x @ _DN[:, :, 1].T  # (m, q)
        det = np.imag(np.conj(x_r) * x_s)
        self.places = x @ N.T  #: (m, q)
        self.weight = det * _WEIGHT  #: (m, q) Area of each point of the quadrature [m^2].
        by_r, by_s = _DN[:, :, 0], _DN[:, :, 1]
        self.gradient = np.stack(
            [
                (x_s.imag[:, :, None] * by_r - x_r.imag[:, :, None] * by_s) / det[:, :, None],
                (x_r.real[:, :, None] * by_s - x_s.real[:, :, None] * by_r) / det[:, :, None],
            ],
            axis=3,
        )  #: (m, q, 6, 2); 7 with a common unknown.
        if common is not None:
            more = np.einsum("mqat,mqa->mqt", self.gradient, common)
            self.gradient = np.concatenate([self.gradient, more[:, :, None]], axis=2)
            self.triangles = np.insert(triangles, 6, self.count, axis=1)
            self.count, self.N = self.count + 1, np.insert(N, 6, 0.0, axis=1)

    def grad(self, a: Array) -> Array:
        """Return the gradient (m, q, 2) of a nodal field (n,)."""
        return np.asarray(
            np.einsum("mqat,ma->mqt", self.gradient, a[self.triangles], optimize=True)
        )

    def vector(self, values: Array, at: NDArray[np.intp] | slice = ALL) -> Array:
        """Assemble a vector (n,) from element vectors (m, 6)."""
        return np.bincount(self.triangles[at].ravel(), values.ravel(), self.count).astype(float)

    def load(self, density: Array) -> Array:
        """Return the integral of a density (m, q) times each shape function (n,)."""
        return self.vector((density * self.weight) @ self.N)

    def matrix(self, values: Array, at: NDArray[np.intp] | slice = ALL) -> sparse.csc_matrix:
        """Assemble a matrix (n, n) from element matrices (m, 6, 6)."""
        triangles = self.triangles[at]
        nodes = triangles.shape[1]
        rows = np.repeat(triangles, nodes, axis=1).ravel()
        columns = np.tile(triangles, (1, nodes)).ravel()
        return sparse.csc_matrix((values.ravel(), (rows, columns)), shape=(self.count, self.count))
