"""The response of a machine to its unbalance, over the speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Item, Line

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ambkit.machine.machine import Machine

SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)
AMPLITUDE = Axis("amplitude", "µm", 1e6)


def unbalance_response_figure(
    machine: Machine, speed: NDArray[np.float64], amplitude: NDArray[np.float64]
) -> Figure:
    """Show how far each axis moves."""
    # speed (n,) [rad/s]; amplitude (n, p) [m]
    names: dict[int, list[str]] = {}  # axes by the first of those that move alike
    for k, axis in enumerate(machine.axes):
        alike = (j for j in names if np.allclose(amplitude[:, j], amplitude[:, k], rtol=1e-3))
        names.setdefault(next(alike, k), []).append(axis.name)
    items: list[Item] = [
        Line(speed, amplitude[:, k], signal=f"series {n % 4 + 1}", label=" and ".join(axes))
        for n, (k, axes) in enumerate(names.items())
    ]
    least = min(axis.bearing.clearance for axis in machine.axes)
    if amplitude.max() > 0.2 * least:
        limit = speed[[0, -1]], 0 * speed[[0, -1]] + least
        items.append(Line(*limit, signal="limit", label="touch-down bearing"))
    return Figure(
        id="unbalance-response",
        title=f"Unbalance response of {markdown(machine.name)}",
        caption="Steady synchronous motion along each axis, of the linear rotor on its PIDs.",
        panels=[Panel(SPEED, AMPLITUDE, items)],
        panel_height=3.2,
    )
