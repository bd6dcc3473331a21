"""The error of a measured speed of rotation, by which synchronous states turn too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.models.declaration import Plan

NAME = "speed_error"  #: The state.


@dataclass(frozen=True)
class SpeedError:
    """A state of which the core fills variance and column of the transition at each sample."""

    # The core turns each pair of synchronous states by n T times the error, and linearises about
    # the estimated pair (``core/include/ambkit/turning.h``). Here the column is zero.

    size: float  #: What it is at the start, when no reading came [rad/s].
    pairs: tuple[tuple[str, str], ...]  #: What turns.

    @classmethod
    def of(cls, machine: Any, synchronous: Sequence[Any]) -> list[SpeedError]:
        """Return it where the machine has a sensor of its angle."""
        if machine.angle is None:
            return []
        pairs = tuple(part.rotating[:2] for part in synchronous)
        most = max(map(abs, machine.angle.range(machine.speed)))
        return [cls(most, pairs)]

    def declare(self, plan: Plan) -> None:
        """Add the state, its noise, and where it will act."""
        plan.state(NAME, "rad/s", self.size, "speed error")
        for pair in self.pairs:
            for state in pair:
                plan.rate(state, NAME, 0.0)
        plan.noise(NAME, "rad/s", self.size, {NAME: 1 / plan.T}, walk=False)
