"""Shapes of a rotor's bending modes along its shaft."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Item, Line, Points

if TYPE_CHECKING:
    from ambkit.workflow.mode_shapes import ModeShapes

PLACE = Axis("place along the shaft", "mm", 1e3)
SHAPE = Axis("shape", limits=(-1.15, 1.15))


def mode_shapes_figure(modes: ModeShapes) -> Figure:
    """Show each mode's shape, with magnets and sensors where they are on it.

    Parameters
    ----------
    modes : ModeShapes
        Of a machine.
    """
    panels = []
    ends = np.array([modes.place[0], modes.place[-1]])
    for k, frequency in enumerate(modes.frequency):
        items: list[Item] = [
            Line(ends, np.zeros(2), signal="reference", label=""),
            Line(modes.place, modes.shape[:, k], signal="series 1", label="shape"),
        ]
        for signal, name, of in (
            ("series 2", "magnets", modes.magnets), ("spike", "sensors", modes.sensors),
        ):  # fmt: skip
            places = np.array([at for at, _ in of.values()])
            out = np.array([shape[k] for _, shape in of.values()])
            items.append(Points(places, out, signal=signal, label=name))
        hertz = engineering(frequency / (2 * math.pi), "Hz", 5)
        title = f"Mode {k + 1}: {hertz}, damping ratio {modes.damping_ratio[k]:.2g}"
        panels.append(Panel(PLACE, SHAPE, items, title=title))
    return Figure(
        id="mode_shapes",
        title=f"Bending modes of {markdown(modes.machine)}",
        caption="Of the free rotor at rest, each 1 where it is largest; a magnet or a sensor near "
        "the line in the middle is at a node, where it hardly moves or sees the mode.",
        panels=panels, columns=1 if len(panels) == 1 else 2, panel_height=2.0,
    )  # fmt: skip
