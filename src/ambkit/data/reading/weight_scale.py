"""Where the magnet is, and how long a unit: of a rotor that hangs below one magnet, by gravity.

One magnet pulls with C (i / gap)². In balance with gravity ``x'' = (2 g / gap) x + (2 g / i) di``:
so the pole tells the gap in metres, and what a change of the current moves tells how many
metres a unit of the logged position is, if the current's zero is known. No coil's current is below
zero; so where a log's current never is, its zero is that of the amplifier.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.position_search import Rotor

G = 9.81  #: Standard gravity, rounded [m/s²].
ABOVE = 0.99  #: Share of the samples in which a coil's current is not below zero, but for noise.
EXPLAINED = 0.5  #: Share of the acceleration's variance that the fit explains at least.

UNITS = {"m": 1.0, "mm": 1e-3, "µm": 1e-6}

TRUST = 2.0
"""Ratio to a usual unit within which a length is taken for it: noise on the current makes what it
moves look less."""


@dataclass(frozen=True)
class WeightScale:
    """What gravity tells of a rotor below one magnet."""

    gap: float  #: From the magnet to the rotor where it usually floats, as the magnet sees it [m].
    scale: float  #: Metres per unit of the logged position.
    zero: float  #: The logged position at which that gap would be 0.
    unit: str  #: The usual unit next to the scale.

    def describe(self, label: str, unit: str) -> Iterator[str]:
        """Say it in lines."""
        yield (
            f"If one magnet carries it: by gravity {label} is about {self.scale:.2g} m a unit, and "
            f"its gap {1e3 * self.gap:.3g} mm at its median, so 0 near {self.zero:.3g}."
        )
        factor = self.scale / UNITS[self.unit]
        if not unit and not 1 / TRUST < factor < TRUST:
            yield (
                f"scale = {factor:.2g}  # by gravity: no usual unit. Check it: noise and hum put "
                "it off"
            )


def weight_scale(moves: Rotor, position: Array, current: Array, step: float) -> WeightScale | None:
    """Tell the gap and the scale of a hanging rotor; None where the current falls below zero."""
    # position (n,); current (n,)
    usual = float(np.median(current))
    identifiable = moves.fit.sure and moves.fit.explained > EXPLAINED and step > 0
    if not identifiable or not usual > 0 or np.mean(current > -0.05 * usual) < ABOVE:
        return None
    a = (moves.fit.pole / step) ** 2
    b = abs(moves.gain) / step**2
    gap, scale = 2 * G / a, 2 * G / (b * usual)
    unit = min(UNITS, key=lambda name: abs(np.log(scale / UNITS[name])))
    away = gap / scale * (1 if moves.turned else -1)
    return WeightScale(gap, scale, float(np.median(position)) - away, unit)
