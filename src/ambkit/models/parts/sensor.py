"""Position sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ambkit.data.signals import signal
from ambkit.models.declaration import UNIT, Place, Plan, place, row
from ambkit.models.parts.typical_sizes import Typical


@dataclass(frozen=True)
class Sensor:
    """A gain and a first-order lag (paper, eq. 18); without the lag there is no state."""

    gain: float  #: Gain K_sen [1].
    lag: float | None  #: Time constant T_sen [s].
    size: float  #: Typical reading [m].
    measurement: str = "y"  #: Name of the measurement.
    state: str = "x_m"  #: Name of the lagged position.
    place: Place = "x"  #: Place of the measurement.

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Sensor]:
        """Return one for each reading."""
        far = max(s.displacement for s in sizes)
        return [
            cls(
                r.sensor.gain, machine.lag_of(r.sensor), abs(r.sensor.gain) * far,
                signal("y", r.name), signal("x_m", r.name), place(r.line.form),
            )
            for r in machine.readings
        ]  # fmt: skip

    def declare(self, plan: Plan) -> None:
        """Add the measurement, and the lagged position if there is a lag."""
        seen = {position: self.gain * value for position, value in row(self.place).items()}
        if self.lag is None:
            plan.measure(self.measurement, "m", self.size, seen)
            return
        plan.state(self.state, "m", self.size, "sensor")
        for position, value in seen.items():
            plan.rate(self.state, position, value / self.lag)
        plan.rate(self.state, self.state, -1 / self.lag)
        plan.rest(self.state, seen)
        plan.measure(self.measurement, "m", self.size, {self.state: UNIT})
