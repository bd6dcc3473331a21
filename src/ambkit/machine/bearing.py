"""The bearing: magnet, rotor, amplifier and sensor, from TOML with units."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

from pydantic import (
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from ambkit.base.config import Document, Part, Read, read_unchecked, reader
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.texts import Description, Name
from ambkit.base.units import engineering
from ambkit.machine.parts import ColouredNoise, Hum, Runout, Stop, parts_contradictions

MU_0 = 1.25663706127e-6
"""Vacuum magnetic permeability [N/A^2] (CODATA 2022)."""

GRAVITY = 9.81
"""Acceleration of free fall [m/s^2], as both rigs of the presets were calculated with."""


def magnet_constant(turns: float, pole_area: float) -> float:
    """Return k = mu0 A N^2 / 4 [N m^2/A^2] (paper, below eq. 1).

    Parameters
    ----------
    turns : float
        Turns N of one magnet's coil.
    pole_area : float
        Cross section A of one air gap [m^2].
    """
    return MU_0 * pole_area * turns**2 / 4


def _constant_or_coil(schema: dict[str, Any]) -> None:
    """Tell the JSON schema that a magnet has either a magnet constant or a coil."""
    schema["required"].remove("magnet_constant")
    alternatives = (["magnet_constant"], ["turns", "pole_area"])
    schema["oneOf"] = [{"required": keys} for keys in alternatives]


class Magnet(Part):
    """The electromagnets of one axis, and the law of their force.

    With the magnet constant k, the bias current i0, the gap s0, the control current iu and the
    displacement x, a two-sided magnet pulls with
    ``F = k [((i0 + iu)/(s0 - x))^2 - ((i0 - iu)/(s0 + x))^2]`` (paper, eq. 1, without its second
    equality, a slip), a one-sided one with its first half alone: x is positive towards it.
    """

    model_config = ConfigDict(json_schema_extra=_constant_or_coil)

    type: Literal["two-sided", "one-sided"]
    """Pulls both ways, or one way with gravity as the counter-force."""
    turns: Annotated[int, Field(gt=0, le=1_000_000, strict=True)] | None = None
    """Turns N of one coil; with pole_area instead of magnet_constant."""
    pole_area: Annotated[float, Quantity("m^2", "400 mm^2", above=0)] | None = None
    """Cross section A of one air gap [m^2]; with turns instead of magnet_constant."""
    magnet_constant: Annotated[float, Quantity("N m^2/A^2", "6.7 N mm^2/A^2", above=0)]
    """Magnet constant k [N m^2/A^2], or else turns and pole_area."""
    air_gap: Annotated[float, Quantity("m", "2 mm", above=0)]
    """Nominal air gap s0 [m], at x = 0."""
    bias_current: Annotated[float, Quantity("A", "1.5 A", above=0)]
    """Bias current i0 [A]."""

    @model_validator(mode="before")
    @classmethod
    def _constant_from_coil(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict) or "magnet_constant" in data:
            return data
        if data.get("turns") is None and data.get("pole_area") is None:
            return data
        constant = _coil_constant(read_unchecked(cls, data, info.context))
        if math.isnan(constant):
            constant = 1.0  # turns or pole_area is wrong or missing: that is told, k is no mistake
        return data | {"magnet_constant": engineering(constant, "N m^2/A^2", digits=None)}

    @model_serializer(mode="wrap")
    def _without_derived(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        if self.turns is not None:
            del data["magnet_constant"]
        return data

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        turns, area, constant = read("turns"), read("pole_area"), read("magnet_constant")
        if turns is None and area is not None:
            yield "turns", "missing: pole_area alone does not give the magnet constant"
        if area is None and turns is not None:
            yield "pole_area", "missing: turns alone do not give the magnet constant"
        coil = _coil_constant(read)
        if abs(coil - constant) > 1e-9 * constant:
            shown = engineering(coil, "N m^2/A^2")
            yield "magnet_constant", f"turns and pole_area give {shown}; give one or the other"


def _coil_constant(read: Read) -> float:
    turns, area = read("turns"), read("pole_area")
    return math.nan if turns is None or area is None else magnet_constant(turns, area)


class Rotor(Part):
    """The rotor along one axis."""

    mass: Annotated[float, Quantity("kg", "0.518 kg", above=0)]
    """Mass m [kg]."""
    gravity: Literal["-x", "+x", "none"]
    """Direction in which gravity pulls; "none" for a horizontal axis."""
    travel_limit: Annotated[float, Quantity("m", "1 mm", above=0)]
    """Greatest displacement |x| [m], where the rotor meets a stop; less than the air gap."""


class Amplifier(Part):
    """The current amplifier: iu = gain u, within the limit."""

    gain: Annotated[float, Quantity("A/V", "1 A/V", above=0)]
    """Gain k_ui [A/V], control current by control signal."""
    current_limit: Annotated[float, Quantity("A", "1.5 A", above=0)]
    """Greatest control current |iu| [A]."""
    noise_variance: Annotated[float, Quantity("V^2", "8e-5 V^2", above=0)]
    """Variance of the noise on the control signal [V^2] (paper: process noise)."""
    bandwidth: Annotated[float, Quantity("Hz", "2 kHz", above=0)] | None = None
    """Corner frequency of the current, which follows as a first-order lag [Hz]; at once without."""
    voltage_limit: Annotated[float, Quantity("V", "150 V", above=0)] | None = None
    """Greatest voltage of a coil, either way [V]; with bandwidth and resistance."""
    resistance: Annotated[float, Quantity("ohm", "2 ohm", above=0)] | None = None
    """Resistance R of a coil [ohm]; with voltage_limit."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        bandwidth, voltage, R = read("bandwidth"), read("voltage_limit"), read("resistance")
        if voltage is not None:
            if bandwidth is None:
                yield "bandwidth", "missing: voltage_limit limits what the current follows with"
            if R is None:
                yield "resistance", "missing: voltage_limit alone does not give the current's slew"
        elif R is not None:
            yield "voltage_limit", "missing: resistance counts only with it"


class Sensor(Part):
    """The position sensor: a first-order lag with noise (paper, eq. 18).

    It sees the displacement and the runout, bends it to ``x (1 + quadratic x + cubic x^2)``, and
    lags; then come gain, noise and rounding.
    """

    gain: Annotated[float, Quantity("1", "1", above=0)]
    """Gain K_Sen [1]."""
    lag: Annotated[float, Quantity("s", "0.2 ms", above=0)]
    """Time constant T_Sen of the lag [s]."""
    noise_variance: Annotated[float, Quantity("m^2", "83 µm^2", above=0)]
    """Variance of the noise on the measured position [m^2]."""
    quantisation: Annotated[float, Quantity("m", "0.5 µm", above=0)] | None = None
    """Step of the measured position [m]; none without."""
    quadratic: Annotated[float, Quantity("1/m", "20 1/m")] = 0.0
    """Part of the sensor's non-linearity [1/m]."""
    cubic: Annotated[float, Quantity("1/m^2", "1e4 1/m^2")] = 0.0
    """Part of the sensor's non-linearity [1/m^2]."""
    coloured_noise: ColouredNoise | None = None
    """Noise of first order, beside the white one."""
    hum: tuple[Hum, ...] = ()
    """Narrow lines in the measured position."""
    runout: tuple[Runout, ...] = ()
    """Runout at multiples of the bearing's speed."""

    @model_serializer(mode="wrap")
    def _without_absent(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data: dict[str, Any] = handler(self)
        absent = ("quadratic", "cubic", "hum", "runout")
        return {k: each for k, each in data.items() if k not in absent or getattr(self, k)}


class Bearing(Document):
    """One axis of an active magnetic bearing.

    Frozen, and checked as a whole: from TOML (`load`, `from_toml`, `preset`) or from Python, where
    numbers are SI and strings carry units.

    Examples
    --------
    >>> bearing = Bearing.preset("zittau_axial")
    >>> bearing.magnet.air_gap
    0.002
    >>> bearing.replace(magnet__air_gap="2.2 mm").magnet.air_gap
    0.0022
    """

    name: Annotated[Name, Field(min_length=1)]
    """Short name."""
    description: Description = ""
    """What it is, in a sentence."""
    source: Description = ""
    """Where its values come from."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)]
    """Sampling time T of controller and estimator [s]."""
    delay: Annotated[float, Quantity("s", "0.15 ms", above=0)] | None = None
    """Dead time from a sample to the change of the control current that it leads to [s]."""
    speed: Annotated[float, Quantity("rad/s", "12000 rpm", at_least=0)] | None = None
    """Speed of rotation [rad/s], of which runout has its frequencies."""
    magnet: Magnet
    """The electromagnets."""
    rotor: Rotor
    """The rotor."""
    amplifier: Amplifier
    """The amplifier."""
    sensor: Sensor
    """The position sensor."""
    stop: Stop | None = None
    """Stops that give way, and bounce; without it the rotor stays where it touches one."""

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return a bearing that comes with ambkit.

        Parameters
        ----------
        name : str
            One of `ambkit.machine.presets.names`.

        Raises
        ------
        AmbkitError
            There is no preset of that name.
        """
        from ambkit.machine import presets

        return cls.from_toml(presets.text(name), name=f"{name}.toml")

    @property
    def weight(self) -> float:
        """Force of gravity along +x [N], negative where gravity pulls towards -x."""
        return _WEIGHT_SIGN[self.rotor.gravity] * self.rotor.mass * GRAVITY

    @property
    def current_min(self) -> float:
        """Least control current iu [A]; a one-sided coil's current i0 + iu stays positive."""
        if self.magnet.type == "one-sided":
            return -min(self.amplifier.current_limit, self.magnet.bias_current)
        return -self.amplifier.current_limit

    @property
    def current_max(self) -> float:
        """Greatest control current iu [A]."""
        return self.amplifier.current_limit

    @property
    def hover_current(self) -> float:
        """Control current iu [A] that carries the rotor at rest at x = 0.

        It solves ``F(iu, 0) + weight = 0``; two-sided: ``iu = -weight s0^2 / (4 k i0)``, one-sided:
        ``iu = s0 sqrt(-weight/k) - i0``.
        """
        return _hover_current(reader(self))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        travel, gap = read("rotor.travel_limit"), read("magnet.air_gap")
        if travel >= gap:
            limit = f"magnet.air_gap, {engineering(gap, 'm')}"
            yield "rotor.travel_limit", f"must be less than {limit}; is {engineering(travel, 'm')}"

        kind, gravity = read("magnet.type"), read("rotor.gravity")
        if kind == "one-sided" and gravity in ("+x", "none"):
            text = f'must be "-x", is "{gravity}": nothing else pulls against a one-sided magnet'
            yield "rotor.gravity", text

        current, bias = read("amplifier.current_limit"), read("magnet.bias_current")
        if kind == "two-sided" and current > bias:
            limit = f"magnet.bias_current, {engineering(bias, 'A')}, with a two-sided magnet"
            yield (
                "amplifier.current_limit",
                f"must be at most {limit}; is {engineering(current, 'A')}",
            )
        hover = abs(_hover_current(read))
        if hover > current:
            limit = f"{engineering(hover, 'A')}, which carries the rotor at x = 0"
            yield (
                "amplifier.current_limit",
                f"must be at least {limit}; is {engineering(current, 'A')}",
            )
        yield from parts_contradictions(read)


_WEIGHT_SIGN = {"-x": -1.0, "+x": 1.0, "none": 0.0}


def _hover_current(read: Read) -> float:
    constant, gap = read("magnet.magnet_constant"), read("magnet.air_gap")
    bias, kind = read("magnet.bias_current"), read("magnet.type")
    weight = _WEIGHT_SIGN.get(read("rotor.gravity"), math.nan) * read("rotor.mass") * GRAVITY
    if kind == "two-sided":
        # In this order, not by powers: an absurd value gives infinity, not an arithmetic error.
        return float(-weight / constant * gap / bias * gap / 4)
    if kind == "one-sided" and weight < 0:
        return float(gap * math.sqrt(-weight / constant) - bias)
    return math.nan
