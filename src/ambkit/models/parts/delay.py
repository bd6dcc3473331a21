"""Dead time between a sampling instant and the change of the amplifier's input."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class Delay:
    """Delay of commanded currents by any share of a sample or by several samples."""

    # The currents commanded in the preceding samples that still act are states ``u_1`` (of one
    # sample before), ``u_2``, ...; a delay of d samples needs ceil(d) of them.

    time: float  #: Dead time [s].
    size: float  #: Typical current [A].
    control: str = "u"  #: The delayed commanded current.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Delay]:
        """Return the dead time of each control current, if there is one."""
        if not machine.delay:
            return []
        return [
            cls(machine.delay, s.current, signal("u", a.name))
            for a, s in zip(machine.axes, sizes, strict=True)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the past controls."""
        samples = self.time / plan.T
        count = math.ceil(samples - 1e-9)  # tolerance for the rounding of a whole number
        names = [f"{self.control}_{k + 1}" for k in range(count)]
        for name in names:
            plan.state(name, "A", self.size, "past control")
        for name in names[1:]:
            plan.rest(name, {names[0]: UNIT})
        if names:
            plan.past[self.control] = (names, min(samples - (count - 1), 1.0))
