"""A rotor without known forces, but with white acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import Part, Plan
from ambkit.models.parts.amplifier import Amplifier
from ambkit.models.parts.disturbance import Disturbance
from ambkit.models.parts.magnet import MagnetForce
from ambkit.models.parts.rotor import Rotor
from ambkit.models.parts.sensor import Sensor
from ambkit.models.parts.typical_sizes import Typical

#: Time [s] in which the variance of the disturbance force grows by its initial value.
FORGOTTEN = 0.5


@dataclass(frozen=True)
class UnknownForce:
    """A force without effect: its estimate stays zero, its variance the initial one."""

    size: float  #: Typical force [N].
    name: str = "f_d"  #: Name of the state.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[UnknownForce]:
        """Return that of each axis."""
        return [
            cls(s.force, signal("f_d", a.name)) for a, s in zip(machine.axes, sizes, strict=True)
        ]

    def declare(self, plan: Plan) -> None:
        """Add the state and its noise."""
        plan.state(self.name, "N", self.size, "disturbance force")
        plan.rate(self.name, self.name, -1 / FORGOTTEN)
        plan.noise(self.name, "N", self.size, {self.name: 1 / plan.T}, walk=False)


@dataclass(frozen=True)
class WhiteAcceleration:
    """White acceleration of every coordinate (Bar-Shalom, Li and Kirubarajan 2001, ch. 6.2)."""

    #: Intensity for a displacement [m^2/s^3]; for others by the ratio of velocities.
    intensity: float

    def declare(self, plan: Plan) -> None:
        """Add a noise for each velocity."""
        driven = [s for s in plan.states if s.role in ("velocity", "bending velocity")]
        typical = max(s.size for s in driven)
        for state in driven:
            size = self.intensity**0.5 * state.size / typical
            plan.noise(f"a_{state.name}", f"{state.unit}/s^0.5", size, {state.name: 1.0},
                       walk=False)  # fmt: skip


def plain_parts(machine: Any, **_: Any) -> list[Part]:
    """Return a machine's rotor, magnets, disturbance forces and sensors only."""
    sizes = [Typical.of(machine.isolated_axis(axis.name)) for axis in machine.axes]
    known = (kind.of(machine, sizes) for kind in (Rotor, MagnetForce, Disturbance, Sensor))
    currents = (replace(item, bandwidth=None) for item in Amplifier.of(machine, sizes))
    return [*(part for parts in known for part in parts), *currents]


def free_parts(machine: Any, acceleration: float, **_: Any) -> list[Part]:
    """Return a machine's rotor, magnets and sensors without lags and forces."""
    sizes = [Typical.of(machine.isolated_axis(axis.name)) for axis in machine.axes]
    return [
        *Rotor.of(machine, sizes),
        *MagnetForce.of(machine, sizes),
        *UnknownForce.of(machine, sizes),
        WhiteAcceleration(acceleration),
        *(replace(item, lag=None) for item in Sensor.of(machine, sizes)),
        *(replace(item, bandwidth=None) for item in Amplifier.of(machine, sizes)),
    ]
