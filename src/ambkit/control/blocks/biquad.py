"""A pair of zeros over a pair of poles."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from ambkit.base.config.quantities import Quantity
from ambkit.control.blocks.block import Block


class Biquad(Block):
    """``(s^2/w_z^2 + 2 d_z s/w_z + 1) / (s^2/w_p^2 + 2 d_p s/w_p + 1)``."""

    type: Literal["biquad"] = "biquad"
    zero_frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Frequency of the zeros [Hz]."""
    zero_damping: Annotated[float, Quantity("1", "0.05")]
    """Damping ratio of the zeros [1]; negative: they are in the right half-plane."""
    pole_frequency: Annotated[float, Quantity("Hz", "120 Hz", above=0)]
    """Frequency of the poles [Hz]."""
    pole_damping: Annotated[float, Quantity("1", "0.5", above=0)]
    """Damping ratio of the poles [1]."""

    @property
    def exact(self) -> float:
        """The frequency of the poles [Hz]."""
        return self.pole_frequency

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s."""
        z, p = 2 * math.pi * self.zero_frequency, 2 * math.pi * self.pole_frequency
        above = z**-2, 2 * self.zero_damping / z, 1.0
        return above, (p**-2, 2 * self.pole_damping / p, 1.0)
