"""The geometries of magnets; they are listed here only."""

from typing import Annotated

from pydantic import Field

from ambkit.machine.magnetostatics.geometries.axial import Ball, Thrust
from ambkit.machine.magnetostatics.geometries.core import ECore, UCore
from ambkit.machine.magnetostatics.geometries.radial import Radial

AnyGeometry = Annotated[Radial | ECore | UCore | Thrust | Ball, Field(discriminator="type")]
