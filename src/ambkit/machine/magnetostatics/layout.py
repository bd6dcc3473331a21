"""The cross section of a magnet: regions with their materials, coils and motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.machine.magnetostatics.iron import Curve

Points = NDArray[np.complex128]
"""Points of the plane [m]: x + iy, or r + iz where the section is axisymmetric."""


class Region(NamedTuple):
    """A closed outline with its material; it overlays earlier regions."""

    outline: Points  #: (n,) Its corners in order, anticlockwise.
    key: str  #: Key of the drawing that determines its size.
    iron: Curve | None = None
    moves: bool = False  #: Whether it moves with the rotor.
    coil: int = -1  #: Index of the coil in it.
    turns: float = 0.0  #: Negative if they carry the current into the plane.
    remanence: complex = 0.0  #: Of a permanent magnet [T], with direction.
    permeability: float = 1.0  #: Relative, except for iron.


class AxialCircuit(NamedTuple):
    """Source of axial flux, through the rotor from one plane into the other."""

    rotor: tuple[float, float]  #: Radii of the rotor iron, over which it enters uniformly [m].
    stator: tuple[float, float]  #: Radii of the back iron, over which it leaves uniformly [m].
    length: float  #: Length of the stack of one plane [m].
    mmf: float  #: Of magnets [A].
    reluctance: float  #: Of magnets [A/Wb].
    iron: Curve  #: Of the rotor between the planes,
    area: float  #: its cross section [m^2],
    distance: float  #: and its length [m].
    turns: int = 0  #: Turns of the bias coil, which is the last one; 0 if there is none.

    def share(self, radius: Array) -> Array:
        """Return the radial share of the flux at radii [m]."""
        parts = [np.clip((radius**2 - a**2) / (b**2 - a**2), 0.0, 1.0)
                 for a, b in (self.rotor, self.stator)]  # fmt: skip
        return np.asarray(parts[0] - parts[1])

    def energy(self, per_length: float) -> tuple[float, float, float]:
        """Return energy [J] and its derivatives by the flux per length of a stack [Wb/m]."""
        flux = per_length * self.length
        h, slope, density = (float(v) for v in self.iron.at(np.array(abs(flux) / self.area)))
        drop = self.reluctance * flux + np.copysign(self.distance * h, flux)
        rise = self.reluctance + self.distance * slope / self.area
        energy = self.reluctance * flux**2 / 2 + self.area * self.distance * density
        return float(energy), float(drop * self.length), float(rise * self.length**2)


@dataclass(frozen=True, eq=False)
class Layout:
    """Regions within a boundary that no flux crosses."""

    boundary: Region
    regions: Sequence[Region]
    directions: Sequence[complex]  #: Unit vectors of the rotor's displacements, one or two.
    bias: Array  #: (coils,) Current of each coil per bias current.
    control: Array  #: (directions, coils) Current of each coil per control current.
    depth: float = float("nan")
    """Length across the plane [m]; NaN if the section is axisymmetric about its imaginary axis."""
    circles: Sequence[tuple[complex, float]] = ()
    """Centre and radius [m] of the circles in outlines."""
    opposed: bool = False
    """Whether an equal magnet acts in the opposite direction, with a separate field."""
    axial: AxialCircuit | None = None
    """Source of a bias flux across the plane; the depth is that of two planes."""

    @property
    def axisymmetric(self) -> bool:
        """Whether the section is that of a body of revolution."""
        return bool(np.isnan(self.depth))

    def lengthened(self, factor: float) -> Layout:
        """Return it with another depth."""
        axial = self.axial and self.axial._replace(length=factor * self.axial.length)
        return replace(self, depth=factor * self.depth, axial=axial)


def rectangle(low: complex, high: complex) -> Points:
    """Return the outline of a rectangle by two corners."""
    return np.array([low, high.real + 1j * low.imag, high, low.real + 1j * high.imag])


def arc(radius: float, begin: float, end: float, centre: complex = 0.0) -> Points:
    """Return points on an arc between two angles, a few degrees apart."""
    count = max(2, 1 + round(abs(end - begin) / np.radians(5)))
    return np.asarray(centre + radius * np.exp(1j * np.linspace(begin, end, count)))


def circle(radius: float) -> Points:
    """Return points on a circle about the origin."""
    return arc(radius, 0.0, 2 * np.pi)[:-1]


def contains(outline: Points, places: Points) -> NDArray[np.bool_]:
    """Return which places (n,) are within an outline, by the crossings of a ray."""
    inside = np.zeros(len(places), dtype=bool)
    order = np.argsort(places.imag)
    height = places.imag[order]
    for a, b in zip(outline, np.roll(outline, -1), strict=True):
        ends = sorted((a.imag, b.imag))
        level = order[slice(*np.searchsorted(height, ends))]  # from the lower end on
        if len(level):
            at = a.real + (places[level].imag - a.imag) / (b.imag - a.imag) * (b.real - a.real)
            inside[level] ^= places[level].real < at
    return inside


def flat(places: Points) -> Array:
    """Return places (n,) as (n, 2)."""
    return np.column_stack([places.real, places.imag])
