"""Elements of a shaft: materials, sections in sequence, discs."""

import math
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import SerializerFunctionWrapHandler, model_serializer

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Name, Quantity
from ambkit.base.units import engineering
from ambkit.machine.rotors import beam

Length = Annotated[float, Quantity("m", "120 mm", above=0)]

NAMED = {"steel": (7850.0, 210e9, 0.3), "aluminium": (2700.0, 70e9, 0.33),
         "titanium": (4430.0, 114e9, 0.34)}  # fmt: skip
"""Density [kg/m^3], Young's modulus [Pa] and Poisson's ratio [1] of common materials."""


class Material(Part):
    """A material, with the name used by sections and discs."""

    name: Name
    """Its name."""
    density: Annotated[float, Quantity("kg/m^3", "7850 kg/m^3", above=0)]
    """Density [kg/m^3]."""
    youngs_modulus: Annotated[float, Quantity("Pa", "210 GPa", above=0)]
    """Young's modulus E [Pa]."""
    poisson_ratio: Annotated[float, Quantity("1", "0.3", at_least=0)] = 0.3
    """Poisson's ratio [1], for the shear modulus."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("poisson_ratio") > 0.5:
            yield "poisson_ratio", f"must be at most 0.5, is {read('poisson_ratio'):g}"


class Section(Part):
    """A piece of shaft with constant cross section."""

    length: Length
    """Length [m]."""
    outer_diameter: Annotated[float, Quantity("m", "32 mm", above=0)]
    """Outer diameter [m]."""
    inner_diameter: Annotated[float, Quantity("m", "10 mm", at_least=0)] = 0.0
    """Diameter of the bore [m]."""
    material: Name = "steel"
    """One of rotor.material, or "steel", "aluminium" or "titanium"."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from _bore(read)


class Disc(Part):
    """A rigid disc on the shaft: by mass and inertias, or by geometry."""

    place: Annotated[float, Quantity("m", "323 mm", at_least=0)]
    """Distance of its centre from the start of the shaft [m]."""
    mass: Annotated[float, Quantity("kg", "2.6 kg", above=0)] | None = None
    """Mass [kg], with both inertias; or the geometry instead."""
    transverse_inertia: Annotated[float, Quantity("kg m^2", "0.02 kg m^2", above=0)] | None = None
    """Moment of inertia about a diameter [kg m^2]."""
    polar_inertia: Annotated[float, Quantity("kg m^2", "0.04 kg m^2", above=0)] | None = None
    """Moment of inertia about the shaft [kg m^2]."""
    width: Length | None = None
    """Length along the shaft [m]."""
    outer_diameter: Annotated[float, Quantity("m", "120 mm", above=0)] | None = None
    """Outer diameter [m]."""
    inner_diameter: Annotated[float, Quantity("m", "32 mm", at_least=0)] = 0.0
    """Diameter of the bore [m]."""
    material: Name = "steel"
    """As for a section."""

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        of_geometry = ("inner_diameter", "material") if self.mass is not None else ()
        return {k: v for k, v in data.items() if v is not None and k not in of_geometry}

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        by_mass = ("mass", "transverse_inertia", "polar_inertia")
        by_form = ("width", "outer_diameter")
        is_set = {key: read(key) is not None for key in (*by_mass, *by_form)}
        one, other = (any(is_set[key] for key in keys) for keys in (by_mass, by_form))
        if one == other:
            text = "give mass, transverse_inertia and polar_inertia, or width and outer_diameter"
            yield "mass" if not one else "width", f"{'missing: ' if not one else ''}{text}"
            return
        for key in by_mass if one else by_form:
            if not is_set[key]:
                yield key, "missing: what else is said of the disc does not give it"
        if one and all(is_set[key] for key in by_mass):
            yield from inertia_contradictions(read)
        yield from _bore(read)

    def on(self, density: float) -> beam.Disc:
        """Return it with mass and inertias."""
        if self.mass is not None:
            return beam.Disc(
                self.place, self.mass, self.transverse_inertia or 0.0, self.polar_inertia or 0.0
            )
        outer, inner, width = self.outer_diameter or 0.0, self.inner_diameter, self.width or 0.0
        mass = density * math.pi / 4 * (outer**2 - inner**2) * width
        squares = mass * (outer**2 + inner**2) / 16
        return beam.Disc(self.place, mass, squares + mass * width**2 / 12, 2 * squares)


def inertia_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield errors of the moments of inertia of a body: a thin disc has the largest I_p."""
    I_t, I_p = read("transverse_inertia"), read("polar_inertia")
    if I_p > 2 * I_t * (1 + 1e-9):
        limit = f"{engineering(2 * I_t, 'kg m^2')}, twice transverse_inertia"
        yield "polar_inertia", f"must be at most {limit}; is {engineering(I_p, 'kg m^2')}"


def _bore(read: Read) -> Iterator[tuple[str, str]]:
    outer, inner = read("outer_diameter"), read("inner_diameter")
    if outer is not None and inner >= outer:
        limit = f"less than outer_diameter, {engineering(outer, 'm')}"
        yield "inner_diameter", f"must be {limit}; is {engineering(inner, 'm')}"
