"""The geometries of magnets, registered here."""

from typing import Annotated

from pydantic import Field

from ambkit.machine.magnetostatics.geometries.axial import Ball, Thrust
from ambkit.machine.magnetostatics.geometries.core import ECore, UCore
from ambkit.machine.magnetostatics.geometries.homopolar import Homopolar
from ambkit.machine.magnetostatics.geometries.hybrid_radial import HybridRadial
from ambkit.machine.magnetostatics.geometries.hybrid_thrust import HybridThrust
from ambkit.machine.magnetostatics.geometries.radial import Radial

AnyGeometry = Annotated[
    Radial | HybridRadial | Homopolar | ECore | UCore | Thrust | HybridThrust | Ball,
    Field(discriminator="type"),
]
