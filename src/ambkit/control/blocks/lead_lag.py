"""A lead or a lag of first order."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from ambkit.base.config.quantities import Quantity
from ambkit.control.blocks.block import Block


class LeadLag(Block):
    """``(1 + s/w_z) / (1 + s/w_p)``: a lead where the zero is below the pole, else a lag."""

    type: Literal["lead-lag"] = "lead-lag"
    zero: Annotated[float, Quantity("Hz", "60 Hz", above=0)]
    """Corner of the numerator [Hz]."""
    pole: Annotated[float, Quantity("Hz", "600 Hz", above=0)]
    """Corner of the denominator [Hz]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s."""
        corner = 2 * math.pi
        return (0.0, 1 / (corner * self.zero), 1.0), (0.0, 1 / (corner * self.pole), 1.0)
