"""Figures of a magnet's solution: field, flux density along the gap, force map."""

from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.base.units import figure
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import FREQUENCIES, Dynamics, lag
from ambkit.machine.magnetostatics.field import FieldSolver, Solution
from ambkit.machine.magnetostatics.magnet_map import MagnetMap
from ambkit.result.report import Axis, Figure, Heatmap, Item, Line, Panel, Points

PIXELS = 300  #: Pixels along the longer side of the field plot.
FLUX_LINES = 24
QUARTERS = ([0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5])  #: Of a triangle of second order.
DENSITY = Axis("flux density", "T")


def field_figure(drawing: Drawing, solver: FieldSolver, field: Solution) -> Figure:
    """Plot the flux density with lines of flux and the outlines."""
    from matplotlib.tri import LinearTriInterpolator, Triangulation

    layout = drawing.layout
    nodes, triangles = solver.mesh.nodes, solver.mesh.triangles
    iron = np.concatenate([r.outline for r in layout.regions])
    low, high = (complex(f(iron.real), f(iron.imag)) for f in (np.min, np.max))
    margin = 0.05 * abs(high - low)
    low, high = low - (1 + 1j) * margin, high + (1 + 1j) * margin
    if layout.axisymmetric:
        low = 1j * low.imag
    size = high - low
    step = max(size.real, size.imag) / PIXELS
    x, y = np.arange(low.real, high.real, step), np.arange(low.imag, high.imag, step)
    small = np.concatenate([triangles[:, at] for at in QUARTERS])
    fine = Triangulation(nodes.real, nodes.imag, small)
    coarse = Triangulation(nodes.real, nodes.imag, triangles[:, :3])
    grid = np.meshgrid(x, y)
    at = np.asarray(coarse.get_trifinder()(*grid), dtype=np.intp)
    mean = np.abs(field.B).mean(axis=1)
    density = np.where(at >= 0, mean[at], 0.0)
    potential = LinearTriInterpolator(fine, field.a[: len(nodes)])(*grid).filled(0.0)
    if layout.axial is not None:  # with bias flux, from the rotor to the back iron
        places = grid[0] + 1j * grid[1]
        angle = np.angle(places * 1j**1.5) / (2 * np.pi)  # cut between two poles
        bent = (layout.axial.share(np.abs(places)) < 1) | (np.abs(angle) > 0.45)
        potential = np.ma.array(potential + field.a[-1] * angle, mask=bent)
    names = ("radius", "height") if layout.axisymmetric else ("x", "y")
    axes = [Axis(name, "mm", 1e3) for name in names]
    top = float(np.ceil(20 * np.quantile(mean[~solver.air], 0.99)) / 20)
    items: list[Item] = [
        Heatmap(x, y, np.minimum(density, top), Axis("flux density", "T", limits=(0.0, top)),
                lines=0)
    ]  # fmt: skip
    items += _flux_lines(x, y, potential)
    for region in layout.regions:
        loop = np.append(region.outline, region.outline[0])
        signal = "reference" if region.coil >= 0 else "measurement"
        items.append(Line(loop.real, loop.imag, signal=signal, label=""))
    bias = drawing.winding.bias_current
    currents = "" if bias is None else f"{figure(bias, 'A')} bias and "
    currents += f"{figure(drawing.limit, 'A')} control current"
    return Figure(
        id="field", title=f"Field of {markdown(drawing.name)}",
        caption=f"Flux density and lines of flux at {currents}.",
        panels=[Panel(axes[0], axes[1], items, equal=True)],
        panel_height=min(7.0, max(3.0, 5.0 * size.imag / size.real)),
    )  # fmt: skip


def _flux_lines(x: Array, y: Array, potential: Array) -> list[Item]:
    from contourpy import contour_generator

    generator: Any = contour_generator(x, y, potential)
    levels = np.linspace(float(potential.min()), float(potential.max()), FLUX_LINES + 2)[1:-1]
    return [
        Line(line[::2, 0], line[::2, 1], signal="measured", label="")
        for level in levels
        for line in generator.lines(float(level))
        if len(line) > 8
    ]


def gap_figure(
    drawing: Drawing, solver: FieldSolver, bias_field: Solution, field: Solution
) -> Figure:
    """Plot the flux density along the gap, at bias and at maximum current."""
    layout = drawing.layout
    chosen = solver.in_gap
    places = solver.at().elements.places[chosen].mean(axis=1)
    if layout.axisymmetric and layout.bias.size > 1:  # for two gaps, where the currents add
        chosen, places = chosen[places.imag > 0], places[places.imag > 0]
    if len(layout.directions) > 1:
        along, axis = np.angle(places), Axis("angle", "deg", 180 / np.pi)
    elif layout.axisymmetric:
        along, axis = places.real, Axis("radius", "mm", 1e3)
    else:
        along, axis = places.imag, Axis("place along the gap", "mm", 1e3)
    items: list[Item] = [
        Points(along, np.abs(of.B[chosen]).mean(axis=1), signal=signal, label=name)
        for of, signal, name in (
            (bias_field, "place", "bias current"),
            (field, "mode", "greatest control current"),
        )
    ]
    return Figure(
        id="gap", title=f"Flux density in the gap of {markdown(drawing.name)}",
        caption="Mean of each triangle between stator and rotor.",
        panels=[Panel(axis, DENSITY, items)], panel_height=2.6,
    )  # fmt: skip


def map_figure(name: str, m: MagnetMap) -> Figure:
    """Plot the force over current and displacement."""
    iu, x = (np.linspace(axis[0], axis[-1], 61) for axis in (m.current, m.displacement))
    force = m.force_at(*np.meshgrid(iu, x))
    return Figure(
        id="map", title=f"Force of {markdown(name)}",
        caption="By control current and displacement, as the splines of the map have it.",
        panels=[Panel(
            Axis("control current", "A"), Axis("displacement", "mm", 1e3),
            [Heatmap(iu, x, force, Axis("force", "N"), diverging=m.two_sided)],
        )],
        panel_height=3.2,
    )  # fmt: skip


def dynamics_figure(name: str, dynamics: Dynamics) -> Figure:
    """Plot the current stiffness over frequency with eddy currents, and the fitted lag."""
    stiffness, corner = dynamics.stiffness, dynamics.corner
    fine = np.geomspace(FREQUENCIES[0], FREQUENCIES[-1], 121)
    fitted = lag(fine, corner, dynamics.order)
    order = "first" if dynamics.laminated else "half"
    label = f"{order} order, corner {figure(corner, 'Hz')}"
    frequency = Axis("frequency", "Hz", scale="log")
    amplitude, phase = Axis("amplitude", scale="log"), Axis("phase", "deg", 180 / np.pi)
    panels = [
        Panel(frequency, axis, [
            Line(fine, part(fitted), signal="series 1", label=label),
            Points(FREQUENCIES, part(stiffness), signal="series 2", label="finite elements"),
        ])
        for axis, part in ((amplitude, np.abs), (phase, np.angle))
    ]  # fmt: skip
    return Figure(
        id="eddy_currents", title=f"Eddy currents of {markdown(name)}",
        caption="Current stiffness in parts of that at rest.", panels=panels,
    )  # fmt: skip
