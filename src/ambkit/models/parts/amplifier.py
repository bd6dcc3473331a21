"""Current amplifier, within its limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class Amplifier:
    """From a commanded current to a magnet's: without delay, or as a first-order lag."""

    size: float  #: Typical current [A].
    bandwidth: float | None = None  #: Bandwidth of the lag [Hz]; None: no lag.
    control: str = "u"  #: Name of the commanded current.
    current: str = "i"  #: Name of the current, a state if there is a lag.
    force: str = "f"  #: Name of the magnet force.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Amplifier]:
        """Return the amplifier of each axis, with a lag if it has a bandwidth."""
        return [
            cls(s.current, a.bearing.amplifier.bandwidth, *(signal(x, a.name) for x in "uif"))
            for a, s in zip(machine.axes, sizes, strict=True)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the control, and the current if it lags."""
        plan.control(self.control, self.size)
        if self.bandwidth is None:
            plan.currents[self.force] = self.control
            return
        corner = 2 * math.pi * self.bandwidth
        plan.state(self.current, "A", self.size, "current")
        plan.rate(self.current, self.control, corner)
        plan.rate(self.current, self.current, -corner)
        plan.rest(self.current, {self.control: UNIT})
        plan.currents[self.force] = self.current
