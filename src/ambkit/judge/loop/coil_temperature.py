"""How warm the coils of an axis become: copper loss against what is cooled away."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ambkit.machine.accessories import REFERENCE

if TYPE_CHECKING:
    from ambkit.machine.accessories import Coil
    from ambkit.machine.machine import Bearing

ZERO = 273.15
"""Of degrees Celsius [K]."""


@dataclass(frozen=True)
class Heating:
    """The hottest coil of an axis, long at its operating point."""

    # Incropera, DeWitt, Fundamentals of heat and mass transfer, chapter 5 (the lumped capacitance);
    # IEC 60028 for the temperature coefficient of annealed copper, 3.93e-3 1/K at 20 degrees
    # Celsius.

    temperature: float  #: Of the coil [K]; infinite where it runs away.
    limit: float | None  #: That is permitted [K]; None where it is not known.
    loss: float  #: Of the axis's coils, each at its temperature [W]; infinite likewise.
    #: How long the greatest current may flow from then on until the limit is reached [s]; infinite
    #: where it never is, None where time constant or limit are not known.
    until_limit: float | None

    @property
    def celsius(self) -> float:
        """Of the coil, in degrees Celsius."""
        return self.temperature - ZERO


def heating(bearing: Bearing, squares: list[float]) -> Heating | None:
    """Return how warm the coils of an axis become."""
    # A coil at the temperature ``Th`` has the resistance ``R (1 + a (Th - 293.15 K))``, and takes
    # the loss of its mean square of the current times that. Cooled by ``(Th - ambient)/R_th`` it
    # rests at
    # ``Th = (ambient + R_th P (1 - a 293.15 K))/(1 - R_th P a)``, ``P = R I^2``,
    # where the resistance's growth is in it; with ``R_th P a`` of 1 or more it never rests.
    coil, R = bearing.coil, bearing.amplifier.resistance
    if coil is None or R is None:
        return None
    parts = [at_rest(coil, R * square) for square in squares]
    losses = [
        R * square * (1 + coil.temperature_coefficient * (at - REFERENCE))
        for square, at in zip(squares, parts, strict=True)
    ]
    most = (bearing.magnet.bias_current + bearing.current_max) ** 2
    return Heating(
        max(parts), coil.temperature_limit, math.fsum(losses) if math.isfinite(max(parts)) else
        math.inf, _until_limit(coil, R * most, max(parts)),
    )  # fmt: skip


def at_rest(coil: Coil, power: float) -> float:
    """Return the temperature at which a coil rests [K]; infinite where it never does."""
    rise = coil.thermal_resistance * power
    left = 1 - rise * coil.temperature_coefficient
    if left <= 0:
        return math.inf
    return (coil.ambient + rise * (1 - coil.temperature_coefficient * REFERENCE)) / left


def _until_limit(coil: Coil, power: float, start: float) -> float | None:
    """Return how long a loss may last from a temperature on [s]: ``tau Th' = rest - left Th``."""
    tau, limit = coil.time_constant, coil.temperature_limit
    if tau is None or limit is None:
        return None
    if start >= limit:
        return 0.0
    rise = coil.thermal_resistance * power
    left = 1 - rise * coil.temperature_coefficient
    rest = coil.ambient + rise * (1 - coil.temperature_coefficient * REFERENCE)
    fast, slow = rest - left * start, rest - left * limit  # tau Th' at both ends
    if slow <= 0:
        return math.inf
    if abs(left) < 1e-9:
        return tau * (limit - start) / rest
    return tau / left * math.log(fast / slow)
