"""Thrust bearing with a radially magnetised ring around its disc.

The ring drives the bias flux through a shoe into the rim of the disc and out through both air gaps;
the coils of both sides, in series, increase it in one gap and decrease it in the other.
"""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.geometries.geometry import (
    CLEAR,
    Geometry,
    PermanentMagnet,
    Windings,
)
from ambkit.machine.magnetostatics.layout import Layout, Region, rectangle


class HybridThrust(Geometry):
    """A disc between two ring-shaped poles, and a permanent magnet around its rim."""

    type: Literal["hybrid-thrust"] = "hybrid-thrust"
    shaft_diameter: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Inner diameter of the disc [m]."""
    disc_diameter: Annotated[float, Quantity("m", "90 mm", above=0)]
    """Outer diameter of the disc [m]."""
    disc_thickness: Annotated[float, Quantity("m", "12 mm", above=0)]
    """Thickness of the disc [m]."""
    core_bore: Annotated[float, Quantity("m", "40 mm", above=0)]
    """Inner diameter of the poles [m]."""
    pole_width: Annotated[float, Quantity("m", "8 mm", above=0)]
    """Radial width of a pole [m]."""
    slot_depth: Annotated[float, Quantity("m", "15 mm", above=0)]
    """Axial depth of a slot, from the pole face to the back iron [m]."""
    radial_gap: Annotated[float, Quantity("m", "1 mm", above=0)]
    """Radial gap between the rim of the disc and the shoe [m]."""
    shoe_thickness: Annotated[float, Quantity("m", "4 mm", above=0)]
    """Radial thickness of the shoe between the magnet and the radial gap [m]."""
    magnet_height: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Axial height of magnet and shoe [m]."""
    magnet: PermanentMagnet
    """The ring."""
    back_iron: Annotated[float, Quantity("m", "8 mm", above=0)]
    """Thickness of the surrounding iron [m]."""

    sides: ClassVar[Literal["two-sided"]] = "two-sided"

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        bore = read("core_bore")
        if bore <= read("shaft_diameter"):
            shaft = engineering(read("shaft_diameter"), "m")
            yield "core_bore", f"must be greater than the shaft's diameter of {shaft}"
        pole = bore + 2 * read("pole_width")
        if read("disc_diameter") < pole:
            end = engineering(pole, "m")
            yield "disc_diameter", f"ends before the pole, whose outer diameter is {end}"
        if read("magnet_height") > read("disc_thickness"):
            yield "magnet_height", "must be at most disc_thickness"

    @property
    def _pole(self) -> tuple[float, float]:
        return self.core_bore / 2, self.core_bore / 2 + self.pole_width

    @property
    def _ring(self) -> tuple[float, float, float]:
        """Radii of the rim, and of the ring inside and outside."""
        inside = self.disc_diameter / 2 + self.radial_gap + self.shoe_thickness
        return self.disc_diameter / 2, inside, inside + self.magnet.thickness

    def magnet_constant(self, turns: float) -> float:
        inner, outer = self._pole
        return MU_0 * turns**2 / 2 * math.pi * (outer**2 - inner**2)

    def ideal_bias(self, windings: Windings) -> float:
        inner, outer = self._pole
        rim, inside, outside = self._ring
        around = 2 * math.pi * MU_0 * self.magnet_height
        series = math.log1p(self.radial_gap / rim) / around
        series += math.log(outside / inside) / (around * self.magnet.permeability)
        gap = self.air_gap / (MU_0 * math.pi * (outer**2 - inner**2))
        return self.magnet.mmf / (1 + 2 * series / gap) / windings.turns

    def layout(self, windings: Windings) -> Layout:
        inner, outer = self._pole
        rim, inside, outside = self._ring
        half, tall = 0.5j * self.disc_thickness, 0.5j * self.magnet_height
        face = self.disc_thickness / 2 + self.air_gap
        root = face + self.slot_depth
        end, wide = root + self.back_iron, outside + self.back_iron
        iron, core = windings.iron, windings.rotor_iron
        upper = [inner + 1j * face, outer + 1j * face, outer + 1j * root, outside + 1j * root]
        shell = np.array([*upper, *np.conj(upper[::-1]), inner - 1j * end, wide - 1j * end,
                          wide + 1j * end, inner + 1j * end])  # fmt: skip
        aside, deep = CLEAR * (outside - outer), CLEAR * self.slot_depth
        coils: list[Region] = []
        for way in (1, -1):
            slot = rectangle(outer + aside + 1j * way * (face + deep),
                             outside - aside + 1j * way * (root - deep))  # fmt: skip
            coils.append(Region(slot, "geometry.slot_depth", coil=len(coils), turns=windings.turns))
        magnet = self.magnet
        regions = [
            Region(shell, "geometry.back_iron", iron),
            *coils,
            Region(rectangle(inside - tall, outside + tall), "geometry.magnet",
                   remanence=-magnet.remanence, permeability=magnet.permeability),
            Region(rectangle(rim + self.radial_gap - tall, inside + tall),
                   "geometry.shoe_thickness", iron),
            Region(rectangle(self.shaft_diameter / 2 - half, rim + half),
                   "geometry.disc_diameter", core, moves=True),
        ]  # fmt: skip
        around = Region(rectangle(-1.6j * end, 1.5 * wide + 1.6j * end), "geometry")
        return Layout(around, regions, (1j,), np.zeros(2), np.ones((1, 2)))
