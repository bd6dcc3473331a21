"""The machine: a rotor on magnetic bearings, with sensors, from TOML with units."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
    model_validator,
)

from ambkit.base.config import Document, Read, reader
from ambkit.base.config.problems import Problem
from ambkit.base.config.quantities import Description, Name, Quantity
from ambkit.machine import geometry, presets, short_form
from ambkit.machine.accessories import SHORTEST_LAG, AngleSensor, Coil, Stop
from ambkit.machine.components import AnyRotor, BearingAt, SensorAt, Unbalance
from ambkit.machine.geometry import Axis, Line, Reading, Shaft
from ambkit.machine.parts import (
    GRAVITY,
    Amplifier,
    Magnet,
    Sensor,
    along_x,
    current_limits,
    levitation_current_of,
)
from ambkit.machine.placement_checks import contradictions
from ambkit.machine.rotors.descriptions import OfMatrices
from ambkit.machine.rotors.modes import Bending, enough
from ambkit.result.showing import Shown

if TYPE_CHECKING:
    from ambkit.result.card import Card


class Machine(Shown, Document):
    """A rotor on magnetic bearings, with one axis or several.

    Frozen, with all checks on construction: from TOML (`load`, `from_toml`, `preset`) or from
    Python, where numbers are SI and strings have units. A machine with a single axis is read and
    written in a short form, with ``[magnet]``, ``[rotor]``, ``[amplifier]`` and ``[sensor]`` in
    place of lists.

    Examples
    --------
    >>> machine = Machine.preset("tum_mlps")
    >>> machine.axis_names
    ['A1', 'A2', 'B1', 'B2']
    >>> machine = Machine.preset("zittau_axial")
    >>> machine.replace(magnet__air_gap="2.2 mm").magnet.air_gap
    0.0022
    """

    name: Annotated[Name, Field(min_length=1)]
    """Short name."""
    description: Description = ""
    """Description, in a sentence."""
    source: Description = ""
    """Origin of its values."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)]
    """Sampling time T of controller and filter [s]."""
    delay: Annotated[float, Quantity("s", "0.15 ms", above=0)] | None = None
    """Dead time from a sampling instant to the change of the control currents [s]."""
    speed: Annotated[float, Quantity("rad/s", "12000 rpm")] = 0.0
    """Speed of rotation, from x towards y [rad/s]; for a mass, the frequency of its runout."""
    rotor: AnyRotor
    """The rotor: rigid, flexible, or a mass along one axis."""
    bearings: Annotated[tuple[BearingAt, ...], Field(min_length=1, alias="bearing")]
    """The bearings."""
    sensors: Annotated[tuple[SensorAt, ...], Field(min_length=1, alias="sensor")]
    """The position sensors."""
    unbalance: tuple[Unbalance, ...] = ()
    """Unbalance by plane."""
    angle: AngleSensor | None = None
    """Sensor of the rotor's angle or speed. By default the filter knows the speed exactly."""

    unwritten = ("unbalance", "angle")

    if TYPE_CHECKING:  # in both forms

        def __init__(self, /, **data: Any) -> None: ...

    @model_validator(mode="wrap")
    @classmethod
    def _from_short_form(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        if not short_form.is_short(data):
            return handler(data)
        long, problems = short_form.expanded(data)
        try:
            machine = handler(long)
        except ValidationError as error:
            problems = short_form.moved(Problem.unpack(error), problems)
        if problems:
            raise ValidationError.from_exception_data(cls.__name__, [p.pack() for p in problems])
        return machine

    @model_serializer(mode="wrap")
    def _written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        data = super()._written(handler)
        for key in short_form.LISTS:
            data = {key if name == f"{key}s" else name: data[name] for name in data}
        if not self.single:
            return data
        if not self.speed:
            data.pop("speed", None)
        return short_form.shortened(data)

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """Return the JSON schema of the TOML file, in the long form or the short one."""
        return short_form.with_schema(super().json_schema())

    def tables(self) -> dict[str, Any]:
        return short_form.tables_of(self) if self.single else super().tables()

    def replace(self, **changes: Any) -> Self:
        lists = {key: changes[key] for key in short_form.LISTS if key in changes}
        if self.single and any(isinstance(value, list | tuple) for value in lists.values()):
            long = type(self)(**(super().tables() | lists))
            rest = {key: value for key, value in changes.items() if key not in lists}
            return long.replace(**rest) if rest else long
        return super().replace(**changes)

    def _long_key(self, key: str) -> str:
        return short_form.long_key(key) if self.single else key

    @classmethod
    def preset(cls, name: str) -> Self:
        """Return a preset machine.

        Parameters
        ----------
        name : str
            One of `ambkit.machine.presets.names`.

        Raises
        ------
        AmbkitError
            There is no preset with this name.
        """
        return cls.from_toml(presets.text(name), name=f"{name}.toml")

    def model_post_init(self, context: Any, /) -> None:
        """Select the number of bending modes, unless the rotor states it."""
        if isinstance(self.rotor, OfMatrices) and self.rotor.modes_up_to is None:
            highest = enough(self.rotor, self.sampling_time, self.speed, self.rotor.modes_within)
            self.__dict__["rotor"] = self.rotor.model_copy(update={"modes_up_to": highest})

    @cached_property
    def _one(self) -> BearingAt:
        """The bearing of a machine with one axis."""
        if len(self.axes) > 1:
            name = self.axes[0].name
            raise AttributeError(f'{self.name} has several axes: use machine["{name}"].magnet, ...')
        return self.bearings[0]

    @property
    def magnet(self) -> Magnet:
        """The electromagnets of its one axis."""
        return self._one.magnet

    @property
    def amplifier(self) -> Amplifier:
        """The amplifier of its one axis."""
        return self._one.amplifier

    @property
    def sensor(self) -> SensorAt:
        """The position sensor of its one axis."""
        only = self.single or self._one.type == "single"
        return self.sensors[0] if only else geometry.nearest(self.sensors, self.axes[0])

    @property
    def clearance(self) -> float:
        """Clearance of its one axis [m]."""
        return self._one.clearance

    @property
    def stop(self) -> Stop | None:
        """The touch-down bearing of its one axis; without it contact is inelastic."""
        return self._one.stop

    @property
    def coil(self) -> Coil | None:
        """The thermal model of the coils of its one axis, if there is one."""
        return self._one.coil

    @cached_property
    def shaft(self) -> Shaft:
        """The geometry of its places."""
        return Shaft.of(self.rotor, self.bearings)

    def __eq__(self, other: object) -> bool:
        # Without cached objects, which refer to them again.
        return type(self) is type(other) and all(
            getattr(self, key) == getattr(other, key) for key in type(self).model_fields
        )

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with values by field, or by a table of its one axis, unchecked."""
        update = dict(short_form.updates(self, update or {}))
        copy = super().model_copy(update=update, deep=deep)
        for made in copy.__dict__.keys() - type(self).model_fields:  # the rotor may have changed
            del copy.__dict__[made]
        return copy

    @property
    def bending(self) -> Bending | None:
        """Its bending modes; None for a rigid rotor."""
        return self.shaft.bending

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of its bearings."""
        return geometry.axes_of(self.bearings, self.shaft)

    @property
    def axis_names(self) -> list[str]:
        """Names of the axes; an empty one if the machine is a single axis."""
        return [axis.name for axis in self.axes]

    @cached_property
    def readings(self) -> tuple[Reading, ...]:
        """The readings of its sensors."""
        return geometry.readings_of(self.sensors, self.shaft)

    @property
    def rigid_coordinates(self) -> tuple[str, ...]:
        """Coordinates of the rotor's rigid body: x, y [m], th_x, th_y [rad], with thrust z [m]."""
        return geometry.positions_of(self.axes)

    @cached_property
    def positions(self) -> tuple[str, ...]:
        """Coordinates of the rotor: rigid body, and modal coordinates m1_x, m1_y, ... [m]."""
        return self.rigid_coordinates + geometry.modal_positions(self.bending)

    @property
    def masses(self) -> NDArray[np.float64]:
        """Mass or inertia of each coordinate (q,) [kg] or [kg m^2]."""
        return np.array(list(geometry.masses(self.rotor, self.positions, self.bending).values()))

    def line(self, place: float, angle: float) -> Line:
        """Return a radial direction.

        Parameters
        ----------
        place : float
            Position along the shaft [m].
        angle : float
            Angle from x towards y [rad].
        """
        return self.shaft.line(place, angle)

    @property
    def effective_masses(self) -> NDArray[np.float64]:
        """Effective mass of each isolated axis (p,) [kg]: ``1/(1/m + z^2/I_t)``."""
        if self.rotor.type == "mass":
            return np.array([self.rotor.mass])  # 1/(1/m) rounds
        return np.asarray(1 / np.diag(geometry.compliance(self.rotor, self.axes)))

    @property
    def coupling(self) -> float:
        """Largest inertial coupling of two axes [1].

        The acceleration of one by a force along the other, relative to the mean of their own.
        """
        C = geometry.compliance(self.rotor, self.axes)
        own = np.sqrt(np.diag(C))
        return float(np.max(np.abs(C / np.outer(own, own)) - np.eye(len(C)), initial=0.0))

    @property
    def turns(self) -> bool:
        """Whether its rotor spins; the speed of a mass concerns runout only."""
        return self.speed != 0 and self.rotor.type != "mass"

    @property
    def control_unit(self) -> str:
        """SI unit of the control signals: A if all are currents, else V."""
        units = {axis.bearing.amplifier.control_unit for axis in self.axes}
        return "A" if units == {"A"} else "V"

    @cached_property
    def single(self) -> bool:
        """Whether it has one axis and one reading, whose signals y and u have no suffix."""
        bearings, sensors = self.bearings, self.sensors
        return (
            len(bearings) == len(sensors) == 1
            and bearings[0].type == sensors[0].type == "single"
            and not bearings[0].name
        )

    def __getitem__(self, axis: str) -> Machine:
        """Return an isolated axis, see `isolated_axis`."""
        return self.isolated_axis(axis)

    def isolated_axis(self, axis: str) -> Machine:
        """Return an axis as a machine of its own, with its effective mass.

        Its motion equals that of the machine only if the axes are not coupled, see
        :attr:`coupling`. It has no weight except with a one-sided magnet.

        Parameters
        ----------
        axis : str
            Its name.

        Raises
        ------
        AmbkitError
            The axis does not exist.
        """
        if self.single and not axis:
            return self
        made = self._isolated_axes
        if axis not in made:
            made[axis] = Machine(**short_form.isolated(self, axis))
        return made[axis]

    @cached_property
    def _isolated_axes(self) -> dict[str, Machine]:
        """Cache of isolated axes, by name."""
        return {}

    @cached_property
    def levitation_currents(self) -> dict[tuple[float, float], float]:
        """Cache of control currents [A], by displacement [m] and disturbance [N]."""
        return {}

    @property
    def weight(self) -> float:
        """Force of gravity along +x [N], negative where gravity pulls towards -x."""
        return float(along_x(self.rotor.gravity) * self.rotor.mass * GRAVITY)

    @property
    def current_min(self) -> float:
        """Minimum control current iu [A]; a one-sided coil's current i0 + iu stays positive."""
        return current_limits(self.amplifier.current_limit, self.magnet)[0]

    @property
    def current_max(self) -> float:
        """Maximum control current iu [A]."""
        return self.amplifier.current_limit

    @property
    def levitation_current(self) -> float:
        """Control current iu [A] in equilibrium at x = 0.

        It solves ``F(iu, 0) + weight = 0``; ideal iron, two-sided:
        ``iu = -weight s0^2 / (4 k i0)``, one-sided: ``iu = s0 sqrt(-weight/k) - i0``.
        """
        return levitation_current_of(reader(self))

    def lag_of(self, sensor: Sensor) -> float:
        """Return a sensor's lag in models and plants [s], at least 0.001 samples.

        Parameters
        ----------
        sensor : Sensor
            A sensor of the machine.
        """
        return max(sensor.lag, SHORTEST_LAG * self.sampling_time)

    def unbalances(self) -> list[tuple[float, float, float]]:
        """Return place [m], amount [kg m] and angle [rad] of each plane's unbalance.

        Positions are those of the description. A balance quality grade G permits ``m G / speed``
        for the rotor (ISO 21940-11), divided between two planes by their distances from the centre
        of mass.
        """
        return geometry.unbalances_of(self.unbalance, self.rotor, self.speed)

    def contradictions(self, known: Any = None) -> Iterator[str]:
        for text in super().contradictions(known):
            yield short_form.short_text(text) if self.single else text

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from contradictions(read, cls.model_construct)

    def figure(self) -> Any:
        """Return the figure of the force of its one axis."""
        from ambkit.machine.bearing_card import bearing_figure

        return bearing_figure(self)

    def _card(self) -> Card:
        from ambkit.machine.bearing_card import bearing_card
        from ambkit.result.card import settings_card

        return bearing_card(self) if self.single else settings_card(self)
