"""Eddy currents and losses in iron: force and flux linkage over frequency, and the fitted lag.

Small changes about the bias field: (K + j w M) a = currents, with the tangent stiffness K of the
magnetostatic field and the conductivity matrix M of solid iron in a body of revolution. Solid poles
give ``1 / (1 + sqrt(s / corner))`` (Zhu, Knospe and Maslen, Analytic model for a nonlaminated
cylindrical magnetic actuator including eddy currents, IEEE Trans. Magn. 41, 2005). In sheets of
thickness d the reluctivity increases by ``z coth z``, ``z = (1 + j) d / (2 depth)``, with the skin
depth (Stoll, The Analysis of Eddy Currents, 1974), approximately ``1 / (1 + s / corner)``.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.progress import progress
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.field import FieldSolver, Skin
from ambkit.machine.magnetostatics.iron import Curve
from ambkit.machine.magnetostatics.magnet_map import VERSION, kept

FREQUENCIES = np.geomspace(1.0, 1000.0, 7)  #: Frequencies of the fit [Hz].
IN_SKIN = 1.5  #: Length of edges at the iron's surface, in skin depths at the highest frequency.


REPORTED = {100: 4, 1000: 6}  #: Frequencies of the reported losses [Hz], by index.
DENSITY = 7650.0  #: Density of iron [kg/m^3].


class Dynamics(NamedTuple):
    """Small-signal response to the control current at `FREQUENCIES`."""

    stiffness: NDArray[np.complex128]  #: Force, over the static one.
    flux: NDArray[np.complex128]  #: Flux linkage [H].
    hysteresis: Array  #: Loss [W/A^2].
    laminated: bool

    @property
    def order(self) -> float:
        """Order of the lag."""
        return 1.0 if self.laminated else 0.5

    @property
    def corner(self) -> float:
        """Corner frequency of the best lag [Hz]."""
        return fitted_corner(FREQUENCIES, self.stiffness, self.order)

    @property
    def eddy_loss(self) -> Array:
        """Eddy current loss (n,) [W/A^2], per squared current amplitude."""
        return np.asarray(-np.pi * FREQUENCIES * self.flux.imag)


def conducts(drawing: Drawing) -> bool:
    """Whether a drawing's iron has modelled eddy currents: in the section, or in sheets."""
    curves = [r.iron for r in drawing.layout.regions if r.iron is not None]
    circles = drawing.layout.axisymmetric
    return any(curve.conductivity and (circles or curve.lamination) for curve in curves)


def _skin(omega: float) -> Skin:
    """Return the dynamic over the static reluctivity of sheets at an angular frequency."""

    def factor(curve: Curve, slope: Array) -> NDArray[np.complex128]:
        if not curve.lamination or omega == 0:
            return np.ones(slope.shape, complex)
        z = (1 + 1j) * 0.5 * curve.lamination * np.sqrt(0.5 * omega * curve.conductivity / slope)
        return np.asarray(z / np.tanh(z))

    return factor


def dynamic_stiffness(
    drawing: Drawing, frequencies: Array = FREQUENCIES, fineness: float = 1.0
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], Array]:
    """Return force over the static one, flux linkage and hysteresis loss, as in `Dynamics`."""
    layout = drawing.layout
    curves = [r.iron for r in layout.regions if r.iron is not None and r.iron.conductivity]
    solid = [curve for curve in curves if not curve.lamination]
    omega = 2 * np.pi * frequencies
    skin = None
    if solid:
        rise = np.array([curve.at(np.linspace(0.05, 1.0, 20))[1].min() for curve in solid])
        conductivity = np.array([curve.conductivity for curve in solid])
        depth = np.sqrt(2 * rise / (omega.max() * conductivity)).min()
        skin = IN_SKIN * float(depth) / fineness
    solver = FieldSolver(layout, 1.0, skin)
    position = solver.at()
    base = position.solve(drawing.bias_current * layout.bias)
    e, volume = position.elements, position.volume
    sigma, hysteresis = np.zeros(len(e.triangles)), np.zeros(len(e.triangles))
    for curve, at in solver.iron:
        sigma[at] = 0.0 if curve.lamination else curve.conductivity
        hysteresis[at] = DENSITY * curve.hysteresis * curve.stacking / (50 * 1.5**2)
    density = solver.length * sigma[:, None] * e.weight / position.radius
    mass = e.matrix(np.einsum("mq,qa,qb->mab", density, e.N, e.N, optimize=True))
    free, source = solver.free, layout.control[0] @ solver.coils
    sides = 2 if layout.opposed else 1
    solved, loss = [], []
    for w in (0.0, *omega):
        tangent, force = position.tangent(base.a, _skin(w))
        matrix = (tangent + 1j * w * mass).tocsc()[free][:, free]
        a = np.zeros(e.count, complex)
        a[free] = position.solved(matrix, source[free].astype(complex))
        squares = (np.abs(e.grad(a)) ** 2).sum(axis=2) / position.radius**2
        solved.append([force @ a, sides * source @ a])
        loss.append(sides * w / (2 * np.pi) * float((hysteresis[:, None] * volume * squares).sum()))
    pulled, flux = np.array(solved, dtype=np.complex128).T
    return pulled[1:] / pulled[0], flux[1:], np.array(loss[1:])


def dynamics_of(drawing: Drawing) -> Dynamics:
    """Return the dynamics at `FREQUENCIES`, cached."""

    def solve() -> tuple[Array, ...]:
        with progress("solving the eddy currents"):
            stiffness, flux, loss = dynamic_stiffness(drawing, FREQUENCIES, 0.5)
        return stiffness.real, stiffness.imag, flux.real, flux.imag, loss

    parts = kept(drawing.key("dynamics", drawing.bias_current, VERSION), solve)
    curves = [r.iron for r in drawing.layout.regions if r.iron is not None and r.iron.conductivity]
    laminated = all(curve.lamination for curve in curves)
    return Dynamics(parts[0] + 1j * parts[1], parts[2] + 1j * parts[3], parts[4], laminated)


def lag(frequencies: Array, corner: float, order: float = 0.5) -> NDArray[np.complex128]:
    """Return ``1 / (1 + (j f / corner)^order)``, all in hertz."""
    return np.asarray(1 / (1 + (1j * frequencies / corner) ** order))


def fitted_corner(
    frequencies: Array, stiffness: NDArray[np.complex128], order: float = 0.5
) -> float:
    """Return the corner frequency [Hz] of the lag closest to a dynamic stiffness."""
    from scipy.optimize import minimize_scalar  # not imported by a simulation

    def off(log_corner: float) -> float:
        ratio = stiffness / lag(frequencies, float(np.exp(log_corner)), order)
        return float(np.sum(np.abs(np.log(ratio)) ** 2))

    ends = np.log([1e-3 * frequencies[0], 1e4 * frequencies[-1]])
    return float(np.exp(minimize_scalar(off, bounds=tuple(ends), method="bounded").x))
