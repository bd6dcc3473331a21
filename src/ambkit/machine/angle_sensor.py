"""The sensor of the rotor's angle: pulses, an encoder, or a speed signal."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity

SLOWEST = 100.0  #: A rotor is at least as fast, where nothing is said of its speed [rad/s].
SENSORS = ("pulses", "encoder", "speed")  #: In the order of ``amb_angle_sensor``.


class AngleSensor(Part):
    """How angle and speed of the rotor are measured; without one the speed is known exactly."""

    type: Literal["pulses", "encoder", "speed"] = "pulses"
    """``"pulses"`` of marks that pass (keyphasor), an incremental ``"encoder"``, or a signal of the
    ``"speed"``."""
    per_turn: Annotated[int, Field(ge=1, strict=True)] = 1
    """Pulses a turn, or steps of the encoder."""
    angle_noise: Annotated[float, Quantity("rad", "0.5 deg", above=0)] = 1e-3
    """Standard deviation of a pulse's or an encoder's angle [rad]."""
    speed_noise: Annotated[float, Quantity("rad/s", "3 rpm", above=0)] = 0.1
    """Standard deviation of a reading of the speed signal [rad/s]."""
    latency: Annotated[float, Quantity("s", "5 ms", at_least=0)] = 0.0
    """By which a reading comes late [s]; it is taken back."""
    latency_error: Annotated[float, Quantity("s", "0.2 ms", at_least=0)] = 0.0
    """Standard deviation of what is not known of the latency [s]."""
    gain_error: Annotated[float, Field(ge=0, lt=1)] = 0.0
    """Standard deviation of the speed signal's gain [1]: 0.01 is 1 %."""
    acceleration: Annotated[float, Quantity("rad/s^2", "100 rad/s^2", above=0)] = 100.0
    """Usual acceleration of the rotor [rad/s^2]; it may change by so much in a second."""
    max_speed: Annotated[float, Quantity("rad/s", "15000 rpm", above=0)] | None = None
    """Highest speed that is followed [rad/s]; without it 1.25 times the machine's."""
    reverses: bool = False
    """Whether the rotor turns both ways; pulses do not tell which."""

    def range(self, speed: float) -> tuple[float, float]:
        """Return the speeds that are followed, of a machine with a speed of its own [rad/s]."""
        most = self.max_speed or 1.25 * max(abs(speed), SLOWEST)
        if self.reverses:
            return -most, most
        return (-most, 0.0) if speed < 0 else (0.0, most)

    @property
    def direction_assumed(self) -> bool:
        """Whether the rotor turns both ways and no reading tells which."""
        return self.reverses and self.type == "pulses"

    @property
    def channel(self) -> tuple[str, str]:
        """Name and unit of its readings in a record."""
        names = {"pulses": ("pulse", "s"), "encoder": ("angle_reading", "rad")}
        return names.get(self.type, ("speed_reading", "rad/s"))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("type") == "pulses" and read("gain_error") > 0:
            yield "gain_error", 'is of a "speed" signal; pulses have none'
