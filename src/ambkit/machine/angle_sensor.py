"""Sensor of the rotor's angle: pulses, an encoder, or a speed signal."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity

SLOWEST = 100.0  #: Default minimum speed [rad/s].
SENSORS = ("pulses", "encoder", "speed")  #: In the order of ``amb_angle_sensor``.


class AngleSensor(Part):
    """Sensor of the rotor's angle and speed; without one the speed is known exactly."""

    type: Literal["pulses", "encoder", "speed"] = "pulses"
    """``"pulses"`` of marks that pass (keyphasor), an incremental ``"encoder"``, or a signal of the
    ``"speed"``."""
    per_turn: Annotated[int, Field(ge=1, strict=True)] = 1
    """Pulses per turn, or steps of the encoder."""
    angle_noise: Annotated[float, Quantity("rad", "0.5 deg", above=0)] = 1e-3
    """Standard deviation of a pulse's or an encoder's angle [rad]."""
    speed_noise: Annotated[float, Quantity("rad/s", "3 rpm", above=0)] = 0.1
    """Standard deviation of a reading of the speed signal [rad/s]."""
    latency: Annotated[float, Quantity("s", "5 ms", at_least=0)] = 0.0
    """Latency of a reading [s]; it is compensated."""
    latency_error: Annotated[float, Quantity("s", "0.2 ms", at_least=0)] = 0.0
    """Standard deviation of the error of the latency [s]."""
    gain_error: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Standard deviation of the gain error of the speed signal [1]: 0.01 is 1 %."""
    acceleration: Annotated[float, Quantity("rad/s^2", "100 rad/s^2", above=0)] = 100.0
    """Typical acceleration of the rotor [rad/s^2]; it may change by this amount within a second."""
    max_speed: Annotated[float, Quantity("rad/s", "15000 rpm", above=0)] | None = None
    """Maximum speed of the estimate [rad/s]. By default 1.25 times the machine's."""
    reverses: bool = False
    """Whether the rotor spins in both directions; pulses do not show which."""

    def range(self, speed: float) -> tuple[float, float]:
        """Return the speed range of the estimate for a machine with a speed of its own [rad/s]."""
        most = self.max_speed or 1.25 * max(abs(speed), SLOWEST)
        if self.reverses:
            return -most, most
        return (-most, 0.0) if speed < 0 else (0.0, most)

    @property
    def direction_assumed(self) -> bool:
        """Whether the rotor spins in both directions and no reading shows which."""
        return self.reverses and self.type == "pulses"

    @property
    def channel(self) -> tuple[str, str]:
        """Name and unit of its signal in a record."""
        names = {"pulses": ("pulse", "s"), "encoder": ("angle_reading", "rad")}
        return names.get(self.type, ("speed_reading", "rad/s"))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("type") == "pulses" and read("gain_error") > 0:
            yield "gain_error", 'is of a "speed" signal; pulses have none'
