"""What the geometries have in common."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from ambkit.base.config import Part
from ambkit.base.config.quantities import Quantity
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.iron import Curve
from ambkit.machine.magnetostatics.layout import Layout

CLEAR = 0.04  #: Of a pole's height, between a winding and the iron around.


class Windings(NamedTuple):
    """What a section is filled with."""

    turns: float  #: Of one coil.
    iron: Curve
    rotor_iron: Curve


class Geometry(Part):
    """Dimensions of a magnet."""

    air_gap: Annotated[float, Quantity("m", "0.5 mm", above=0)]
    """Air gap with the rotor in the centre [m]."""

    def layout(self, windings: Windings) -> Layout:
        """Return the section."""
        raise NotImplementedError

    def magnet_constant(self, turns: float) -> float:
        """Return k of ideal iron without fringes [N m^2/A^2], as `ClosedLaw` takes it."""
        raise NotImplementedError


def two_poles(turns: float, first: float, second: float) -> float:
    """Return k of a coil whose flux crosses two gaps in series with these areas [m^2]."""
    return MU_0 * turns**2 / 2 / (1 / first + 1 / second)
