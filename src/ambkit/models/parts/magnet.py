"""Where a magnet pulls at the rotor; its law is no part of the linear model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import Place, Plan, place
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class MagnetPlace:
    """A magnet's force, and the displacement on which it depends."""

    size: float  #: Typical force [N].
    force: str = "f"  #: Name of the force.
    place: Place = "x"  #: Where it pulls.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[MagnetPlace]:
        """Return where the magnets of each axis pull."""
        return [
            cls(s.force, signal("f", a.name), place(a.line.form))
            for a, s in zip(machine.axes, sizes, strict=True)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the force."""
        plan.force(self.force, self.size, self.place)
