"""The dead time between a sampling instant and the change of the amplifier's input."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Plan


@dataclass(frozen=True)
class Delay:
    """Demanded currents act later, by any share of a sample or by several samples."""

    # The currents demanded in samples before, as many as still act, are states ``u_1`` (of one
    # sample before), ``u_2``, ...; a delay of d samples needs ceil(d) of them.

    time: float
    """Dead time [s]."""
    size: float
    """Typical current [A]."""
    control: str = "u"
    """The demanded current that is late."""

    @classmethod
    def of_axis(cls, bearing: Any, typical: Typical) -> list[Delay]:
        """Return the delay of the loop, if there is one."""
        time = getattr(bearing, "delay", None)
        return [cls(time, typical.current)] if time else []

    def declare(self, plan: Plan) -> None:
        """Add the past controls."""
        samples = self.time / plan.T
        count = math.ceil(samples - 1e-9)  # what rounding makes of a whole number
        names = [f"{self.control}_{k + 1}" for k in range(count)]
        for name in names:
            plan.state(name, "A", self.size, "past control")
        for name in names[1:]:
            plan.rest(name, {names[0]: UNIT})
        if names:
            plan.past[self.control] = (names, min(samples - (count - 1), 1.0))
