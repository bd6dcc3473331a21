"""The Campbell diagram of a machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Item, Line

if TYPE_CHECKING:
    from numpy.typing import NDArray

SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)
FREQUENCY = Axis("frequency", "Hz", 1 / (2 * math.pi))
DAMPING = Axis("damping ratio")


def campbell_figure(
    machine: str,
    speed: NDArray[np.float64],
    poles: NDArray[np.complex128],
    whirl: Sequence[str],
) -> Figure:
    """Show frequencies and damping of a rotor's modes over its speed."""
    # speed (n,) [rad/s]; poles (n, modes) [1/s]
    line_styles = {"forward": "series 1", "backward": "series 2", "axial": "series 3"}
    frequencies: list[Item] = [
        Line(speed, poles[:, k].imag, signal=line_styles[way], label=way)
        for k, way in enumerate(whirl)
    ]
    near = speed <= 1.2 * poles.imag.max()
    frequencies.append(Line(speed[near], speed[near], signal="constant", label="speed of rotation"))
    damping: list[Item] = [
        Line(speed, -poles[:, k].real / np.abs(poles[:, k]), signal=line_styles[way], label=way)
        for k, way in enumerate(whirl)
    ]
    return Figure(
        id="campbell",
        title=f"Campbell diagram of {markdown(machine)}",
        caption="Modes of the rotor on its controllers; where a forward whirl meets the speed of "
        "rotation, unbalance excites it.",
        panels=[Panel(SPEED, FREQUENCY, frequencies), Panel(SPEED, DAMPING, damping)],
        panel_height=2.4,
    )
