"""Where a magnet pulls at the rotor; its law is no part of the linear model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ambkit.models.parts.typical import Typical
from ambkit.models.plan import Place, Plan


@dataclass(frozen=True)
class MagnetPlace:
    """A magnet's force, and the displacement on which it depends."""

    size: float
    """Typical force [N]."""
    force: str = "f"
    """Name of the force."""
    place: Place = "x"
    """Where it pulls."""

    @classmethod
    def of_axis(cls, bearing: Any, typical: Typical) -> list[MagnetPlace]:
        """Return the one place of an axis's magnets."""
        return [cls(typical.force)]

    def declare(self, plan: Plan) -> None:
        """Add the force."""
        plan.force(self.force, self.size, self.place)
