"""The LSM machine: k_i and k_s at operating points, from any force function (paper, eq. 26-31).

At each operating point the force is evaluated at nine points, one small step around it, and ``F =
k_i iu + k_s x`` is fitted **without an intercept**, on the absolute currents and displacements. k_i
and k_s are therefore no tangents: they give the force itself along the ray through the origin, and
the tangent across it. Tables 4 and 5 of the paper have these values.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.machine.axes import axis_of
from ambkit.machine.forces.patches import evaluated
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of, symmetric_current_limit

if TYPE_CHECKING:
    from ambkit._core import Table

ForceFunction = Callable[[Array, Array], ArrayLike]

CELLS = 120  #: Per side of the area over which forces are compared, evaluated at their centres.
# The nine points of eq. 27, in steps.
_STEP_CURRENT, _STEP_DISPLACEMENT = (g.ravel() for g in np.meshgrid([-1, 0, 1], [-1, 0, 1]))


@dataclass(frozen=True, eq=False)
class StiffnessMap:
    """Stiffnesses at a grid of operating points, and the force function they come from.

    Attributes
    ----------
    current : ndarray (ni,)
        Nodes of the control current [A], ascending (paper, Table 2).
    displacement : ndarray (nx,)
        Nodes of the rotor displacement [m], ascending (paper, Table 3).
    k_i, k_s : ndarray (nx, ni)
        Current stiffness [N/A] and position stiffness [N/m] (paper, Tables 4 and 5); rows are
        displacements, columns currents, as in the paper.
    residual : ndarray (nx, ni)
        RMS residual of the fit at the nine points [N] (e of eq. 29).
    force : callable
        Magnet force ``force(iu [A], x [m]) -> [N]`` on arrays of one shape.
    force_bias : float
        ``F(0, 0)`` [N], the static load of a one-sided magnet. The stiffnesses describe ``F - F(0,
        0)``.
    delta_current, delta_displacement : float
        Steps of the nine points [A], [m].
    name : str
        Origin of the force.
    """

    current: Array
    displacement: Array
    k_i: Array
    k_s: Array
    residual: Array
    force: ForceFunction = field(repr=False)
    force_bias: float
    delta_current: float
    delta_displacement: float
    name: str

    def __repr__(self) -> str:
        parts = (("k_i", self.k_i, "N/A"), ("k_s", self.k_s, "N/m"))
        ends = (f"{name} {of.min():.4g} to {of.max():.4g} {unit}" for name, of, unit in parts)
        return f"<StiffnessMap of {' x '.join(map(str, self.k_i.shape))}: {', '.join(ends)}>"

    def stiffness_at(self, iu: ArrayLike, x: ArrayLike) -> tuple[Array, Array]:
        """k_i [N/A] and k_s [N/m] by the LSM at any operating points, on nodes or between them.

        Both have the broadcast shape of `iu` and `x`.

        Parameters
        ----------
        iu, x : array_like
            Operating points [A], [m], with shapes that broadcast.
        """
        k_i, k_s, _ = local_stiffness(
            self.force,
            iu,
            x,
            delta_current=self.delta_current,
            delta_displacement=self.delta_displacement,
        )
        return k_i, k_s

    def force_rms(self, model: ForceFunction | None = None) -> float:
        """RMS difference of the force to that of a model, over the area of the grid [N].

        Parameters
        ----------
        model : callable, optional
            ``model(iu [A], x [m]) -> [N]``, such as :meth:`ambkit.Expert.force`. Default: the
            constant ``F(0, 0)``, which gives the RMS of the force itself.
        """
        # Rules of the paper's Table 6 are far narrower than a cell: they count by their area only.
        middle = (np.arange(CELLS) + 0.5) / CELLS
        iu, x = (
            grid.ravel()
            for grid in np.meshgrid(
                self.current[0] + middle * np.ptp(self.current),
                self.displacement[0] + middle * np.ptp(self.displacement),
            )
        )
        other = self.force_bias if model is None else np.asarray(model(iu, x), dtype=float)
        return float(np.sqrt(np.mean((evaluated(self.force, iu, x) - other) ** 2)))

    def in_core(self, core: ModuleType) -> Table:
        """Build the C implementation: bilinear between the nodes, constant outside.

        Parameters
        ----------
        core : module
            Build of the core, see `ambkit.machine.magnets.core_module`.

        Raises
        ------
        AmbkitError
            The nodes are not evenly spaced.
        """
        steps = []
        for name, nodes in (("current", self.current), ("displacement", self.displacement)):
            step = np.diff(nodes)
            if np.ptp(step) > 1e-9 * np.ptp(nodes):
                raise AmbkitError(
                    f"a table in C has evenly spaced nodes; the nodes of {name} are {step.min():g} "
                    f"to {step.max():g} apart"
                )
            steps.append(float(np.mean(step)))
        return core.Table(  # type: ignore[no-any-return]
            x_min=self.displacement[0], dx=steps[1], iu_min=self.current[0], diu=steps[0],
            k_i=self.k_i, k_s=self.k_s,
        )  # fmt: skip

    @property
    def fingerprint(self) -> str:
        """Sixteen hexadecimal digits, a hash of nodes and stiffnesses."""
        digest = hashlib.sha256()
        for array in (self.current, self.displacement, self.k_i, self.k_s):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:16]


def operating_points(machine: Machine) -> tuple[Array, Array]:
    """Return the nodes of the paper's 25 operating points (Tables 2 and 3), for any machine."""
    # Five control currents [A] over the range of the amplifier, and five displacements [m] over
    # half of the clearance in both directions.
    half_travel = machine.clearance / 2
    return (
        np.linspace(machine.current_min, machine.current_max, 5),
        np.linspace(-half_travel, half_travel, 5),
    )


def stiffness_map(
    machine: Machine,
    *,
    currents: ArrayLike | None = None,
    displacements: ArrayLike | None = None,
    delta_current: QuantityLike | None = None,
    delta_displacement: QuantityLike | None = None,
    force: ForceFunction | None = None,
) -> StiffnessMap:
    """Identify k_i and k_s over a grid of operating points (paper, eq. 26-31, Tables 2-5).

    Parameters
    ----------
    machine : Machine
        With one axis: provides the limits of the box and, by default, the force.
    currents : array_like (ni,), optional
        Nodes of the control current [A]. Default: those of `operating_points`.
    displacements : array_like (nx,), optional
        Nodes of the displacement [m]. Default: those of `operating_points`.
    delta_current, delta_displacement : float or str, optional
        Steps of the nine points [A], [m], such as ``"10 µm"``. Default: a hundredth of
        ``ambkit.machine.magnets.symmetric_current_limit``, on the paper's rig its 0.01 A and
        0.01 mm.
    force : callable, optional
        ``force(iu [A], x [m]) -> [N]`` on arrays of one shape, with the bias force: another law, or
        a table interpolated by SciPy. Default: the machine's magnet.

    Returns
    -------
    StiffnessMap
        For a one-sided magnet of ``F - F(0, 0)``.

    Raises
    ------
    AmbkitError
        Nodes are too few, not finite or not ascending; a step is not positive; a displacement is at
        or beyond the air gap; a force is not finite.
    """
    machine = axis_of(machine)
    usual_current, usual_displacement = operating_points(machine)
    ampere, metre = symmetric_current_limit(machine)
    delta_current = in_si("delta_current", delta_current, "A")
    delta_displacement = in_si("delta_displacement", delta_displacement, "m")
    delta_current = ampere / 100 if delta_current is None else delta_current
    delta_displacement = metre / 100 if delta_displacement is None else delta_displacement
    current = _nodes("currents", currents, usual_current, "A")
    displacement = _nodes("displacements", displacements, usual_displacement, "m")
    for name, delta, unit in (
        ("delta_current", delta_current, "A"),
        ("delta_displacement", delta_displacement, "m"),
    ):
        if not (np.isfinite(delta) and delta > 0):
            raise AmbkitError(f"{name} must be greater than 0 {unit}, is {delta!r}")
    name = machine.name
    if force is None:
        max_displacement = float(np.max(np.abs(displacement))) + delta_displacement
        gap = machine.magnet.air_gap
        if max_displacement >= gap:
            raise AmbkitError(
                f"displacements must stay within the air gap, {gap:g} m; the nine points of the "
                f"outermost node reach {max_displacement:g} m"
            )
        force = magnet_of(machine).force
    else:
        name = f"{name}, with its own force function"
    iu, x = np.meshgrid(current, displacement)
    k_i, k_s, residual = local_stiffness(
        force, iu, x, delta_current=delta_current, delta_displacement=delta_displacement
    )
    for array in (current, displacement, k_i, k_s, residual):
        array.flags.writeable = False
    return StiffnessMap(
        current=current,
        displacement=displacement,
        k_i=k_i,
        k_s=k_s,
        residual=residual,
        force=force,
        force_bias=_bias(force),
        delta_current=float(delta_current),
        delta_displacement=float(delta_displacement),
        name=name,
    )


def local_stiffness(
    force: ForceFunction,
    iu: ArrayLike,
    x: ArrayLike,
    *,
    delta_current: float = 0.01,
    delta_displacement: float = 1e-5,
) -> tuple[Array, Array, Array]:
    """Least squares at single operating points (paper, eq. 27-31)."""
    iu, x = np.broadcast_arrays(real("iu", iu), real("x", x))
    currents = iu[..., np.newaxis] + delta_current * _STEP_CURRENT
    displacements = x[..., np.newaxis] + delta_displacement * _STEP_DISPLACEMENT
    y = evaluated(force, currents, displacements) - _bias(force)
    # Scaled by the steps, both columns are of one size: A of eq. 28 in metres would mix 1 and 1e-4.
    # QR instead of (A'A)^-1 of eq. 31, which would square the condition number.
    a = np.stack([currents / delta_current, displacements / delta_displacement], axis=-1)
    q, r = np.linalg.qr(a)
    theta = np.linalg.solve(r, np.swapaxes(q, -1, -2) @ y[..., np.newaxis])
    residual = y - (a @ theta)[..., 0]
    k_i, k_s = theta[..., 0, 0] / delta_current, theta[..., 1, 0] / delta_displacement
    return k_i, k_s, np.sqrt(np.mean(residual**2, axis=-1))


def _bias(force: ForceFunction) -> float:
    origin = np.zeros(1)
    return float(evaluated(force, origin, origin)[0])


def _nodes(name: str, values: ArrayLike | None, usual: Array, unit: str) -> Array:
    """Return nodes, at least two finite, ascending numbers."""
    nodes = usual if values is None else np.array(values, dtype=float)
    if nodes.ndim != 1 or nodes.size < 2:
        raise AmbkitError(f"{name} must be a list of at least 2 nodes, has shape {nodes.shape}")
    if not np.all(np.isfinite(nodes)):
        raise AmbkitError(f"{name} must be finite, has {nodes[~np.isfinite(nodes)][0]} {unit}")
    descents = np.flatnonzero(np.diff(nodes) <= 0)
    if descents.size:
        before, after = nodes[descents[0]], nodes[descents[0] + 1]
        raise AmbkitError(f"{name} must ascend, has {before:g} {unit} before {after:g} {unit}")
    return nodes
