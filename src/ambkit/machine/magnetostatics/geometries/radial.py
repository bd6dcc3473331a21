"""Heteropolar radial bearing: a ring with parallel-sided poles around the rotor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.geometries.geometry import CLEAR, Geometry, Windings
from ambkit.machine.magnetostatics.layout import Layout, Region, arc, circle


class Radial(Geometry):
    """Poles of equal turns in four quadrants; opposite quadrants pull along an axis."""

    # With an odd number of poles in a quadrant, above one, the middle pole is twice as wide.

    type: Literal["radial"] = "radial"
    poles: Annotated[int, Field(ge=4, le=64, multiple_of=4, strict=True)]
    """Number of poles, a multiple of 4."""
    rotor_diameter: Annotated[float, Quantity("m", "60 mm", above=0)]
    """Outer diameter of the rotor iron [m]."""
    shaft_diameter: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Inner diameter of the rotor iron [m]."""
    pole_width: Annotated[float, Quantity("m", "9 mm", above=0)]
    """Width of a pole [m]."""
    pole_height: Annotated[float, Quantity("m", "22 mm", above=0)]
    """From the bore to the back iron [m]."""
    back_iron: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Thickness of the back iron [m]."""
    coil_width: Annotated[float, Quantity("m", "5 mm", above=0)]
    """Thickness of the winding beside a pole [m]."""
    stack_length: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Axial length of the stack [m]."""

    sides: ClassVar[Literal["two-sided"]] = "two-sided"

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        poles, width = read("poles"), read("pole_width")
        bore = read("rotor_diameter") / 2 + read("air_gap")
        if read("shaft_diameter") >= read("rotor_diameter"):
            yield "shaft_diameter", "must be less than rotor_diameter"
        if not isinstance(poles, int) or math.isnan(bore + width):
            return
        places = _poles(poles, width)
        room = 2 * math.pi * bore - sum(w for _, _, w in places)
        if room <= 0.1 * width * poles:
            yield (
                "pole_width",
                (f"{poles} poles overlap at a bore of {engineering(2 * bore, 'm')} diameter"),
            )
            return
        coil, inner = read("coil_width"), bore + CLEAR * read("pole_height")
        for (at, _, one), (following, _, other) in pairwise(places):
            half = (following - at) / 2  # corners of the windings at the bore
            free = inner * math.sin(half) - max(one, other) / 2 * math.cos(half)
            if coil * math.cos(half) >= free:
                most = engineering(free / math.cos(half), "m", 3)
                yield "coil_width", f"windings of neighbouring poles overlap; at most {most} fits"
                return

    def magnet_constant(self, turns: float) -> float:
        quadrant = _poles(self.poles, self.pole_width)[: self.poles // 4]
        pull = sum(width * math.cos(at) for at, _, width in quadrant)
        return MU_0 * turns**2 / 2 * self.stack_length * pull

    def layout(self, windings: Windings) -> Layout:
        rotor, bore = self.rotor_diameter / 2, self.rotor_diameter / 2 + self.air_gap
        root = bore + self.pole_height
        outer = root + self.back_iron
        places = _poles(self.poles, self.pole_width)
        window, coils = [], []
        for number, (at, sign, width) in enumerate(places):
            tip, foot = (math.asin(width / 2 / r) for r in (bore, root))
            following = places[(number + 1) % len(places)]
            next_foot = math.asin(following[2] / 2 / root)
            step = (following[0] - at) % (2 * math.pi)
            window += [arc(bore, at - tip, at + tip)]
            window += [arc(root, at + foot, at + step - next_foot)]
            low = bore * math.cos(tip) + CLEAR * self.pole_height
            high = math.sqrt(root**2 - (width / 2 + self.coil_width) ** 2)
            high -= CLEAR * self.pole_height
            quadrant = number * 4 // self.poles
            for side in (1, -1):
                near, far = side * width / 2, side * (width / 2 + self.coil_width)
                beside = np.array(
                    [low + 1j * near, high + 1j * near, high + 1j * far, low + 1j * far]
                )
                coils.append(Region(beside * np.exp(1j * at), "geometry.coil_width", coil=quadrant,
                                    turns=side * sign * windings.turns))  # fmt: skip
        iron, core = windings.iron, windings.rotor_iron
        regions = [
            Region(circle(outer), "geometry.back_iron", iron),
            Region(np.concatenate(window), "geometry.pole_width"),
            *coils,
            Region(circle(rotor), "geometry.rotor_diameter", core, moves=True),
            Region(circle(self.shaft_diameter / 2), "geometry.shaft_diameter", moves=True),
        ]
        around = 1.15 * outer
        return Layout(
            Region(circle(around), "geometry"), regions, (1.0, 1j), np.ones(4),
            np.array([[1.0, 0, -1, 0], [0, 1, 0, -1]]), self.stack_length,
            [(0, radius) for radius in (self.shaft_diameter / 2, rotor, bore, root, outer, around)],
        )  # fmt: skip


def _poles(count: int, width: float) -> list[tuple[float, int, float]]:
    """Return angle, polarity and width of each pole; the first quadrant lies about the x axis."""
    per_quadrant = count // 4
    odd = per_quadrant % 2 == 1 and per_quadrant > 1
    shares = [2.0 if odd and number == per_quadrant // 2 else 1.0 for number in range(per_quadrant)]
    # Poles and slots share a quadrant in proportion: a pole twice as wide has twice the pitch.
    pitch = math.pi / 2 / (sum(shares) if odd else per_quadrant)
    places = []
    for quadrant in range(4):
        at = quadrant * math.pi / 2 - math.pi / 4
        for number, share in enumerate(shares):
            sense = quadrant if per_quadrant == 1 or per_quadrant % 2 == 0 else 0
            places.append((at + 0.5 * share * pitch, (-1) ** (number + sense), share * width))
            at += share * pitch
    return places
