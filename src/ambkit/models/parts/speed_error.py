"""Error of a measured speed of rotation, which also rotates synchronous states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.models.declaration import Plan

NAME = "speed_error"  #: Name of the state.


@dataclass(frozen=True)
class SpeedError:
    """A state whose variance and column of the transition are set by the core at each sample."""

    # The core rotates each pair of synchronous states by n T times the error, and linearises about
    # the estimated pair (``core/include/ambkit/turning.h``). Here the column is zero.

    size: float  #: Initial standard deviation, before the first reading [rad/s].
    pairs: tuple[tuple[str, str], ...]  #: Pairs of synchronous states.

    @classmethod
    def of(cls, machine: Any, synchronous: Sequence[Any]) -> list[SpeedError]:
        """Return it if the machine has an angle sensor."""
        if machine.angle is None:
            return []
        pairs = tuple(part.rotating[:2] for part in synchronous)
        most = max(map(abs, machine.angle.range(machine.speed)))
        return [cls(most, pairs)]

    def declare(self, plan: Plan) -> None:
        """Add the state, its noise, and its place in the transition."""
        plan.state(NAME, "rad/s", self.size, "speed error")
        for pair in self.pairs:
            for state in pair:
                plan.rate(state, NAME, 0.0)
        plan.noise(NAME, "rad/s", self.size, {NAME: 1 / plan.T}, walk=False)
