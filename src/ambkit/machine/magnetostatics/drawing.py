"""A magnet's drawing: geometry, winding and iron, from TOML."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated

from pydantic import Field

from ambkit.base.config import Document, Part, Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.text_types import Description, Name
from ambkit.base.errors import AmbkitError
from ambkit.machine.magnetostatics.geometries import AnyGeometry
from ambkit.machine.magnetostatics.geometries.geometry import Geometry, Windings
from ambkit.machine.magnetostatics.iron import Iron
from ambkit.machine.magnetostatics.layout import Layout
from ambkit.machine.magnetostatics.mesh import checked_outlines


class Winding(Part):
    """The coils and their currents."""

    turns: Annotated[float, Field(gt=0, le=1e6)]
    """Turns of one coil, or the mean of coils that differ."""
    bias_current: Annotated[float, Quantity("A", "3 A", above=0)] | None = None
    """Bias current [A]; none where permanent magnets make the bias."""
    control_limit: Annotated[float, Quantity("A", "3 A", above=0)] | None = None
    """Greatest control current of the map, either way [A]; by default the bias current, or the
    current of ideal iron whose law is that of the permanent magnets."""
    voltage: Annotated[float, Quantity("V", "150 V", above=0)] | None = None
    """Voltage of the amplifier [V], for the slew rate of the force."""


class Drawing(Document):
    """A magnet, from which its force follows by finite elements."""

    name: Name
    """Name of the magnet."""
    description: Description = ""
    """What it is."""
    geometry: AnyGeometry
    """Its dimensions."""
    winding: Winding
    """Its coils."""
    iron: Iron
    """The iron of the stator, and of the rotor unless that has its own."""
    rotor_iron: Iron | None = None
    """The iron of the rotor."""
    clearance: Annotated[float, Quantity("m", "0.25 mm", above=0)] | None = None
    """Greatest displacement of the map [m]; by default half the air gap."""
    end_factor: Annotated[float, Quantity("1", "1.02", above=0)] = 1.0
    """Factor of the stack's length for the flux around its ends, of a plane section [1]."""

    unwritten = ("description", "end_factor")

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("clearance") is not None and read("clearance") >= read("geometry.air_gap"):
            yield "clearance", "must be less than the air gap"
        geometry, current = read("geometry"), read("winding.bias_current")
        if isinstance(geometry, Geometry) and (geometry.permanent is None) == (current is None):
            yield (
                "winding.bias_current",
                "is missing" if current is None else "is left out: the magnets make the bias",
            )

    def check(self, name: str) -> None:
        """Refuse outlines that cross, by the name of the file."""
        try:
            checked_outlines(self.layout)
        except AmbkitError as error:
            raise AmbkitError(f"{name}: {error}") from None

    @property
    def displacement_range(self) -> float:
        """Greatest displacement of its map [m]."""
        return self.geometry.air_gap / 2 if self.clearance is None else self.clearance

    @property
    def bias_current(self) -> float:
        """Bias current [A]; of magnets or a bias coil, that of control coils with ideal iron."""
        return self.geometry.ideal_bias(self._windings)

    @property
    def limit(self) -> float:
        """Greatest control current [A]."""
        limit = self.winding.control_limit
        return self.bias_current if limit is None else limit

    @property
    def _windings(self) -> Windings:
        rotor = self.iron if self.rotor_iron is None else self.rotor_iron
        w = self.winding
        return Windings(w.turns, self.iron.curve, rotor.curve, w.bias_current or 0.0)

    @cached_property
    def layout(self) -> Layout:
        """The section with its materials."""
        return self.geometry.layout(self._windings).lengthened(self.end_factor)

    @property
    def magnet_constant(self) -> float:
        """K of ideal iron without fringes [N m^2/A^2]."""
        return self.geometry.magnet_constant(self.winding.turns)

    def key(self, *more: object) -> str:
        """Return the hash of what a solution depends on."""
        physics = self.model_dump(exclude={"name", "description", "clearance", "winding"})
        return hashlib.sha256(repr((physics, self.winding.turns, *more)).encode()).hexdigest()
