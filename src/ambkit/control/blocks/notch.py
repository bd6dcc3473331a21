"""A notch, which takes out one frequency."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from ambkit.base.config.quantities import Quantity
from ambkit.control.blocks.block import Block


class Notch(Block):
    """``(s^2 + 2 depth d w s + w^2) / (s^2 + 2 d w s + w^2)``, such as for a bending mode."""

    type: Literal["notch"] = "notch"
    frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Where it is [Hz]."""
    damping: Annotated[float, Quantity("1", "0.2", above=0)] = 0.2
    """Damping ratio d of its poles, half its relative width [1]."""
    depth: Annotated[float, Quantity("1", "0.1", at_least=0)] = 0.0
    """Share that passes at the frequency [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s."""
        w = 2 * math.pi * self.frequency
        wide = 2 * self.damping * w
        return (1.0, self.depth * wide, w * w), (1.0, wide, w * w)
