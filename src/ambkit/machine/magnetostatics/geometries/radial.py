"""Radial bearings: a ring with parallel-sided poles around the rotor; the heteropolar one."""

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from ambkit.base.config import Read, reader
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.geometries.geometry import CLEAR, Geometry, Windings
from ambkit.machine.magnetostatics.layout import Layout, Region, arc, circle

AROUND = 1.15  #: Radius of the boundary, over that of the stator.
OPPOSITE = np.array([[1.0, 0, -1, 0], [0, 1, 0, -1]])  #: Control currents of the quadrants.


class Pole(NamedTuple):
    """A pole of a ring."""

    at: float  #: [rad]
    sign: int  #: Direction of its turns: positive current drives flux outwards, or inwards.
    width: float  #: [m]
    coil: int  #: Index of its coil; negative without.


class Ring(Geometry):
    """Poles around a rotor; opposite quadrants act along an axis."""

    rotor_diameter: Annotated[float, Quantity("m", "60 mm", above=0)]
    """Outer diameter of the rotor iron [m]."""
    shaft_diameter: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Inner diameter of the rotor iron [m]."""
    pole_width: Annotated[float, Quantity("m", "9 mm", above=0)]
    """Width of a pole [m]."""
    pole_height: Annotated[float, Quantity("m", "22 mm", above=0)]
    """Height from the bore to the back iron [m]."""
    back_iron: Annotated[float, Quantity("m", "10 mm", above=0)]
    """Thickness of the back iron [m]."""
    coil_width: Annotated[float, Quantity("m", "5 mm", above=0)]
    """Thickness of the winding beside a pole [m]."""
    stack_length: Annotated[float, Quantity("m", "30 mm", above=0)]
    """Axial length of the stack [m]."""

    sides: ClassVar[Literal["two-sided"]] = "two-sided"

    @classmethod
    def places(cls, read: Read) -> list[Pole]:
        """Return the poles by ascending angle; the first quadrant is about the x axis."""
        raise NotImplementedError

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        bore = read("rotor_diameter") / 2 + read("air_gap")
        if read("shaft_diameter") >= read("rotor_diameter"):
            yield "shaft_diameter", "must be less than rotor_diameter"
        places = cls.places(read)
        room = 2 * math.pi * bore - sum(pole.width for pole in places)
        if not places or math.isnan(room):
            return
        count, coil = len(places), read("coil_width")
        if room <= 0.1 * sum(pole.width for pole in places):
            across = engineering(2 * bore, "m")
            yield "pole_width", f"{count} poles overlap at a bore of {across} diameter"
            return
        inner = bore + CLEAR * read("pole_height")
        for pole, following in pairwise(places):
            half = (following.at - pole.at) / 2  # corners of the windings at the bore
            wide = max(pole.width, following.width) / 2
            free = inner * math.sin(half) - wide * math.cos(half)
            if coil * math.cos(half) >= free:
                most = engineering(free / math.cos(half), "m", 3)
                yield "coil_width", f"windings of neighbouring poles overlap; at most {most} fits"
                return
        low, high = _winding(bore, read("pole_height"), max(p.width for p in places), coil)
        if high <= low:
            yield "pole_height", "leaves no room for the winding"

    def _ring(self, windings: Windings) -> tuple[list[Region], list[tuple[complex, float]]]:
        """Return the regions of the section, and the circles of their outlines."""
        rotor, bore = self.rotor_diameter / 2, self.rotor_diameter / 2 + self.air_gap
        root = bore + self.pole_height
        outer = root + self.back_iron
        places = self.places(reader(self))
        window, coils = [], []
        for number, pole in enumerate(places):
            at, width = pole.at, pole.width
            tip, foot = (math.asin(width / 2 / r) for r in (bore, root))
            following = places[(number + 1) % len(places)]
            next_foot = math.asin(following.width / 2 / root)
            step = (following.at - at) % (2 * math.pi)
            window += [arc(bore, at - tip, at + tip)]
            window += [arc(root, at + foot, at + step - next_foot)]
            low, high = _winding(bore, self.pole_height, width, self.coil_width)
            for side in (1, -1) if pole.coil >= 0 else ():
                near, far = side * width / 2, side * (width / 2 + self.coil_width)
                beside = np.array(
                    [low + 1j * near, high + 1j * near, high + 1j * far, low + 1j * far]
                )
                coils.append(Region(beside * np.exp(1j * at), "geometry.coil_width", coil=pole.coil,
                                    turns=side * pole.sign * windings.turns))  # fmt: skip
        iron, core = windings.iron, windings.rotor_iron
        regions = [
            Region(circle(outer), "geometry.back_iron", iron),
            Region(np.concatenate(window), "geometry.pole_width"),
            *coils,
            Region(circle(rotor), "geometry.rotor_diameter", core, moves=True),
            Region(circle(self.shaft_diameter / 2), "geometry.shaft_diameter", moves=True),
        ]
        radii = (self.shaft_diameter / 2, rotor, bore, root, outer, AROUND * outer)
        return regions, [(0.0, radius) for radius in radii]


class Radial(Ring):
    """Poles with equal turns in four quadrants, whose flux returns through their neighbours."""

    # With an odd number of poles in a quadrant, above one, the middle pole is twice as wide.

    type: Literal["radial"] = "radial"
    poles: Annotated[int, Field(ge=4, le=64, multiple_of=4, strict=True)]
    """Number of poles, a multiple of 4."""

    @classmethod
    def places(cls, read: Read) -> list[Pole]:
        poles, width = read("poles"), read("pole_width")
        return _poles(poles, width) if isinstance(poles, int) and 4 <= poles <= 64 else []

    def magnet_constant(self, turns: float) -> float:
        quadrant = _poles(self.poles, self.pole_width)[: self.poles // 4]
        pull = sum(pole.width * math.cos(pole.at) for pole in quadrant)
        return MU_0 * turns**2 / 2 * self.stack_length * pull

    def layout(self, windings: Windings) -> Layout:
        regions, circles = self._ring(windings)
        around = Region(circle(circles[-1][1]), "geometry")
        return Layout(around, regions, (1.0, 1j), np.ones(4), OPPOSITE, self.stack_length, circles)


def _winding(bore: float, height: float, width: float, coil: float) -> tuple[float, float]:
    """Return start and end of a winding along its pole [m]."""
    root, clear = bore + height, CLEAR * height
    edges = math.sqrt(bore**2 - width**2 / 4), math.sqrt(max(root**2 - (width / 2 + coil) ** 2, 0))
    return edges[0] + clear, edges[1] - clear


def _poles(count: int, width: float) -> list[Pole]:
    """Return the poles of a heteropolar ring."""
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
            sign = (-1) ** (number + sense)
            places.append(Pole(at + 0.5 * share * pitch, sign, share * width, quadrant))
            at += share * pitch
    return places
