"""Blocks behind a PID, which filter its output before the limits."""

import math
from abc import abstractmethod
from typing import Annotated, Literal

from ambkit.base.config import Part
from ambkit.base.config.quantities import Quantity
from ambkit.base.errors import AmbkitError


class Block(Part):
    """A filter of one signal, defined in continuous time."""

    @abstractmethod
    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s: s^2, s, 1."""

    @property
    def exact(self) -> float:
        """Frequency at which the sampled filter equals the continuous one [Hz]; 0: static."""
        return float(getattr(self, "frequency", 0.0))

    def sections(self, T: float) -> list[list[float]]:
        """Return the sections b0, b1, b2, a1, a2 at a sampling time [s]."""
        # By the bilinear transformation, prewarped to `exact` (Franklin, Powell and Workman 1998,
        # section 6.1).
        f = self.exact
        if not f < 0.5 / T:
            raise AmbkitError(
                f"controller.block: {getattr(self, 'type', '')} at {f:.6g} Hz must be below half "
                f"the sampling frequency, {0.5 / T:.6g} Hz"
            )
        c = 2 / T if f == 0 else 2 * math.pi * f / math.tan(math.pi * f * T)
        polynomials = self.polynomials()
        if not any(p for p, _, _ in polynomials):  # of first order: no pole and zero at z = -1
            (b0, b1), (a0, a1) = ((q * c + r, r - q * c) for _, q, r in polynomials)
            return [[b0 / a0, b1 / a0, 0.0, a1 / a0, 0.0]]
        (b0, b1, b2), (a0, a1, a2) = (
            (p * c * c + q * c + r, 2 * (r - p * c * c), p * c * c - q * c + r)
            for p, q, r in polynomials
        )
        return [[b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0]]


class Biquad(Block):
    """``(s^2/w_z^2 + 2 d_z s/w_z + 1) / (s^2/w_p^2 + 2 d_p s/w_p + 1)``."""

    type: Literal["biquad"] = "biquad"
    zero_frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Frequency of the zeros [Hz]."""
    zero_damping: Annotated[float, Quantity("1", "0.05")]
    """Damping ratio of the zeros [1]; negative in the right half-plane."""
    pole_frequency: Annotated[float, Quantity("Hz", "120 Hz", above=0)]
    """Frequency of the poles [Hz]."""
    pole_damping: Annotated[float, Quantity("1", "0.5", above=0)]
    """Damping ratio of the poles [1]."""

    @property
    def exact(self) -> float:
        return self.pole_frequency

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        z, p = 2 * math.pi * self.zero_frequency, 2 * math.pi * self.pole_frequency
        above = z**-2, 2 * self.zero_damping / z, 1.0
        return above, (p**-2, 2 * self.pole_damping / p, 1.0)


class LeadLag(Block):
    """``(1 + s/w_z) / (1 + s/w_p)``: a lead where the zero is below the pole, else a lag."""

    type: Literal["lead-lag"] = "lead-lag"
    zero: Annotated[float, Quantity("Hz", "60 Hz", above=0)]
    """Corner of the numerator [Hz]."""
    pole: Annotated[float, Quantity("Hz", "600 Hz", above=0)]
    """Corner of the denominator [Hz]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        corner = 2 * math.pi
        return (0.0, 1 / (corner * self.zero), 1.0), (0.0, 1 / (corner * self.pole), 1.0)


class Notch(Block):
    """``(s^2 + 2 depth d w s + w^2) / (s^2 + 2 d w s + w^2)``, such as for a bending mode."""

    type: Literal["notch"] = "notch"
    frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Centre frequency [Hz]."""
    damping: Annotated[float, Quantity("1", "0.2", above=0)] = 0.2
    """Damping ratio d of its poles, half its relative width [1]."""
    depth: Annotated[float, Quantity("1", "0.1", at_least=0)] = 0.0
    """Gain at the centre frequency [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        w = 2 * math.pi * self.frequency
        wide = 2 * self.damping * w
        return (1.0, self.depth * wide, w * w), (1.0, wide, w * w)


class SecondOrder(Block):
    """``w^2 / (s^2 + 2 d w s + w^2)``."""

    type: Literal["second-order"] = "second-order"
    frequency: Annotated[float, Quantity("Hz", "1.5 kHz", above=0)]
    """Corner frequency [Hz]."""
    damping: Annotated[float, Quantity("1", "0.7", above=0)] = 0.7
    """Damping ratio d [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        w = 2 * math.pi * self.frequency
        return (0.0, 0.0, w * w), (1.0, 2 * self.damping * w, w * w)
