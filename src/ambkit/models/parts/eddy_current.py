"""Eddy currents in a magnet's iron: its force lags behind (Schweitzer and Maslen 2009)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ambkit.data.signals import signal
from ambkit.machine.accessories import SHORTEST_LAG
from ambkit.models.declaration import Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class EddyCurrents:
    """A first-order lag between the force that a magnet's law gives and the one that acts."""

    key: ClassVar[str] = "eddy_current_lag"  #: Of the magnet, without which there is none.
    lag: float  #: Time constant [s].
    size: float  #: Typical force [N].
    force: str = "f"  #: The magnet force that lags.
    state: str = "f_e"  #: Name of the force that acts, a filter's with the weight that it knows.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[EddyCurrents]:
        """Return those of each axis whose magnet has any."""
        shortest = SHORTEST_LAG * machine.sampling_time
        return [
            cls(max(lag, shortest), s.force, signal("f", a.name), signal("f_e", a.name))
            for a, s in zip(machine.axes, sizes, strict=True)
            if (lag := a.bearing.magnet.eddy_current_lag) is not None
        ]

    def declare(self, plan: Plan) -> None:
        """Add the force that acts instead of the magnet's."""
        plan.state(self.state, "N", self.size, "lagged force")
        plan.rate(self.state, self.force, 1 / self.lag)
        plan.rate(self.state, self.state, -1 / self.lag)
        plan.act_by(self.force, self.state)
