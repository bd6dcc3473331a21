"""Eddy currents in a magnet's iron: its force lags (Schweitzer and Maslen 2009)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ambkit.data.signals import signal
from ambkit.machine.accessories import SHORTEST_LAG
from ambkit.models.declaration import Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class EddyCurrents:
    """First-order lag between the force of a magnet's law and the acting one."""

    key: ClassVar[str] = "eddy_current_lag"  #: Key of the magnet that enables it.
    lag: float  #: Time constant [s].
    size: float  #: Typical force [N].
    force: str = "f"  #: The lagging magnet force.
    state: str = "f_e"  #: Name of the acting force, in a filter including the known weight.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[EddyCurrents]:
        """Return those of each axis whose magnet has eddy currents."""
        shortest = SHORTEST_LAG * machine.sampling_time
        return [
            cls(max(lag, shortest), s.force, signal("f", a.name), signal("f_e", a.name))
            for a, s in zip(machine.axes, sizes, strict=True)
            if (lag := a.bearing.magnet.eddy_current_lag) is not None
        ]

    def declare(self, plan: Plan) -> None:
        """Add the acting force in place of the magnet's."""
        plan.state(self.state, "N", self.size, "lagged force")
        plan.rate(self.state, self.force, 1 / self.lag)
        plan.rate(self.state, self.state, -1 / self.lag)
        plan.act_by(self.force, self.state)


LAGS = 5  #: Number of first-order lags of solid iron, over `DECADES` of frequency.
DECADES = 3


def half_order(corner: float, T: float) -> list[tuple[float, float]]:
    """Return rates [1/s] and shares of the lags with the sum ``1 / (1 + sqrt(s/corner))``."""
    # It is the integral over rates r = corner t of r/(s + r) dc(t), c = 2/pi arctan(sqrt(t)): a
    # distribution of first-order lags. Each lag represents an interval of rates; the band up to 1/T
    # is divided into equal ratios; those at the ends have the mean of r, and of 1/r.
    edges = np.geomspace(3 * 10.0**-DECADES, 1.5, LAGS - 1) / T
    rates = [edges[0] / 3, *np.sqrt(edges[1:] * edges[:-1]), 3 * edges[-1]]
    below = [2 / math.pi * np.arctan(np.sqrt(edge / corner)) for edge in edges]
    shares = [np.subtract(*ends) for ends in zip([*below, 1.0], [0.0, *below], strict=True)]
    return list(zip(rates, shares, strict=True))


@dataclass(frozen=True)
class SolidIron:
    """Lag of half an order between the force of a magnet's law and the acting one."""

    # A reluctance R_0 + c sqrt(s) has the corner (R_0/c)^2 (Zhu, Knospe and Maslen, Analytic model
    # for a nonlaminated cylindrical magnetic actuator including eddy currents, 2005).

    key: ClassVar[str] = "eddy_current_corner"  #: Key of the magnet that enables it.
    corner: float  #: Angular corner frequency [rad/s].
    size: float  #: Typical force [N].
    force: str = "f"  #: The lagging magnet force.
    state: str = "f_e"  #: Name of each share of the acting force, before its number.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[SolidIron]:
        """Return those of each axis whose magnet has solid iron."""
        return [
            cls(2 * math.pi * corner, s.force, signal("f", a.name), signal("f_e", a.name))
            for a, s in zip(machine.axes, sizes, strict=True)
            if (corner := a.bearing.magnet.eddy_current_corner) is not None
        ]

    def declare(self, plan: Plan) -> None:
        """Add the shares of the acting force in place of the magnet's."""
        lags = {f"{self.state}{k}": lag for k, lag in enumerate(half_order(self.corner, plan.T), 1)}
        for state, (rate, share) in lags.items():
            plan.state(state, "N", self.size, "lagged force")
            plan.rate(state, self.force, rate * share)
            plan.rate(state, state, -rate)
        plan.act_by(self.force, *lags)
