"""Magnet force on the rotor; with fast bending modes the model includes k_i of its law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.declaration import Place, Plan, place
from ambkit.models.parts.typical_sizes import Typical

TURN = 0.5
"""Phase of a bending mode per sample [rad] up to which a magnet force may be held over it."""


@dataclass(frozen=True)
class MagnetForce:
    """A magnet's force, and the displacement on which it depends."""

    size: float  #: Typical force [N].
    force: str = "f"  #: Name of the force.
    place: Place = "x"  #: Place of the force.
    k_i: float | None = None
    """Current stiffness [N/A], for changes of the force within a sample; None: held."""

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[MagnetForce]:
        """Return the magnet places of each axis."""
        # Whether a mode is fast enough to follow the current within a sample.
        bending = machine.bending
        fast = bending is not None and max(bending.frequency) * machine.sampling_time > TURN
        return [
            cls(
                s.force, signal("f", a.name), place(a.line.form),
                ConstantStiffness.of(machine.isolated_axis(a.name)).k_i if fast else None,
            )
            for a, s in zip(machine.axes, sizes, strict=True)
        ]  # fmt: skip

    def declare(self, plan: Plan) -> None:
        """Add the force."""
        plan.force(self.force, self.size, self.place, self.k_i)
