"""A low-pass filter of second order."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from ambkit.base.config.quantities import Quantity
from ambkit.control.blocks.block import Block


class SecondOrder(Block):
    """``w^2 / (s^2 + 2 d w s + w^2)``."""

    type: Literal["second-order"] = "second-order"
    frequency: Annotated[float, Quantity("Hz", "1.5 kHz", above=0)]
    """Its corner [Hz]."""
    damping: Annotated[float, Quantity("1", "0.7", above=0)] = 0.7
    """Damping ratio d [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s."""
        w = 2 * math.pi * self.frequency
        return (0.0, 0.0, w * w), (1.0, 2 * self.damping * w, w * w)
