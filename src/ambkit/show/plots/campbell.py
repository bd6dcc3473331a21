"""The Campbell diagram of a whole machine."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.show.report.figure import Figure, Panel
from ambkit.show.report.items import Axis, Item, Line

if TYPE_CHECKING:
    from numpy.typing import NDArray

SPEED = Axis("speed of rotation", "rpm", 30 / math.pi)
FREQUENCY = Axis("frequency", "Hz", 1 / (2 * math.pi))
DAMPING = Axis("damping ratio")


def campbell_figure(
    machine: str,
    speed: NDArray[np.float64],
    poles: NDArray[np.complex128],
    forwards: NDArray[np.bool_],
) -> Figure:
    """Show frequencies and damping of a rotor's modes over its speed.

    Parameters
    ----------
    machine : str
        Its name.
    speed : ndarray (n,)
        Speeds of rotation [rad/s].
    poles : ndarray of complex (n, modes)
        Each mode's pole [1/s].
    forwards : ndarray of bool (modes,)
        Whether it whirls with the rotation.
    """
    looks = {True: ("series 1", "forwards"), False: ("series 2", "backwards")}
    frequencies: list[Item] = [
        Line(speed, poles[:, k].imag, signal=signal, label=name)
        for k, ahead in enumerate(forwards.tolist())
        for signal, name in (looks[ahead],)
    ]
    near = speed <= 1.2 * poles.imag.max()
    frequencies.append(Line(speed[near], speed[near], signal="constant", label="speed of rotation"))
    damping: list[Item] = [
        Line(speed, -poles[:, k].real / np.abs(poles[:, k]), signal=signal, label=name)
        for k, ahead in enumerate(forwards.tolist())
        for signal, name in (looks[ahead],)
    ]
    return Figure(
        id="campbell",
        title=f"Campbell diagram of {markdown(machine)}",
        caption="Modes of the rotor on its controllers; where a whirl forwards meets the speed of "
        "rotation, unbalance excites it.",
        panels=[Panel(SPEED, FREQUENCY, frequencies), Panel(SPEED, DAMPING, damping)],
        panel_height=2.4,
    )
