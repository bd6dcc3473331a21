"""Results of a magnet's drawing: stiffnesses, limits, errors of the force laws."""

from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.progress import progress
from ambkit.base.units import figure
from ambkit.machine.forces.drawing import points_of
from ambkit.machine.forces.fitted_law import LawError, law_errors, preferred
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.magnet_solution.figures import (
    dynamics_figure,
    field_figure,
    gap_figure,
    map_figure,
)
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import (
    REPORTED,
    Dynamics,
    conducts,
    dynamics_of,
)
from ambkit.machine.magnetostatics.field import FieldSolver, Solution
from ambkit.machine.magnetostatics.magnet_map import (
    POINTS,
    MagnetMap,
    TwoAxisMap,
    map_of,
    two_axis_map,
)
from ambkit.result.report import Axis, Figure, Heatmap, Panel
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

SECTION = ("both axes",)
PLACES = {"centre": 0.0, "half of the ranges": 0.5}
"""Operating points of the stiffnesses, over the maximum current and displacement."""


def both_axes_rows(m: TwoAxisMap) -> list[Row]:
    """Return direct and cross stiffnesses, inductances, and the coupling of the axes."""
    rows: list[Row] = []
    for of, share in PLACES.items():
        place = share * m.ranges
        (k_i, k_s), linked = m.stiffness_at(place), m.linkages_at(place)
        change = 1e-4 * m.ranges[0] * np.eye(4)[0]
        slope = (m.linkages_at(place + change) - m.linkages_at(place - change)) / (2 * change[0])
        values = [
            Row("k_ixx", "k_i, along x by current of x", float(k_i[0, 0]), "N/A"),
            Row("k_ixy", "k_i, along x by current of y", float(k_i[0, 1]), "N/A"),
            Row("k_sxx", "k_s, along x by displacement along x", float(k_s[0, 0]), "N/m"),
            Row("k_sxy", "k_s, along x by displacement along y", float(k_s[0, 1]), "N/m"),
            *(Row(f"flux_linkage_{key}", f"flux linkage of the coils at {side}", float(value), "Wb")
              for key, side, value in zip(("px", "py", "mx", "my"), ("+x", "+y", "-x", "-y"),
                                          linked, strict=True)),
            Row("inductance_xx", "inductance, +x by current of x", float(slope[0]), "H"),
            Row("inductance_yx", "inductance, +y by current of x", float(slope[1]), "H"),
        ]  # fmt: skip
        rows += put(values, section=SECTION, of=of)
    rows += put([Row("coupling_force", "greatest change of a force by the other axis", m.coupling,
                     "N")], section=("magnet",))  # fmt: skip
    error = Row(
        "both_axes_error", f"error of both axes, beside {POINTS} points fitted", m.error, "N"
    )
    return rows + put([error], section=("solution",))


_ALONG = np.array([1.0, 0.0, 1.0, 0.0])[:, None]


def both_axes_figure(name: str, m: TwoAxisMap) -> Figure:
    """Plot the change of the force along x by current and displacement of y."""
    i, y = (r * np.linspace(-1, 1, 61) for r in (m.ranges[1], m.ranges[3]))
    other = np.stack(np.meshgrid(i, y))
    panels = []
    for share in (0.5, 1.0):
        along = share * m.ranges[:, None, None] * np.ones_like(other[:1])
        place = np.stack([along[0], other[0], along[2], other[1]])
        change = m.force_at(place)[0] - m.force_at(place * _ALONG[:, None])[0]
        panels.append(Panel(
            Axis("control current of y", "A"), Axis("displacement along y", "mm", 1e3),
            [Heatmap(i, y, change, Axis("change of the force along x", "N"), diverging=True)],
            title=f"current and displacement of x at {share:.0%} of their range",
        ))  # fmt: skip
    return Figure(
        id="both_axes", title=f"Coupling of the axes of {markdown(name)}",
        caption="Change of the force along x by current and displacement of y.",
        panels=panels, panel_height=2.8,
    )  # fmt: skip


STEP = 1e-3  #: Step of currents and displacements for derivatives, over their range.


@dataclass(frozen=True, eq=False, repr=False)
class MagnetSolution(Result):
    """The force map of a magnet from its drawing, and the field at maximum current."""

    drawing: Drawing
    map: MagnetMap
    solver: FieldSolver
    field: Solution  #: With bias and maximum control current, rotor centred.
    bias_field: Solution  #: With the bias current alone.
    coupling: float | None  #: Force across over force along, with the rotor displaced across.
    laws: list[LawError]
    dynamics: Dynamics | None = None
    both_axes: TwoAxisMap | None = None

    TITLE = "Magnet {0.drawing.name}"
    SECTIONS = {
        ("stiffness",): Section("Stiffness in the centre", across=True),
        ("magnet",): Section("Magnet"),
        SECTION: Section("Both axes"),
        ("laws",): Section("Errors of force laws at points left out", across=True),
        ("solution",): Section("Solution"),
    }

    @cached_property
    def stiffness(self) -> tuple[float, float]:
        """k_i [N/A] and k_s [N/m] with the rotor centred."""
        iu, x = STEP * self.map.current[-1], STEP * self.map.displacement[-1]
        at = self.map.force_at([iu, -iu, 0, 0], [0, 0, x, -x])
        return float(at[0] - at[1]) / (2 * iu), float(at[2] - at[3]) / (2 * x)

    @cached_property
    def inductance(self) -> float:
        """Inductance of the coils of one side, rotor centred [H]."""
        iu = STEP * self.map.current[-1]
        low, high = self.map.flux_at([-iu, iu], 0.0).tolist()
        rise: float = (high - low) / (2 * iu)
        return rise / 2 if self.map.two_sided else rise

    @property
    def finding(self) -> str:
        k_i, k_s = self.stiffness
        return (
            f"{self.title}: k_i {figure(k_i, 'N/A')}, k_s {figure(k_s, 'N/m')}, load capacity "
            f"{figure(float(self.field.force[0]), 'N')}."
        )

    @property
    def rows(self) -> list[Row]:
        d, w = self.drawing, self.drawing.winding
        sides = 4 if self.map.two_sided else 2
        ideal = sides * d.magnet_constant * d.bias_current / d.geometry.air_gap**2
        both = {
            "finite elements": self.stiffness,
            "ideal iron": (ideal, ideal * d.bias_current / d.geometry.air_gap),
        }
        results = []
        for of, (k_i, k_s) in both.items():
            stiff = [Row("k_i", "current stiffness", k_i, "N/A"),
                     Row("k_s", "position stiffness", k_s, "N/m")]  # fmt: skip
            results += put(stiff, section=("stiffness",), of=of)
        gap = self.solver.in_gap
        area = self.solver.at().elements.weight[gap]
        iron = ~np.isin(np.arange(len(self.solver.mesh.region)), self.solver.linear)
        one = [
            Row("load_capacity", "force at the greatest current", float(self.field.force[0]), "N"),
            Row("bias_flux_density", "mean flux density in the gap at the bias current",
                float(np.average(np.abs(self.bias_field.B[gap]), weights=area)), "T"),
            Row("peak_flux_density", "in the iron at the greatest current, 99th percentile",
                float(np.quantile(np.abs(self.field.B[iron]), 0.99)), "T"),
            Row("inductance", "inductance of one side", self.inductance, "H"),
        ]  # fmt: skip
        if w.voltage is not None:
            slew = self.stiffness[0] * w.voltage / self.inductance
            one.append(Row("slew_rate", "slew rate of the force", slew, "N/s"))
        if self.coupling is not None:
            one.append(
                Row("coupling", "force across, the rotor displaced across", self.coupling, "%")
            )
        if self.dynamics is not None:
            one += _rows_of(self.dynamics)
        results += put(one, section=("magnet",))
        best = preferred(self.laws)
        for law in self.laws:
            errors = [Row("largest", "largest", law.largest, "N"), Row("rms", "rms", law.rms, "N"),
                      Row("mark", "", "taken" if law is best else "")]  # fmt: skip
            results += put(errors, section=("laws",), of=law.name)
        largest = float(np.abs(self.map.force).max())
        results += put([
            Row("error", "error between points, of the greatest force",
                self.laws[-1].largest / largest, "%"),
            Row("inconsistency", "field beside one energy, of the greatest",
                self.map.inconsistency, "%"),
            Row("points", "points of the map", len(self.map)),
            Row("triangles", "triangles", len(self.solver.mesh.triangles)),
        ], section=("solution",))  # fmt: skip
        return results + (both_axes_rows(self.both_axes) if self.both_axes is not None else [])

    @property
    def notes(self) -> list[str]:
        notes = []
        if not self.drawing.layout.axisymmetric and self.drawing.end_factor == 1.0:
            notes.append("The section is plane: flux around the ends of the stack is left out "
                         "(end_factor).")  # fmt: skip
        if self.drawing.layout.axial is not None:
            notes.append("One plane's section is solved with the magnetic circuit along the axis; "
                         "leakage between the planes is left out.")  # fmt: skip
        if self.drawing.layout.opposed:
            notes.append("The fields of the two cores are independent.")
        return notes

    @property
    def series(self) -> dict[str, Any]:
        m = self.map
        return {"name": self.drawing.name, "iu": m.current, "x": m.displacement,
                "f_mag": m.force, "flux_linkage": m.flux}  # fmt: skip

    def file(self) -> ForcePoints:
        return points_of(self.map)

    def figures(self) -> list[Figure]:
        drawing, solver = self.drawing, self.solver
        more = [] if self.dynamics is None else [dynamics_figure(drawing.name, self.dynamics)]
        if self.both_axes is not None:
            more.append(both_axes_figure(drawing.name, self.both_axes))
        return [
            field_figure(drawing, solver, self.field),
            gap_figure(drawing, solver, self.bias_field, self.field),
            map_figure(drawing.name, self.map),
            *more,
        ]


def solve(drawing: Drawing, both_axes: bool = False) -> MagnetSolution:
    """Solve a drawing."""
    layout, bias_current = drawing.layout, drawing.bias_current
    if both_axes and len(layout.directions) < 2:
        raise AmbkitError(f"both_axes: a {drawing.geometry.type} magnet has one axis")
    solved = map_of(drawing)
    with progress("solving the fields of the pictures"):
        solver = FieldSolver(layout)
        bias = solver.at().solve(bias_current * layout.bias)
        most = bias_current * layout.bias + drawing.limit * layout.control[0]
        full = solver.at().solve(most, bias.a)
        if layout.opposed:  # the force of the opposite core, at its reduced current
            less = solver.at().solve((bias_current - drawing.limit) * layout.bias, bias.a)
            full = full._replace(force=full.force - less.force)
        coupling = _coupling(drawing, solver, full)
    about = SimpleNamespace(
        type=drawing.geometry.sides, bias_current=bias_current,
        magnet_constant=drawing.magnet_constant, air_gap=drawing.geometry.air_gap,
    )  # fmt: skip
    errors = law_errors(about, solved)
    dynamics = dynamics_of(drawing) if conducts(drawing) else None
    axes = two_axis_map(drawing) if both_axes else None
    return MagnetSolution(drawing, solved, solver, full, bias, coupling, errors, dynamics, axes)


def _rows_of(dynamics: Dynamics) -> list[Row]:
    """Return the lag of the force and the losses."""
    corner = dynamics.corner
    rows = [
        Row("eddy_current_lag", "lag by eddy currents in sheets", 1 / (2 * np.pi * corner), "s")
        if dynamics.laminated
        else Row("eddy_current_corner", "corner of the eddy currents", corner, "Hz")
    ]
    for frequency, at in REPORTED.items():
        of = f"of 1 A of control current at {figure(float(frequency), 'Hz')}"
        losses = {"eddy_current": dynamics.eddy_loss, "hysteresis": dynamics.hysteresis}
        for key, loss in losses.items():
            if loss[at] > 0:
                name = f"{key.replace('_', '-')} loss {of}"
                rows.append(Row(f"{key}_loss_{frequency}", name, float(loss[at]), "W"))
    return rows


def _coupling(drawing: Drawing, solver: FieldSolver, full: Solution) -> float | None:
    """Return the effect of a displacement across on the force at maximum current."""
    layout, bias_current = drawing.layout, drawing.bias_current
    if len(layout.directions) < 2:
        return None
    there = solver.at(drawing.displacement_range * layout.directions[1])
    currents: list[Array] = [bias_current * layout.bias + iu * layout.control[0]
                             for iu in (0.0, drawing.limit)]  # fmt: skip
    across = [there.solve(current).force[1] for current in currents]
    return float((across[1] - across[0]) / full.force[0])
