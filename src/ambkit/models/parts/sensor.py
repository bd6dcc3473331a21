"""A position sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Place, Plan, row


@dataclass(frozen=True)
class Sensor:
    """A gain and a first-order lag (paper, eq. 18); without the lag there is no state."""

    gain: float
    """Gain K_sen [1]."""
    lag: float | None
    """Time constant T_sen [s]."""
    size: float
    """Typical reading [m]."""
    measurement: str = "y"
    """Name of the measurement."""
    state: str = "x_m"
    """Name of the lagged position."""
    place: Place = "x"
    """Where it looks."""

    @classmethod
    def of_axis(cls, bearing: Any, typical: Typical) -> list[Sensor]:
        """Return the sensor of an axis."""
        sensor = bearing.sensor
        lag = bearing.sensor_lag if sensor.lag else None
        return [cls(sensor.gain, lag, abs(sensor.gain) * typical.displacement)]

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
