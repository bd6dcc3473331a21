"""Common parts of the geometries."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity
from ambkit.machine.force_law import MU_0
from ambkit.machine.magnetostatics.iron import Curve
from ambkit.machine.magnetostatics.layout import Layout

CLEAR = 0.04  #: Clearance between a winding and the surrounding iron, over the pole's height.


class Windings(NamedTuple):
    """Currents and turns of a section."""

    turns: float  #: Turns of one coil.
    iron: Curve
    rotor_iron: Curve
    bias_current: float = 0.0  #: Current of the bias coils [A]; 0 with permanent magnets.


class PermanentMagnet(Part):
    """A permanent magnet, magnetised along its thickness."""

    thickness: Annotated[float, Quantity("m", "3 mm", above=0)]
    """Thickness along the magnetisation [m]."""
    remanence: Annotated[float, Quantity("T", "1.2 T", above=0)]
    """Remanence [T]."""
    coercivity: Annotated[float, Quantity("A/m", "900 kA/m", above=0)]
    """Coercivity of the flux density, where the recoil line meets B = 0 [A/m]."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("coercivity") * MU_0 > read("remanence"):
            yield "coercivity", "must be at most remanence / mu_0: the recoil line rises like air's"

    @property
    def permeability(self) -> float:
        """Relative permeability of the recoil line [1]."""
        return self.remanence / (MU_0 * self.coercivity)

    @property
    def mmf(self) -> float:
        """Magnetomotive force [A]."""
        return self.coercivity * self.thickness

    def reluctance(self, area: float) -> float:
        """Return the reluctance across an area [A/Wb]."""
        return self.thickness / (MU_0 * self.permeability * area)

    def scaled(self, factor: float) -> PermanentMagnet:
        """Return a magnet that is stronger by a factor, with the same permeability."""
        strengths = {"remanence": self.remanence, "coercivity": self.coercivity}
        return self.model_copy(update={key: factor * v for key, v in strengths.items()})


class Geometry(Part):
    """Dimensions of a magnet."""

    air_gap: Annotated[float, Quantity("m", "0.5 mm", above=0)]
    """Air gap with the rotor centred [m]."""

    @property
    def permanent(self) -> PermanentMagnet | None:
        """The permanent magnet that creates the bias, if there is one."""
        return getattr(self, "magnet", None)

    def layout(self, windings: Windings) -> Layout:
        """Return the section."""
        raise NotImplementedError

    def magnet_constant(self, turns: float) -> float:
        """Return k of ideal iron without fringing [N m^2/A^2], as in `ClosedLaw`."""
        raise NotImplementedError

    def ideal_bias(self, windings: Windings) -> float:
        """Return the equivalent bias current [A]; with ideal iron, that of the coils."""
        return windings.bias_current


def two_poles(turns: float, first: float, second: float) -> float:
    """Return k of a coil whose flux crosses two gaps in series with these areas [m^2]."""
    return MU_0 * turns**2 / 2 / (1 / first + 1 / second)
