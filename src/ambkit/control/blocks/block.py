"""A block behind a PID: what its demand passes before it is held to its limits."""

from __future__ import annotations

import math
from abc import abstractmethod

from ambkit.base.config import Part
from ambkit.base.errors import AmbkitError


class Block(Part):
    """A filter in the path of one signal, stated in continuous time."""

    @abstractmethod
    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s: s^2, s, 1."""

    @property
    def exact(self) -> float:
        """Frequency at which the sampled filter is the continuous one [Hz]; 0: at rest."""
        return float(getattr(self, "frequency", 0.0))

    def sections(self, T: float) -> list[list[float]]:
        """Return the sections b0, b1, b2, a1, a2 that it is at a sampling time [s]."""
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
