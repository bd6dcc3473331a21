"""The magnetostatic field of a layout, and its force and flux linkage.

The vector potential a (r A_phi if axisymmetric) minimises the energy minus the work of the currents
(Newton with line search). The rotor is displaced by moving the nodes of the gap, so force and flux
linkage are exact derivatives of one discrete energy (Coulomb and Meunier, IEEE Trans. Magn. 20,
1984): a closed loop of currents and displacements does no work.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.iron import Curve
from ambkit.machine.magnetostatics.layout import AxialCircuit, Layout, Points, flat
from ambkit.machine.magnetostatics.mesh import mesh_of

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


PRECISION = 1e-9  #: Relative change of the energy at which Newton's method ends.
STEPS = 60  #: Maximum number of Newton steps.
LEAST_B = 1e-9  #: Minimum flux density for the permeability [T].


Skin = Callable[[Curve, Array], NDArray[np.complex128]]
"""Factor on the differential reluctivity (m, q) [m/H] of iron in an alternating field."""


class Solution(NamedTuple):
    """A field."""

    a: Array  #: (n,) Vector potential [Vs/m]; times the radius where axisymmetric [Vs].
    # With an axial circuit, its flux per length is appended.
    force: Array  #: (directions,) Force on the rotor [N].
    flux: Array  #: (coils,) Flux linkages [Vs].
    coenergy: float  #: [J]
    B: Points  #: (m, points) Flux density [T].


class FieldSolver:
    """The mesh of a layout and its materials."""

    def __init__(self, layout: Layout, fineness: float = 1.0, skin: float | None = None) -> None:
        self.layout, self.mesh = layout, mesh_of(layout, fineness, skin)
        regions, region = layout.regions, self.mesh.region
        of = [regions[number] if number >= 0 else layout.boundary for number in region]
        self.moves = np.array([r.moves for r in of])
        self.air = np.array([not (r.moves or r.iron or r.coil >= 0 or r.remanence) for r in of])
        curves = {id(r.iron): r.iron for r in of if r.iron is not None}
        self.iron = [
            (curve, np.flatnonzero([r.iron is curve for r in of])) for curve in curves.values()
        ]
        self.linear = np.flatnonzero([r.iron is None for r in of])
        self.reluctivity = 1 / (MU_0 * np.array([r.permeability for r in of]))
        self.remanence = np.array([r.remanence for r in of])
        self.common = None if layout.axial is None else self._angles(layout.axial)
        inner = np.logical_not(self.mesh.rim)
        self.free = np.flatnonzero(inner if layout.axial is None else np.append(inner, True))
        self.length = 2 * np.pi if layout.axisymmetric else layout.depth
        self.sense = -1.0 if layout.axisymmetric else 1.0  # (r, z, phi) is left-handed
        rest = Elements(self.mesh.nodes, self.mesh.triangles, self.common)
        self.coils = np.zeros((layout.bias.size, rest.count))
        for number, r in enumerate(regions):
            if r.coil >= 0:
                inside = (region == number)[:, None] * np.ones_like(rest.weight)
                area = float((inside * rest.weight).sum())
                self.coils[r.coil] += self.length * r.turns / area * rest.load(inside)
        if layout.axial is not None and layout.axial.turns:
            self.coils[-1, -1] = layout.axial.turns * layout.axial.length
        self._positions: dict[complex, Position] = {}

    def at(self, displacement: complex = 0.0) -> Position:
        """Return the problem with the rotor displaced [m]."""
        key = complex(displacement)
        if key not in self._positions:
            if len(self._positions) > 3:
                self._positions.clear()
            self._positions[key] = Position(self, key)
        return self._positions[key]

    def _angles(self, axial: AxialCircuit) -> Array:
        """Return the potential (m, q, 6) of a unit of radial flux in the irons and between them."""
        # Radial flux is the curl of an angle, continued in each triangle from its first corner.
        nodes = self.mesh.nodes[self.mesh.triangles]
        share = axial.share(np.abs(nodes @ N.T))
        nodes = np.where((share > 0).any(axis=1, keepdims=True), nodes, 1.0)  # 0 may be a corner
        angle = np.angle(nodes / nodes[:, :1])
        return np.asarray(share[:, :, None] * angle[:, None, :] / (2 * np.pi))

    @cached_property
    def follows(self) -> Array:
        """Displacement of each node by that of the rotor (n,): 1 in it, 0 in the stator."""
        mesh = self.mesh
        parts = []
        for chosen in (self.moves, ~self.moves & ~self.air):
            inside = np.zeros(len(mesh.nodes), dtype=bool)
            inside[mesh.triangles[chosen]] = True
            parts.append(inside)
        axis = (mesh.nodes.real == 0) & self.layout.axisymmetric
        moving, solid, rim = (self._distance(part) for part in (*parts, mesh.rim & ~axis))
        fixed = np.minimum(solid, rim)
        return np.append(fixed / (moving + fixed), [0.0] * (self.common is not None))

    @cached_property
    def in_gap(self) -> NDArray[np.intp]:
        """Triangles between stator and rotor, at the smallest distance."""
        strain = np.linalg.norm(self.at().elements.grad(self.follows), axis=2).mean(axis=1)
        return np.flatnonzero(self.air & (strain > 0.7 * np.quantile(strain[self.air], 0.98)))

    def _distance(self, inside: NDArray[np.bool_]) -> Array:
        """Return the distances (n,) of nodes from a part, 0 inside."""
        nodes = self.mesh.nodes
        sides = self.mesh.triangles[self.air][:, [[1, 3, 2], [2, 4, 0], [0, 5, 1]]].reshape(-1, 3)
        a, middle, b = nodes[sides[inside[sides].all(axis=1)]].T
        t = np.linspace(0, 1, 17)[:, None]
        on = (a * (1 - t) * (1 - 2 * t) + middle * 4 * t * (1 - t) + b * t * (2 * t - 1)).ravel()
        tree = scipy.spatial.cKDTree(flat(on))
        far = tree.query(flat(nodes))[0]
        return np.where(inside, 0.0, far)


class Position:
    """The discrete problem at one displacement of the rotor."""

    def __init__(self, solver: FieldSolver, displacement: complex) -> None:
        self.solver = solver
        nodes, triangles = solver.mesh.nodes, solver.mesh.triangles
        if displacement:
            nodes = nodes + displacement * solver.follows[: len(nodes)]
        self.elements = e = Elements(nodes, triangles, solver.common)
        if (e.weight <= 0).any():
            raise AmbkitError(f"a displacement of {abs(displacement):g} m closes the air gap")
        axial = solver.layout.axisymmetric
        self.radius = e.places.real if axial else np.ones_like(e.weight)  # B = grad a / radius
        self.volume = solver.length * self.radius * e.weight if axial else solver.length * e.weight
        factor = self.volume / self.radius**2
        self.stiffness = self._matrix(solver.linear, solver.reluctivity[:, None] * factor)
        self.magnets = np.zeros(e.count)
        if solver.remanence.any():
            h = solver.sense * (solver.reluctivity * solver.remanence)[:, None] * factor
            h *= self.radius
            self.magnets = e.vector(
                np.einsum("mq,mqa->ma", h.real, e.gradient[..., 1])
                - np.einsum("mq,mqa->ma", h.imag, e.gradient[..., 0])
            )
        if solver.layout.axial is not None:
            self.magnets[-1] = solver.layout.axial.mmf * solver.layout.axial.length

    def _matrix(self, at: NDArray[np.intp], factor: Array) -> sparse.csc_matrix:
        g = self.elements.gradient[at]
        values = np.einsum("mqat,mqbt->mab", g * factor[at, :, None, None], g, optimize=True)
        return self.elements.matrix(values, at)

    def _energy(self, a: Array, source: Array) -> tuple[float, Array, list[tuple[Array, Array]]]:
        """Return energy minus work [J], grad a (m, q, 2), and H/B of each iron, and its slope."""
        s, linear = self.solver, self.solver.linear
        gradient = self.elements.grad(a)
        b = np.hypot(gradient[..., 0], gradient[..., 1]) / self.radius
        v = self.volume
        energy = 0.5 * float((v[linear] * s.reluctivity[linear, None] * b[linear] ** 2).sum())
        state = []
        for curve, at in s.iron:
            level = np.maximum(b[at], LEAST_B)
            h, slope, density = curve.at(level)
            energy += float((v[at] * density).sum())
            state.append((h / level, (slope - h / level) / level**2))
        if s.layout.axial is not None:
            energy += s.layout.axial.energy(float(a[-1]))[0]
        return energy - float(source @ a), gradient, state

    def solve(self, currents: Array, start: Array | None = None) -> Solution:
        """Return the field of currents (coils,) [A]; `start` (n,) is an initial potential."""
        s, e, free = self.solver, self.elements, self.solver.free
        source = np.asarray(currents, dtype=float) @ s.coils + self.magnets
        a = np.zeros(e.count) if start is None else start
        value, gradient, state = self._energy(a, source)
        for _ in range(STEPS):
            matrix, residual = self._linearised(a, gradient, state, source)
            step = np.zeros(e.count)
            step[free] = self.solved(matrix[free][:, free], residual[free])
            slope, share = float(residual @ step), 1.0
            while True:
                new, gradient, state = self._energy(a + share * step, source)
                if new <= value - 1e-4 * share * slope or slope <= PRECISION * abs(value):
                    break
                share /= 2
            a, value = a + share * step, new
            if slope <= PRECISION * abs(value):
                return self._solution(a, -value, gradient)
        raise AmbkitError(f"the magnetic field does not converge in {STEPS} steps")

    def _linearised(
        self, a: Array, gradient: Array, state: list[tuple[Array, Array]], source: Array,
        skin: Skin | None = None,
    ) -> tuple[sparse.csc_matrix, Array]:  # fmt: skip
        """Return the tangent stiffness (n, n) and the residual (n,) at a potential."""
        s, e = self.solver, self.elements
        factor = self.volume / self.radius**2
        matrix, residual = self.stiffness, source - self.stiffness @ a
        for (curve, at), (nu, bend) in zip(s.iron, state, strict=True):
            g = e.gradient[at]
            f: NDArray[Any] = factor[at]
            along = np.einsum("mqt,mqat->mqa", gradient[at], g, optimize=True)
            residual -= e.vector(np.einsum("mq,mqa->ma", nu * f, along), at)
            weight = bend / self.radius[at] ** 2
            if skin is not None:
                f = f * skin(curve, nu + weight * (gradient[at] ** 2).sum(axis=2))
            weight = weight * f
            values = np.einsum("mqat,mqbt->mab", g * (nu * f)[..., None, None], g, optimize=True)
            values += np.einsum("mqa,mqb->mab", along * weight[..., None], along, optimize=True)
            matrix = matrix + e.matrix(values, at)
        if s.layout.axial is not None:
            _, slope, rise = s.layout.axial.energy(float(a[-1]))
            residual[-1] -= slope
            last = e.count - 1
            matrix = matrix + sparse.csc_matrix(([rise], ([last], [last])), shape=matrix.shape)
        return matrix, residual

    def tangent(self, a: Array, skin: Skin | None = None) -> tuple[sparse.csc_matrix, Array]:
        """Return the tangent stiffness (n, n), and the derivative of the force (n,)."""
        # For small changes of a potential; the force is that along the first direction.
        source = np.zeros(self.elements.count)
        _, gradient, state = self._energy(a, source)
        g, strain, density = self._shell(gradient)
        way = self.solver.layout.directions[0]
        d = np.array([way.real, way.imag])
        along, across = (g @ d)[..., None], (g * strain).sum(axis=2)[..., None]
        change = density[..., None] * (strain * along + across * d - g * (strain @ d)[..., None])
        between = np.flatnonzero(self.solver.air)
        by_node = np.einsum("mqt,mqat->ma", change, self.elements.gradient[between])
        force = self.elements.vector(by_node, between)
        return self._linearised(a, gradient, state, source, skin)[0], force

    def _shell(self, gradient: Array) -> tuple[Array, Array, Array]:
        """Return grad a, that of the rotor's nodes, and reluctivity times volume, in air."""
        s = self.solver
        between = np.flatnonzero(s.air)
        density = (self.volume / self.radius**2)[between] * s.reluctivity[between, None]
        return gradient[between], self.elements.grad(s.follows)[between], density

    @staticmethod
    def solved(matrix: sparse.csc_matrix, right: NDArray[Any]) -> NDArray[Any]:
        """Return the solution of a symmetric system."""
        options = {"SymmetricMode": True}
        # Column by column: panels, which are for denser factors, take twice as long here.
        factors = splu(matrix.tocsc(), "MMD_AT_PLUS_A", 0.0, relax=1, panel_size=1, options=options)
        return np.asarray(factors.solve(right))

    def _solution(self, a: Array, coenergy: float, gradient: Array) -> Solution:
        s = self.solver
        B = s.sense * (gradient[..., 1] - 1j * gradient[..., 0]) / self.radius
        g, strain, density = self._shell(gradient)
        forces = []
        for direction in s.layout.directions:
            d = np.array([direction.real, direction.imag])
            stress = (g * strain).sum(axis=2) * (g @ d) - 0.5 * (g**2).sum(axis=2) * (strain @ d)
            forces.append(float((density * stress).sum()))
        return Solution(a, np.array(forces), s.coils @ a, coenergy, np.asarray(B, complex))
