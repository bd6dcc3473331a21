"""Eddy currents in solid iron: the force over frequency, and the half order that follows it.

Small changes about the bias field of a body of revolution: (K + j w M) a = currents, with the
tangent stiffness K of the magnetostatic field and the conductivity matrix M. Solid poles make
``1 / (1 + sqrt(s / corner))`` of it (Zhu, Knospe and Maslen, Analytic model for a nonlaminated
cylindrical magnetic actuator including eddy currents, IEEE Trans. Magn. 41, 2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.sparse.linalg import splu

from ambkit.base.arrays import Array
from ambkit.base.progress import progress
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.elements import N
from ambkit.machine.magnetostatics.field import FieldSolver
from ambkit.machine.magnetostatics.magnet_map import VERSION, kept

FREQUENCIES = np.geomspace(1.0, 1000.0, 7)
"""Of the fit [Hz]."""

IN_SKIN = 1.5  #: Length of edges at the surface of iron, in skin depths at the highest frequency.


def conducts(drawing: Drawing) -> bool:
    """Whether eddy currents flow in circles in a drawing's iron."""
    curves = [r.iron for r in drawing.layout.regions if r.iron is not None]
    return drawing.layout.axisymmetric and any(curve.conductivity for curve in curves)


def dynamic_stiffness(
    drawing: Drawing, frequencies: Array = FREQUENCIES, fineness: float = 1.0
) -> NDArray[np.complex128]:
    """Return the current stiffness at frequencies (n,) [Hz], in parts of that at rest."""
    layout = drawing.layout
    curves = [r.iron for r in layout.regions if r.iron is not None and r.iron.conductivity]
    omega = 2 * np.pi * frequencies
    rise = np.array([curve.at(np.linspace(0.05, 1.0, 20))[1].min() for curve in curves])
    depth = np.sqrt(2 * rise / (omega.max() * np.array([c.conductivity for c in curves]))).min()
    solver = FieldSolver(layout, 1.0, IN_SKIN * float(depth) / fineness)
    position = solver.at()
    base = position.solve(drawing.winding.bias_current * layout.bias)
    stiffness, force = position.tangent(base.a)
    e = position.elements
    sigma = np.zeros(len(e.triangles))
    for curve, at in solver.iron:
        sigma[at] = curve.conductivity
    density = solver.length * sigma[:, None] * e.weight / position.radius
    mass = e.matrix(np.einsum("mq,qa,qb->mab", density, N, N, optimize=True))
    free = solver.free
    K, M = (matrix.tocsc()[free][:, free] for matrix in (stiffness, mass))
    source = (layout.control[0] @ solver.coils)[free]
    response = [
        force[free] @ splu((K + 1j * w * M).tocsc(), "MMD_AT_PLUS_A").solve(source.astype(complex))
        for w in (0.0, *omega)
    ]
    return np.asarray(np.array(response[1:]) / response[0], dtype=np.complex128)


def dynamics_of(drawing: Drawing) -> tuple[NDArray[np.complex128], float]:
    """Return the dynamic stiffness at `FREQUENCIES` and its corner [Hz], solved once."""

    def solve() -> tuple[Array, ...]:
        with progress("solving the eddy currents"):
            ratio = dynamic_stiffness(drawing, FREQUENCIES, 0.5)
        return ratio.real, ratio.imag

    real, imag = kept(drawing.key("dynamics", drawing.winding.bias_current, VERSION), solve)
    return real + 1j * imag, fitted_corner(FREQUENCIES, real + 1j * imag)


def half_order(frequencies: Array, corner: float) -> NDArray[np.complex128]:
    """Return ``1 / (1 + sqrt(j f / corner))``, all in hertz."""
    return np.asarray(1 / (1 + np.sqrt(1j * frequencies / corner)))


def fitted_corner(frequencies: Array, stiffness: NDArray[np.complex128]) -> float:
    """Return the corner [Hz] whose half order is nearest to a dynamic stiffness."""

    def off(log_corner: float) -> float:
        ratio = stiffness / half_order(frequencies, float(np.exp(log_corner)))
        return float(np.sum(np.abs(np.log(ratio)) ** 2))

    ends = np.log([1e-3 * frequencies[0], 1e3 * frequencies[-1]])
    return float(np.exp(minimize_scalar(off, bounds=tuple(ends), method="bounded").x))
