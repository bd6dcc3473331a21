"""A magnet's drawing: geometry, winding and iron, from TOML."""

import hashlib
from collections.abc import Iterator
from functools import cached_property
from typing import Annotated

from pydantic import Field

from ambkit.base.config import Document, Part, Read
from ambkit.base.config.quantities import Description, Name, Quantity
from ambkit.base.errors import AmbkitError
from ambkit.machine.magnetostatics.geometries import AnyGeometry
from ambkit.machine.magnetostatics.geometries.geometry import Geometry, Windings
from ambkit.machine.magnetostatics.iron import Iron
from ambkit.machine.magnetostatics.layout import Layout
from ambkit.machine.magnetostatics.mesh import checked_outlines


class Winding(Part):
    """The coils and their currents."""

    turns: Annotated[float, Field(gt=0, le=1e6)]
    """Turns per coil, or their mean."""
    bias_current: Annotated[float, Quantity("A", "3 A", above=0)] | None = None
    """Bias current [A]; none with permanent magnets."""
    control_limit: Annotated[float, Quantity("A", "3 A", above=0)] | None = None
    """Maximum control current of the map, in both directions [A]. By default the bias current, or
    that equivalent to the permanent magnets with ideal iron.
    """
    voltage: Annotated[float, Quantity("V", "150 V", above=0)] | None = None
    """Amplifier voltage [V], for the slew rate of the force."""


class Drawing(Document):
    """A magnet whose force follows from finite elements."""

    name: Name
    """Name of the magnet."""
    description: Description = ""
    """Description."""
    geometry: AnyGeometry
    """Dimensions."""
    winding: Winding
    """Coils."""
    iron: Iron
    """Iron of the stator, and by default of the rotor."""
    rotor_iron: Iron | None = None
    """Iron of the rotor."""
    clearance: Annotated[float, Quantity("m", "0.25 mm", above=0)] | None = None
    """Maximum displacement of the map [m]. By default half of the air gap."""
    end_factor: Annotated[float, Quantity("1", "1.02", above=0)] = 1.0
    """Factor on the length of the stack for the flux at its ends, of a plane section [1]."""

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
        """Reject intersecting outlines, with the name of the file."""
        try:
            checked_outlines(self.layout)
        except AmbkitError as error:
            raise AmbkitError(f"{name}: {error}") from None

    @property
    def displacement_range(self) -> float:
        """Maximum displacement of its map [m]."""
        return self.geometry.air_gap / 2 if self.clearance is None else self.clearance

    @property
    def bias_current(self) -> float:
        """Bias current [A]; with magnets or a bias coil, that of control coils with ideal iron."""
        return self.geometry.ideal_bias(self._windings)

    @property
    def limit(self) -> float:
        """Maximum control current [A]."""
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
        """K of ideal iron without fringing [N m^2/A^2]."""
        return self.geometry.magnet_constant(self.winding.turns)

    def key(self, *more: object) -> str:
        """Return the hash of all inputs of a solution."""
        physics = self.model_dump(exclude={"name", "description", "clearance", "winding"})
        return hashlib.sha256(repr((physics, self.winding.turns, *more)).encode()).hexdigest()
