"""Heteropolar radial bearing with permanent magnets in separate poles.

The magnets drive the bias flux in through their four poles and out through the four on the axes.
Coils of opposite poles, in series, increase it on one side and decrease it on the other. Their flux
does not cross the magnets.
"""

import cmath
import math
from typing import Annotated, Literal

import numpy as np

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.geometries.geometry import PermanentMagnet, Windings
from ambkit.machine.magnetostatics.geometries.radial import OPPOSITE, Pole, Ring
from ambkit.machine.magnetostatics.layout import Layout, Region, circle, rectangle


class HybridRadial(Ring):
    """Four poles with coils on the axes, and four with permanent magnets between them."""

    type: Literal["hybrid-radial"] = "hybrid-radial"
    magnet_pole_width: Annotated[float, Quantity("m", "9 mm", above=0)]
    """Width of a pole with a magnet at its root [m]."""
    magnet: PermanentMagnet
    """The magnets, as wide as their poles."""

    @classmethod
    def places(cls, read: Read) -> list[Pole]:
        widths = read("pole_width"), read("magnet_pole_width")
        return [Pole(number * math.pi / 4, 1, widths[number % 2], -1 if number % 2 else number // 2)
                for number in range(8)]  # fmt: skip

    @classmethod
    def _contradictions(cls, read: Read):  # type: ignore[no-untyped-def]
        yield from super()._contradictions(read)
        magnet = read("magnet")
        if isinstance(magnet, PermanentMagnet) and magnet.thickness >= read("pole_height"):
            yield "magnet.thickness", "must be less than pole_height"

    def magnet_constant(self, turns: float) -> float:
        return MU_0 * turns**2 / 2 * self.pole_width * self.stack_length

    def ideal_bias(self, windings: Windings) -> float:
        gap = self.air_gap / MU_0  # reluctances of one pole, by areas
        area, across = (self.stack_length * w for w in (self.pole_width, self.magnet_pole_width))
        share = 1 + (self.magnet.reluctance(across) + gap / across) * area / gap
        return self.magnet.mmf / share / windings.turns

    def layout(self, windings: Windings) -> Layout:
        regions, circles = self._ring(windings)
        root, half = circles[3][1], 0.5j * self.magnet_pole_width
        foot = math.sqrt(root**2 - abs(half) ** 2)
        for number in (1, 3, 5, 7):
            way = cmath.rect(1.0, number * math.pi / 4)
            block = way * rectangle(foot - self.magnet.thickness - half, foot + half)
            regions.append(Region(block, "geometry.magnet", remanence=-self.magnet.remanence * way,
                                  permeability=self.magnet.permeability))  # fmt: skip
        around = Region(circle(circles[-1][1]), "geometry")
        return Layout(around, regions, (1.0, 1j), np.zeros(4), OPPOSITE, self.stack_length, circles)
