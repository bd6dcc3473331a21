"""Disturbance force: a random walk, whose intensity is the process noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import Place, Plan
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class Disturbance:
    """A random walk [N]; its variance is that of the growth in one sample [N^2]."""

    size: float  #: Typical force [N].
    growth: float  #: Typical growth in a sample [N].
    name: str = "f_d"  #: Name of the state.
    rides: str | None = "f"  #: Magnet force at whose place it acts; None: at `place`.
    place: Place = "x"  #: Place, away from the magnets.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Disturbance]:
        """Return one for each axis, at the place of its magnet force."""
        return [
            cls(s.force, 1e-3 * s.force, signal("f_d", a.name), signal("f", a.name))
            for a, s in zip(machine.axes, sizes, strict=True)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the state and its noise."""
        plan.state(self.name, "N", self.size, "disturbance force")
        if self.rides is None:
            plan.push(self.name, self.place)
        else:
            plan.riders[self.name] = self.rides  # held over the sample like the magnet force
        plan.noise(self.name, "N", self.growth, {self.name: 1 / plan.T}, walk=True)
