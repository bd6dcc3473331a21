"""Homopolar radial bearing: two planes of poles of opposite polarity, with a bias between them.

The field is three-dimensional. It is modelled by the section of one plane: the bias flux enters the
rotor axially, uniformly over the iron, and leaves through the back iron likewise. Both planes, the
magnet or bias coil and the rotor's iron between the planes form one magnetic circuit, solved
together with the section. Neglected: leakage between the planes and around their ends, the
reluctance of the stator's iron between them, and saturation by the axial flux within a plane.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.geometries.geometry import PermanentMagnet, Windings
from ambkit.machine.magnetostatics.geometries.radial import OPPOSITE, Pole, Ring
from ambkit.machine.magnetostatics.layout import AxialCircuit, Layout, Region, circle


class Homopolar(Ring):
    """Two equal planes with four poles each, biased by a permanent magnet or a coil."""

    type: Literal["homopolar"] = "homopolar"
    plane_distance: Annotated[float, Quantity("m", "25 mm", above=0)]
    """Distance between the stacks of the two planes [m]."""
    magnet: PermanentMagnet | None = None
    """The magnets between the planes, magnetised along the axis; or bias_turns."""
    magnet_area: Annotated[float, Quantity("m^2", "600 mm^2", above=0)] | None = None
    """Total cross section of the magnets [m^2]."""
    bias_turns: Annotated[int, Field(gt=0, le=1_000_000, strict=True)] | None = None
    """Turns of the bias coil around the axis, which carries the bias current."""

    @classmethod
    def places(cls, read: Read) -> list[Pole]:
        return [Pole(n * math.pi / 2, 1, read("pole_width"), n) for n in range(4)]

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from super()._contradictions(read)
        if (read("magnet") is None) == (read("bias_turns") is None):
            yield "magnet", "the bias is made by one of magnet and bias_turns"
        if (read("magnet") is None) != (read("magnet_area") is None):
            yield "magnet_area", "goes with magnet"

    def magnet_constant(self, turns: float) -> float:
        return MU_0 * turns**2 * self.pole_width * self.stack_length

    def ideal_bias(self, windings: Windings) -> float:
        if self.magnet is None:
            mmf, series = (self.bias_turns or 0) * windings.bias_current, 0.0
        else:
            mmf, series = self.magnet.mmf, self.magnet.reluctance(self.magnet_area or math.nan)
        gap = self.air_gap / (MU_0 * 4 * self.pole_width * self.stack_length)  # of one plane
        return mmf / (2 + series / gap) / windings.turns

    def layout(self, windings: Windings) -> Layout:
        regions, circles = self._ring(windings)
        shaft, rotor, _, root, outer, around = (radius for _, radius in circles)
        area = math.pi * (rotor**2 - shaft**2)
        magnet, bias, control = self.magnet, np.zeros(4), OPPOSITE
        mmf = reluctance = 0.0
        if magnet is None:
            bias = np.append(bias, windings.bias_current / self.ideal_bias(windings))
            control = np.hstack([control, np.zeros((2, 1))])
        else:
            mmf, reluctance = magnet.mmf, magnet.reluctance(self.magnet_area or math.nan)
        axial = AxialCircuit((shaft, rotor), (root, outer), self.stack_length, mmf, reluctance,
                             windings.rotor_iron, area, self.plane_distance + self.stack_length,
                             self.bias_turns or 0)  # fmt: skip
        return Layout(Region(circle(around), "geometry"), regions, (1.0, 1j), bias, control,
                      2 * self.stack_length, circles, axial=axial)  # fmt: skip
