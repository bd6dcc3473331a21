"""Bodies of revolution: a thrust bearing with a disc, and a pot magnet above a ball."""

import math
from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import numpy as np

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering
from ambkit.machine.magnetostatics.geometries.geometry import CLEAR, Geometry, Windings, two_poles
from ambkit.machine.magnetostatics.layout import Layout, Points, Region, arc, rectangle


class Pot(Geometry):
    """A ring-shaped core with a coil between two poles."""

    slot_width: Annotated[float, Quantity("m", "12 mm", above=0)]
    """Radial width of the slot [m]."""
    slot_depth: Annotated[float, Quantity("m", "20 mm", above=0)]
    """Axial depth of the slot [m]."""
    outer_pole: Annotated[float, Quantity("m", "6 mm", above=0)]
    """Radial width of the outer pole [m]."""
    back_iron: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Axial thickness of the back iron [m]."""

    def _constant(self, turns: float, inside: float, inner: float, end: float = math.inf) -> float:
        slot = inner + self.slot_width
        outer = min(slot + self.outer_pole, end)
        areas = (math.pi * (end**2 - begin**2) for begin, end in ((inside, inner), (slot, outer)))
        return two_poles(turns, *areas)

    def _pot(self, windings: Windings, radii: tuple[float, float], face: float, way: int,
             coil: int) -> list[Region]:  # fmt: skip
        """Return core and coil for radii of the inner pole; face at z, back iron along `along`."""
        inside, inner = radii
        slot, outer = inner + self.slot_width, inner + self.slot_width + self.outer_pole
        root, back = (
            face + way * depth for depth in (self.slot_depth, self.slot_depth + self.back_iron)
        )
        core = np.array([inside + 1j * face, inner + 1j * face, inner + 1j * root, slot + 1j * root,
                         slot + 1j * face, outer + 1j * face, outer + 1j * back,
                         inside + 1j * back])  # fmt: skip
        aside, deep = CLEAR * self.slot_width, way * CLEAR * self.slot_depth
        winding = rectangle(inner + aside + 1j * (face + deep), slot - aside + 1j * (root - deep))
        return [
            Region(core, "geometry.outer_pole", windings.iron),
            Region(winding, "geometry.slot_width", coil=coil, turns=windings.turns),
        ]


class Thrust(Pot):
    """Two ring-shaped cores with a disc between them."""

    type: Literal["thrust"] = "thrust"
    shaft_diameter: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Inner diameter of the disc [m]."""
    shaft: Literal["nonmagnetic", "iron"] = "nonmagnetic"
    """Whether the shaft conducts flux; it is of the disc's iron then."""
    disc_diameter: Annotated[float, Quantity("m", "90 mm", above=0)]
    """Outer diameter of the disc [m]."""
    disc_thickness: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Thickness of the disc [m]."""
    core_bore: Annotated[float, Quantity("m", "36 mm", above=0)]
    """Inner diameter of the cores [m]."""
    inner_pole: Annotated[float, Quantity("m", "7 mm", above=0)]
    """Radial width of the inner pole [m]."""

    sides: ClassVar[Literal["two-sided"]] = "two-sided"

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("core_bore") <= read("shaft_diameter"):
            shaft = engineering(read("shaft_diameter"), "m")
            yield "core_bore", f"must be greater than the shaft's diameter of {shaft}"
        slot = read("core_bore") / 2 + read("inner_pole") + read("slot_width")
        if read("disc_diameter") / 2 <= slot:
            yield (
                "disc_diameter",
                f"ends before the outer pole, which begins at {engineering(2 * slot, 'm')}",
            )

    def magnet_constant(self, turns: float) -> float:
        inside = self.core_bore / 2
        return self._constant(turns, inside, inside + self.inner_pole, self.disc_diameter / 2)

    def layout(self, windings: Windings) -> Layout:
        face = self.disc_thickness / 2 + self.air_gap
        inside = self.core_bore / 2
        radii = (inside, inside + self.inner_pole)
        shaft, rim = self.shaft_diameter / 2, self.disc_diameter / 2
        end = face + self.slot_depth + self.back_iron
        wide = max(rim, radii[1] + self.slot_width + self.outer_pole)
        half, core = 0.5j * self.disc_thickness, windings.rotor_iron
        disc = [
            Region(rectangle(shaft - half, rim + half), "geometry.disc_diameter", core, moves=True)
        ]
        if self.shaft == "iron":
            bar = rectangle(-1.2j * end, shaft + 1.2j * end)
            disc.append(Region(bar, "geometry.shaft_diameter", core, moves=True))
        upper, lower = (self._pot(windings, radii, way * face, way, coil) for way, coil in
                        ((1, 0), (-1, 1)))  # fmt: skip
        return Layout(
            Region(rectangle(-1.6j * end, 1.5 * wide + 1.6j * end), "geometry"),
            [*upper, *lower, *disc],
            (1j,), np.ones(2), np.array([[1.0, -1.0]]),
        )  # fmt: skip


class Ball(Pot):
    """A pot magnet above a ball."""

    type: Literal["pot-and-ball"] = "pot-and-ball"
    inner_diameter: Annotated[float, Quantity("m", "20 mm", above=0)]
    """Diameter of the inner pole [m]."""
    ball_diameter: Annotated[float, Quantity("m", "50 mm", above=0)]
    """Diameter of the ball [m]."""

    sides: ClassVar[Literal["one-sided"]] = "one-sided"

    def magnet_constant(self, turns: float) -> float:
        return self._constant(turns, 0.0, self.inner_diameter / 2)

    def layout(self, windings: Windings) -> Layout:
        radius = self.ball_diameter / 2
        centre = -1j * (self.air_gap + radius)
        half: Points = arc(radius, -math.pi / 2, math.pi / 2, centre)
        half[[0, -1]] = 1j * half[[0, -1]].imag
        wide = max(radius, self.inner_diameter / 2 + self.slot_width + self.outer_pole)
        top = self.slot_depth + self.back_iron
        around = rectangle(1j * (2 * centre.imag - wide), 2 * wide + 1j * (top + wide))
        return Layout(
            Region(around, "geometry"),
            [*self._pot(windings, (0.0, self.inner_diameter / 2), 0.0, 1, 0),
             Region(half, "geometry.ball_diameter", windings.rotor_iron, moves=True)],
            (1j,), np.ones(1), np.ones((1, 1)), circles=[(centre, radius)],
        )  # fmt: skip
