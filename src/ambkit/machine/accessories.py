"""Optional parts: angle sensor, coloured noise, runout, coils, compliant touch-down bearings."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity
from ambkit.base.units import engineering

LONGEST_DELAY = 16  #: Samples of the longest dead time of the loop (sim/parts.h).
SHORTEST_LAG = 1e-3  #: Samples of the shortest lag that differs from none.


class ColouredNoise(Part):
    """First-order coloured noise of the measured position, besides the white noise."""

    variance: Annotated[float, Quantity("m^2", "1 µm^2", above=0)]
    """Variance [m^2]."""
    bandwidth: Annotated[float, Quantity("Hz", "200 Hz", above=0)]
    """Corner frequency of its spectrum [Hz]."""


class Hum(Part):
    """Line noise: a narrow-band component of the measured position, with random phase."""

    frequency: Annotated[float, Quantity("Hz", "50 Hz", above=0)]
    """Frequency [Hz]."""
    amplitude: Annotated[float, Quantity("m", "5 µm", above=0)]
    """Amplitude [m]; of a line with finite width its root mean square."""
    bandwidth: Annotated[float, Quantity("Hz", "0.5 Hz", at_least=0)] = 0.0
    """Half width of the line at -3 dB, by which amplitude and phase vary [Hz]."""


class Runout(Part):
    """Runout of the sensor target: ``amplitude cos(order speed t + phase)``."""

    order: Annotated[int, Field(ge=1, le=5, strict=True)]
    """Order: periods per revolution, 1 to 5."""
    amplitude: Annotated[float, Quantity("m", "3 µm", above=0)]
    """Amplitude [m]."""
    phase: Annotated[float, Quantity("rad", "30 deg")] = 0.0
    """Phase at the start [rad]."""


REFERENCE = 293.15  #: Reference temperature of coil resistances: 20 degrees Celsius [K].


class Coil(Part):
    """Thermal model of each coil of an axis: one body with one cooling path."""

    # The amplifier's resistance is that at 293.15 K; it is linear in the temperature.

    thermal_resistance: Annotated[float, Quantity("K/W", "1.5 K/W", above=0)]
    """Thermal resistance from a coil to its coolant [K/W]."""
    time_constant: Annotated[float, Quantity("s", "20 min", above=0)] | None = None
    """Thermal time constant: heat capacity times resistance [s]."""
    ambient: Annotated[float, Quantity("K", "313 K", above=0)] = REFERENCE
    """Temperature of the coolant [K]; 273.15 K is 0 degrees Celsius."""
    temperature_limit: Annotated[float, Quantity("K", "403 K", above=0)] | None = None
    """Permissible temperature of the winding [K]: that of its insulation, less hot spots."""
    temperature_coefficient: Annotated[float, Quantity("1/K", "3.93e-3 1/K", at_least=0)] = 3.93e-3
    """Temperature coefficient of the resistance at 293.15 K [1/K]. By default copper's."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        ambient, limit = read("ambient"), read("temperature_limit")
        if limit is not None and limit <= ambient:
            limit_text = f"{engineering(ambient, 'K')}, what cools it; is {engineering(limit, 'K')}"
            yield "temperature_limit", f"must be greater than {limit_text}"


class Stop(Part):
    """Touch-down bearing with contact force ``stiffness d^1.5 (1 + 3/2 damping d')`` at depth d."""

    # Hunt and Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975.
    # After an impact at v the rotor rebounds at ``(1 - damping v) v`` for a small loss. The force
    # never pulls.

    stiffness: Annotated[float, Quantity("N/m^1.5", "1e8 N/m^1.5", above=0)]
    """Stiffness [N/m^1.5]."""
    damping: Annotated[float, Quantity("s/m", "0.3 s/m", at_least=0)] = 0.0
    """Decrease of the coefficient of restitution per impact velocity [s/m]."""
    friction: Annotated[float, Quantity("1", "0.1", at_least=0)] | None = None
    """Coefficient of sliding friction between rotor and ring, with two axes [1]."""
    radius: Annotated[float, Quantity("m", "20 mm", above=0)] | None = None
    """Radius of the rotor at the ring [m], required with friction."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("friction") is not None and read("radius") is None:
            yield "radius", "missing: friction acts on the surface of the rotor, at this radius"

    def core(self) -> dict[str, float]:
        """Return it by the fields of ``amb_parts``."""
        return {key: value or 0.0 for key, value in self.model_dump().items()}


def delay_contradictions(T: float, delay: float | None) -> Iterator[tuple[str, str]]:
    """Yield errors of the dead time of a loop with the sampling time T [s]."""
    if delay is not None and delay > LONGEST_DELAY * T:
        limit = f"{LONGEST_DELAY} samples, {engineering(LONGEST_DELAY * T, 's')}"
        yield "delay", f"must be at most {limit}; is {engineering(delay, 's')}"


def eddy_current_contradictions(T: float, bearings: Any) -> Iterator[tuple[str, str]]:
    """Yield errors of the solid iron of magnets in a loop with the sampling time T [s]."""
    least, most = 1e-3 / (2 * math.pi * T), 0.5 / T
    for at, bearing in enumerate(bearings if isinstance(bearings, tuple) else ()):
        corner = bearing.magnet.eddy_current_corner
        if corner is not None and (corner < least or corner > most):
            limits = f"{engineering(least, 'Hz')} to {engineering(most, 'Hz')}"
            text = f"must be {limits} at this sampling time; is {engineering(corner, 'Hz')}"
            yield f"bearing.{at}.magnet.eddy_current_corner", text


def voltage_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield errors of an amplifier's voltage limit for its magnet."""
    voltage, R = read("amplifier.voltage_limit"), read("amplifier.resistance")
    if voltage is not None and R is not None:
        needed = R * (read("magnet.bias_current") + read("amplifier.current_limit"))
        if voltage <= needed:
            limit = f"{engineering(needed, 'V')}, which the greatest coil current needs at rest"
            text = f"must be greater than {limit}; is {engineering(voltage, 'V')}"
            yield "amplifier.voltage_limit", text


def coil_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield missing values of a coil's thermal model."""
    if read("coil") is not None and read("amplifier.resistance") is None:
        yield "amplifier.resistance", "missing: with it a coil warms by its current"


def gap_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    """Yield contradictions of gap, bias current and the limits of displacement and current."""
    way, gap = read("clearance"), read("magnet.air_gap")
    if way >= gap:
        limit = f"magnet.air_gap, {engineering(gap, 'm')}"
        yield "clearance", f"must be less than {limit}; is {engineering(way, 'm')}"
    current, bias = read("amplifier.current_limit"), read("magnet.bias_current")
    if read("magnet.type") == "two-sided" and current > bias:
        limit = f"magnet.bias_current, {engineering(bias, 'A')}, with a two-sided magnet"
        yield "amplifier.current_limit", f"must be at most {limit}; is {engineering(current, 'A')}"


def line_contradictions(
    T: float, speed: float | None, runout: Any, hum: Any
) -> Iterator[tuple[str, str]]:
    """Yield (key of the sensor, error) for lines too fast for the sampling time T [s]."""
    for at, line in enumerate(runout if isinstance(runout, tuple) else ()):
        frequency = line.order * (speed or 0.0) / (2 * math.pi)
        if 2 * T * frequency >= 1:
            text = f"{line.order} times the speed is {engineering(frequency, 'Hz')}, must be"
            limit = f"less than half the sampling frequency, {engineering(0.5 / T, 'Hz')}"
            yield f"runout.{at}.order", f"{text} {limit}"
    for at, line in enumerate(hum if isinstance(hum, tuple) else ()):
        if 2 * T * line.frequency >= 1:
            nyquist = engineering(0.5 / T, "Hz")
            text = f"must be less than half the sampling frequency, {nyquist}"
            yield f"hum.{at}.frequency", f"{text}; is {engineering(line.frequency, 'Hz')}"


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


def rotation_signal(angle: AngleSensor | None) -> str:
    """Return the signal that a controller reads of the rotation: the sensor's, or the speed."""
    return "speed" if angle is None else angle.channel[0]
