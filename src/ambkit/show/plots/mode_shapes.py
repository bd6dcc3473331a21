"""Shapes of a rotor's bending modes along its shaft."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Item, Line, Points

Array = NDArray[np.float64]

PLACE = Axis("place along the shaft", "mm", 1e3)
SHAPE = Axis("shape", limits=(-1.15, 1.15))


def mode_shapes_figure(
    machine: str,
    modes: tuple[Array, Array],
    place: Array,
    shape: Array,
    magnets: Mapping[str, tuple[float, Array]],
    sensors: Mapping[str, tuple[float, Array]],
) -> Figure:
    """Show each mode's shape, with magnets and sensors where they are on it."""
    # place (n,) [m]; shape (n, modes) [1]
    panels = []
    ends = place[[0, -1]]
    for k, (frequency, ratio) in enumerate(zip(*modes, strict=True)):
        items: list[Item] = [
            Line(ends, np.zeros(2), signal="reference", label=""),
            Line(place, shape[:, k], signal="series 1", label="shape"),
        ]
        for signal, name, of in (
            ("series 2", "magnets", magnets), ("spike", "sensors", sensors),
        ):  # fmt: skip
            places = np.array([at for at, _ in of.values()])
            out = np.array([outs[k] for _, outs in of.values()])
            items.append(Points(places, out, signal=signal, label=name))
        hertz = engineering(frequency / (2 * math.pi), "Hz", 5)
        title = f"Mode {k + 1}: {hertz}, damping ratio {ratio:.2g}"
        panels.append(Panel(PLACE, SHAPE, items, title=title))
    return Figure(
        id="mode_shapes",
        title=f"Bending modes of {markdown(machine)}",
        caption="Of the free rotor at rest, each 1 where it is largest; a magnet or a sensor near "
        "the line in the middle is at a node, where it hardly moves or sees the mode.",
        panels=panels, columns=1 if len(panels) == 1 else 2, panel_height=2.0,
    )  # fmt: skip
