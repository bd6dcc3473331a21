"""Parts of an axis: magnet, rotor, amplifier and sensor, from TOML with units."""

import math
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    ValidationInfo,
    WithJsonSchema,
    model_serializer,
    model_validator,
)

from ambkit.base.config import Part, Read, read_unchecked
from ambkit.base.config.quantities import FilePath, InOther, Quantity, from_folder
from ambkit.base.config.toml_text import flattened, nested
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.machine.accessories import ColouredNoise, Hum, Runout
from ambkit.machine.laws import LawKeys
from ambkit.machine.magnets import MU_0, magnet_of

GRAVITY = 9.81  #: Acceleration of gravity [m/s^2] in both rigs of the presets.


UNREADABLE = {
    "type": "two-sided", "magnet_constant": "1 N m^2/A^2", "air_gap": "1 m", "bias_current": "1 A",
}  # fmt: skip
"""Placeholder for the keys of an invalid drawing, whose error is reported instead."""


def magnet_constant(turns: float, pole_area: float, pole_angle: float = 0.0) -> float:
    """Return k = mu0 A N^2 cos(angle) / 4 [N m^2/A^2] (paper, below eq. 1)."""
    return MU_0 * pole_area * turns**2 / 4 * math.cos(pole_angle)


def _constant_or_coil(schema: dict[str, Any]) -> None:
    """State in the JSON schema that a magnet has either a magnet constant or a coil."""
    schema["required"].remove("magnet_constant")
    alternatives = (["magnet_constant"], ["turns", "pole_area"])
    schema["oneOf"] = [{"required": keys} for keys in alternatives]
    schema["dependentRequired"] = {"pole_angle": ["turns"]} | {
        key: ["turns", *(other for other in IRON if other != key)] for key in IRON
    }


IRON = ("iron_length", "relative_permeability", "saturation")
"""Parameters of saturating iron; all of them or none."""


FILES = ("force_map", "force_channels")  #: Keys that name a file.


def _pairs(tables: Any) -> tuple[tuple[str, Any], ...]:
    return tuple(flattened(tables).items()) if isinstance(tables, dict) else tables


def _tables(pairs: tuple[tuple[str, Any], ...]) -> dict[str, Any]:
    return nested((key.split("."), value) for key, value in pairs)


class Magnet(LawKeys):
    """The electromagnets of one axis, and their force law."""

    # With the magnet constant k, the bias current i0, the gap s0, the control current iu and the
    # displacement x, the force of a two-sided magnet is ``F = k [((i0 + iu)/(s0 - x))^2 - ((i0 -
    # iu)/(s0 + x))^2]`` (paper, eq. 1, without its second equality, a slip), that of a one-sided
    # one the first half alone: x is positive towards it. Saturating iron reduces it
    # (`ambkit.SaturatingLaw`).

    model_config = ConfigDict(json_schema_extra=_constant_or_coil)
    unwritten = ("drawing", "both_axes")

    type: Literal["two-sided", "one-sided"]
    """Two magnets in opposite directions, or one against gravity."""
    turns: Annotated[int, Field(gt=0, le=1_000_000, strict=True)] | None = None
    """Turns N of one coil; with pole_area instead of magnet_constant."""
    pole_area: Annotated[float, Quantity("m^2", "400 mm^2", above=0)] | None = None
    """Cross section A of one air gap [m^2]; with turns instead of magnet_constant."""
    pole_angle: Annotated[float, Quantity("rad", "22.5 deg", at_least=0)] | None = None
    """Angle between the force of a pole and the axis [rad], whose cosine reduces the force from
    turns and pole_area. By default 0.
    """
    iron_length: Annotated[float, Quantity("m", "0.2 m", above=0)] | None = None
    """Mean length of the flux path in the iron of one magnet [m]; if it saturates."""
    relative_permeability: Annotated[float, Quantity("1", "2000", above=0)] | None = None
    """Relative permeability mu_r of that iron, far from saturation [1]."""
    saturation: Annotated[float, Quantity("T", "1.6 T", above=0)] | None = None
    """Saturation flux density Bs of that iron [T]."""
    force_map: FilePath | None = None
    """File with the measured or computed force, points of iu, x and f_mag: the surface through them
    is the magnet, and the law extrapolates it. Or a drawing (.toml), whose field is solved;
    type, magnet_constant, air_gap, bias_current and, with conducting iron, eddy_current_corner
    or _lag are then the drawing's unless stated here.
    """
    drawing: Annotated[
        tuple[tuple[str, Any], ...], BeforeValidator(_pairs), PlainSerializer(_tables),
        WithJsonSchema({"type": "object"}),
    ] = ()  # fmt: skip
    """Values that differ from the drawing's, by its keys, as ``drawing.iron.saturation = "1.7 T"``;
    its gap and bias current are air_gap and bias_current.
    """
    both_axes: bool = False
    """For a radial bearing's drawing: the plant has the force over currents and displacements of
    both axes, which share their iron; filters model the axes separately.
    """
    force_channels: FilePath | None = None
    """TOML file with the meaning of the force map's columns, if their names differ."""
    force_scale: Annotated[float, Quantity("1", "1", above=0)] | None = None
    """Factor on the force of the force map [1]. By default 1."""
    magnet_constant: Annotated[float, Quantity("N m^2/A^2", "6.7 N mm^2/A^2", above=0)]
    """Magnet constant k [N m^2/A^2] as of ideal iron, or else turns and pole_area."""
    air_gap: Annotated[float, Quantity("m", "2 mm", above=0)]
    """Nominal air gap s0 [m], at x = 0."""
    bias_current: Annotated[float, Quantity("A", "1.5 A", above=0)]
    """Bias current i0 [A]."""
    eddy_current_lag: Annotated[float, Quantity("s", "50 µs", above=0)] | None = None
    """Time constant of the force's lag due to eddy currents in the iron [s]. By default none."""
    eddy_current_corner: Annotated[float, Quantity("Hz", "100 Hz", above=0)] | None = None
    """Corner frequency f_c of the half-order lag 1/(1 + sqrt(s/(2 pi f_c))) of a magnet of solid
    iron [Hz], approximated by five first-order lags over the three decades up to 1/(2 pi
    sampling_time).
    """

    @model_validator(mode="before")
    @classmethod
    def _constant_from_coil(cls, data: Any, info: ValidationInfo) -> Any:
        if not isinstance(data, dict):
            return data
        if str(data.get("force_map", "")).endswith(".toml"):
            from ambkit.machine.forces.drawing import stated_by

            stated = UNREADABLE
            with suppress(AmbkitError):  # reported by `_contradictions`
                changes = dict(_pairs(data.get("drawing", ())))
                stated = stated_by(from_folder(data["force_map"], info), changes)
            if "eddy_current_lag" in data or "eddy_current_corner" in data:
                stated = {key: of for key, of in stated.items() if "eddy_current" not in key}
            data = stated | data
        if "magnet_constant" in data:
            return data
        if data.get("turns") is None and data.get("pole_area") is None:
            return data
        constant = _coil_constant(read_unchecked(cls, data, info.context))
        if math.isnan(constant):
            constant = 1.0  # turns or pole_area is wrong or missing, and reported
        return data | {"magnet_constant": engineering(constant, "N m^2/A^2", digits=None)}

    @model_serializer(mode="wrap")
    def _without_derived(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data = self._written(handler)
        if self.turns is not None:
            del data["magnet_constant"]
        return data

    def tables(self) -> dict[str, Any]:
        values = super().tables() | {"drawing": _tables(self.drawing)}
        if self.turns is not None:
            del values["magnet_constant"]
        return values

    @property
    def has_drawing(self) -> bool:
        """Whether the force map is a drawing."""
        return str(self.force_map).endswith(".toml")

    def with_constant(self, constant: float) -> dict[str, float | None]:
        """Return the changes for :meth:`Machine.replace` to another magnet constant."""
        # A coil would contradict it, and is omitted; saturating iron needs its turns, so the pole
        # area changes instead. A force map is scaled.
        ratio = constant / self.magnet_constant
        changes: dict[str, float | None] = {}
        if self.force_map is not None:
            changes["magnet__force_scale"] = ratio * (self.force_scale or 1.0)
        if self.saturation is not None and self.pole_area is not None:
            return changes | {"magnet__pole_area": self.pole_area * ratio}
        coil = dict.fromkeys(("magnet__turns", "magnet__pole_area", "magnet__pole_angle"))
        return changes | coil | {"magnet__magnet_constant": constant}

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        turns, area, constant = read("turns"), read("pole_area"), read("magnet_constant")
        if turns is None and area is not None:
            yield "turns", "missing: pole_area alone does not give the magnet constant"
        if area is None and turns is not None:
            yield "pole_area", "missing: turns alone do not give the magnet constant"
        angle = read("pole_angle")
        if angle is not None and angle >= math.pi / 2:
            value_text = engineering(math.degrees(angle), "deg")
            yield "pole_angle", f"must be less than 90 deg, is {value_text}"
        if angle is not None and turns is None and area is None:
            yield (
                "pole_angle",
                "goes with turns and pole_area; a magnet_constant has it in it already",
            )
        iron = [key for key in IRON if read(key) is not None]
        for key in IRON:
            if iron and key not in iron:
                yield key, f"missing: iron is described by {', '.join(IRON[:2])} and {IRON[2]}"
        if iron and turns is None and area is None:
            yield iron[0], "needs turns and pole_area instead of magnet_constant"
        if read("eddy_current_lag") is not None and read("eddy_current_corner") is not None:
            yield "eddy_current_corner", "goes without eddy_current_lag: iron is laminated or solid"
        yield from _force_map_contradictions(read)
        coil = _coil_constant(read)
        if abs(coil - constant) > 1e-9 * constant:
            value_text = engineering(coil, "N m^2/A^2")
            yield "magnet_constant", f"turns and pole_area give {value_text}; give one or the other"


def _force_map_contradictions(read: Read) -> Iterator[tuple[str, str]]:
    path, channels = read("force_map"), read("force_channels")
    for key in ("force_channels", "force_scale"):
        if read(key) is not None and path is None:
            yield key, "is of a force_map, and there is none"
    if isinstance(path, str) and (channels is None or isinstance(channels, str)):
        from ambkit.machine.forces.drawing import drawing_of
        from ambkit.machine.forces.force_map import points_of

        key, changes = "force_map", dict(read("drawing"))
        try:
            if path.endswith(".toml"):
                drawing_of(path, {})
                for name, value in changes.items():
                    key = f"drawing.{name}"
                    drawing_of(path, {name: value})
                drawing_of(path, changes)
            else:
                points_of(path, channels)
        except AmbkitError as error:
            yield key, str(error)
    for key in ("drawing", "both_axes"):
        if read(key) and not str(path).endswith(".toml"):
            yield key, "is of a drawing as force_map, and there is none"


def _coil_constant(read: Read) -> float:
    turns, area, angle = read("turns"), read("pole_area"), read("pole_angle")
    if turns is None or area is None:
        return math.nan
    return magnet_constant(turns, area, 0.0 if angle is None else angle)


class Amplifier(Part):
    """Current amplifier: iu = gain u, within the limit."""

    # If the control signal is a current, gain and noise variance have the units A/A and A^2. All
    # values of u are then in A, and records and exports state it; filter files keep the unit V.

    gain: Annotated[float, Quantity("A/V", "1 A/V", at_least=1e-9, at_most=1e9, also=("A/A", "1"))]
    """Gain k_ui [A/V], control current per control signal; [A/A] if that is a current."""
    current_limit: Annotated[float, Quantity("A", "1.5 A", above=0)]
    """Maximum control current |iu| [A]."""
    noise_variance: Annotated[float, Quantity("V^2", "8e-5 V^2", above=0, also=("A^2",))]
    """Variance of the noise on the control signal [V^2], or [A^2] (paper: process noise)."""
    bandwidth: Annotated[float, Quantity("Hz", "2 kHz", above=0)] | None = None
    """Bandwidth of the current as a first-order lag [Hz]. By default infinite."""
    voltage_limit: Annotated[float, Quantity("V", "150 V", above=0)] | None = None
    """Maximum voltage of a coil, in both directions [V]; requires bandwidth and resistance."""
    resistance: Annotated[float, Quantity("ohm", "2 ohm", above=0)] | None = None
    """Resistance R of a coil [ohm], for voltage and loss."""

    @property
    def control_unit(self) -> str:
        """SI unit of the control signal: V, or A if the gain is in A/A."""
        return "A" if isinstance(self.gain, InOther) else "V"

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        bandwidth, voltage, R = read("bandwidth"), read("voltage_limit"), read("resistance")
        if voltage is not None:
            if bandwidth is None:
                yield "bandwidth", "missing: voltage_limit limits what the current follows with"
            if R is None:
                yield "resistance", "missing: voltage_limit alone does not give the current's slew"


class Sensor(Part):
    """The position sensor: a first-order lag with noise (paper, eq. 18)."""

    # Displacement plus runout, distorted to ``x (1 + quadratic x + cubic x^2)``, then lag, gain,
    # noise and quantisation.

    gain: Annotated[float, Quantity("1", "1", at_least=1e-9, at_most=1e9)]
    """Gain K_Sen [1]."""
    lag: Annotated[float, Quantity("s", "0.2 ms", above=0)]
    """Time constant T_Sen of the lag [s]."""
    noise_variance: Annotated[float, Quantity("m^2", "83 µm^2", above=0)]
    """Variance of the noise on the measured position [m^2], at x = 0."""
    position_noise: Annotated[float, Quantity("1/m", "-90 1/m")] = 0.0
    """Relative increase of the noise's standard deviation with the measured position [1/m]; limited
    to factors of an eighth and eight.
    """
    quantisation: Annotated[float, Quantity("m", "0.5 µm", above=0)] | None = None
    """Step of the measured position [m]. By default none."""
    quadratic: Annotated[float, Quantity("1/m", "20 1/m")] = 0.0
    """Coefficient of the sensor's non-linearity [1/m]."""
    cubic: Annotated[float, Quantity("1/m^2", "1e4 1/m^2")] = 0.0
    """Coefficient of the sensor's non-linearity [1/m^2]."""
    coloured_noise: ColouredNoise | None = None
    """First-order coloured noise, besides the white noise."""
    hum: tuple[Hum, ...] = ()
    """Line noise of the measured position."""
    runout: tuple[Runout, ...] = ()
    """Runout at multiples of the speed of rotation."""

    unwritten = ("position_noise", "quadratic", "cubic", "hum", "runout")


_DIRECTION = {"-x": -1.0, "+x": 1.0, "none": 0.0}


def along_x(gravity: Any) -> float:
    """Share of gravity along +x; NaN for an invalid direction."""
    if isinstance(gravity, str):
        return _DIRECTION.get(gravity, math.nan)
    share = -math.cos(gravity) if isinstance(gravity, float) else math.nan
    return 0.0 if abs(share) < 1e-12 else share  # across


def levitation_current_of(read: Read, enough: float = 0.0) -> float:
    """Return the current in equilibrium at x = 0; 0 if ``enough`` [A] does not suffice."""
    weight = along_x(read("rotor.gravity")) * read("rotor.mass") * GRAVITY
    magnet: Any = read("magnet")
    if not isinstance(magnet, Magnet):  # invalid
        magnet = SimpleNamespace(**{key: read(f"magnet.{key}") for key in Magnet.model_fields})
    wrong = any(isinstance(value, float) and math.isnan(value) for value in vars(magnet).values())
    if wrong or math.isnan(weight) or (magnet.type == "one-sided" and not weight < 0):
        return math.nan
    bearing: Any = SimpleNamespace(magnet=magnet)
    if magnet.force_map is not None:
        bearing.clearance = read("clearance")
        limit = read("amplifier.current_limit")
        bearing.current_min, bearing.current_max = current_limits(limit, magnet)
        if not 0 < bearing.clearance < magnet.air_gap or not limit > 0:
            return math.nan
    try:
        law = magnet_of(bearing)
        if enough > 0 and law.carries(-weight, *current_limits(enough, magnet)):
            return 0.0
        return law.current_for(-weight)
    except AmbkitError:  # reported with the force map
        return math.nan


def current_limits(limit: float, magnet: Any) -> tuple[float, float]:
    """Minimum and maximum control current [A]; a one-sided coil's i0 + iu stays positive."""
    return -min(limit, magnet.bias_current) if magnet.type == "one-sided" else -limit, limit
