"""A rotor that lies: on a stop, on its pedestal, or against the magnet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.units import engineering
from ambkit.data.reading.faults import noise

NEAR = 0.02  #: Part of a position's range within which of its ends a rotor lies on a stop.
MOVES = 20.0  #: Range of a position over its noise, from which on it moves at all.
OFTEN = 0.3  #: Share of the samples from which on that is told.


@dataclass(frozen=True)
class Standstill:
    """A position that is at one end of its range for long."""

    end: float  #: That end, in the channel's unit.
    share: float  #: Share of the samples that are there.
    greatest: bool  #: Whether it is the greater end.

    def describe(self, unit: str = "") -> str:
        """Say it in a sentence's part."""
        end = "greatest" if self.greatest else "least"
        value = engineering(self.end, unit, digits=3) if unit else f"{self.end:.4g}"
        return f"at its {end} value, {value}, in {100 * self.share:.0f} % of the samples"


def standstill(values: Array) -> Standstill | None:
    """Find out whether a position (n,) lies at one of its ends for a good part of the time."""
    # values (n,)
    if values.size < 50:
        return None
    least, max_value = np.quantile(values, [0.002, 0.998])
    rough = noise(values)
    value_range = max_value - least
    if not value_range > MOVES * rough or not value_range > 0:
        return None
    near = max(NEAR * value_range, 4 * rough)
    results = [
        Standstill(float(end), float(np.mean(abs(values - end) < near)), end == max_value)
        for end in (least, max_value)
    ]
    most = max(results, key=lambda item: item.share)
    return most if most.share > OFTEN else None
