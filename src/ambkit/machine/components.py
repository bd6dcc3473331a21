"""Components of a machine: rotor, and bearings, sensors and unbalance at their places.

Positions are measured along the shaft, the z axis: from the centre of mass, or from the origin of a
shaft table or matrices. The transverse axes are x, vertical for a horizontal shaft, and y, a
quarter turn further in the direction of rotation.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Discriminator, StringConstraints, Tag

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import KeywordOrQuantity, Quantity
from ambkit.base.units import engineering
from ambkit.machine.accessories import (
    Coil,
    Stop,
    coil_contradictions,
    gap_contradictions,
    voltage_contradictions,
)
from ambkit.machine.parts import Amplifier, Magnet, Sensor
from ambkit.machine.rotors.descriptions import MatrixRotor, ModalRotor, ShaftRotor
from ambkit.machine.rotors.shaft_elements import inertia_contradictions

Label = Annotated[str, StringConstraints(pattern=r"^([A-Za-z][A-Za-z0-9]{0,7})?$")]
"""Short name of a bearing or a sensor, used in names of signals."""

Place = Annotated[float, Quantity("m", "-0.25 m")]
Angle = Annotated[float, Quantity("rad", "45 deg")]


class MassRotor(Part):
    """A mass with one translation, the rotor of a machine with one axis."""

    type: Literal["mass"] = "mass"
    """Moves along one axis."""
    mass: Annotated[float, Quantity("kg", "0.518 kg", above=0)]
    """Mass m [kg]."""
    gravity: Annotated[
        float | Literal["-x", "+x", "none"],
        KeywordOrQuantity("rad", "45 deg", words=("-x", "+x", "none")),
    ]
    """Direction of gravity; "none" for a horizontal axis, or for an inclined axis its angle from -x
    [rad], such as "45 deg".
    """

    centre: ClassVar = 0.0  #: Place of the centre of mass [m].
    transverse_inertia: ClassVar = math.inf  #: It has no tilt [kg m^2].
    polar_inertia: ClassVar = 0.0  #: It does not rotate [kg m^2].

    def bending(self, magnets: tuple[float, ...]) -> None:
        """Return its bending modes: none."""


class RigidRotor(Part):
    """A rigid rotor."""

    type: Literal["rigid"] = "rigid"
    """Rigid."""
    mass: Annotated[float, Quantity("kg", "3.3 kg", above=0)]
    """Mass m [kg]."""
    transverse_inertia: Annotated[float, Quantity("kg m^2", "0.125 kg m^2", above=0)]
    """Transverse moment of inertia I_t about the centre of mass [kg m^2]."""
    polar_inertia: Annotated[float, Quantity("kg m^2", "0.0036 kg m^2", above=0)]
    """Polar moment of inertia I_p about the shaft [kg m^2]."""
    gravity: Literal["-x", "-z", "none"] = "-x"
    """Direction of gravity: "-x" for a horizontal shaft, "-z" for a vertical one."""
    first_end: Place | None = None
    """Position of the end towards -z [m], the limit of all places if given."""
    second_end: Place | None = None
    """Position of the end towards +z [m], the limit of all places if given."""

    centre: ClassVar = 0.0  #: Position of the centre of mass, the origin of places [m].

    def bending(self, magnets: tuple[float, ...]) -> None:
        """Return its bending modes: none."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        mass, I_t, I_p = (read(key) for key in ("mass", "transverse_inertia", "polar_inertia"))
        yield from inertia_contradictions(read)
        first, second = read("first_end"), read("second_end")
        for key, end, sign in (("first_end", first, -1), ("second_end", second, 1)):
            if end is not None and end * sign <= 0:
                side = "greater" if sign > 0 else "less"
                text = f"must be {side} than 0 m, where the centre of mass is"
                yield key, f"{text}; is {engineering(end, 'm')}"
        if first is not None and second is not None and first < 0 < second:
            most = -mass * first * second + I_p / 2
            if I_t > most * (1 + 1e-9):
                limit = f"{engineering(most, 'kg m^2')}: all of the mass would be at the ends"
                text = f"must be at most {limit}; is {engineering(I_t, 'kg m^2')}"
                yield "transverse_inertia", text


def _kind_of_rotor(rotor: Any) -> str:
    """Return the type of a rotor, as stated or by its keys."""
    if not isinstance(rotor, dict):
        return str(getattr(rotor, "type", ""))
    of_keys = {"section": "shaft", "file": "matrices", "mode": "modes"}
    meant = [kind for key, kind in of_keys.items() if key in rotor]
    return str(rotor.get("type", *meant[:1] or ["rigid"]))


AnyRotor = Annotated[
    Annotated[RigidRotor, Tag("rigid")]
    | Annotated[ShaftRotor, Tag("shaft")]
    | Annotated[MatrixRotor, Tag("matrices")]
    | Annotated[ModalRotor, Tag("modes")]
    | Annotated[MassRotor, Tag("mass")],
    Discriminator(_kind_of_rotor),
]
"""A rotor of any type."""

Body = RigidRotor | ShaftRotor | MatrixRotor | ModalRotor | MassRotor  #: The rotor of a machine.

ROTORS = (RigidRotor, ShaftRotor, MatrixRotor, ModalRotor, MassRotor)


class BearingAt(Part):
    """A bearing of the machine: the magnets of its axes, and its place."""

    # A radial bearing has two axes, NAME1 at its angle and NAME2 a quarter turn ahead; a thrust
    # bearing has one, NAME, along the shaft.

    name: Label = ""
    """Short name, letters and digits."""
    type: Literal["radial", "thrust", "single"] = "radial"
    """Radial with two axes, or axial; or the one axis of a mass."""
    place: Place = 0.0
    """Position of its force along the shaft [m]."""
    angle: Angle = 0.0
    """Angle of its first axis from x, which is against gravity, towards y [rad]."""
    clearance: Annotated[float, Quantity("m", "0.2 mm", above=0)]
    """Clearance: displacement at contact with the touch-down bearing [m]; less than the air gap."""
    magnet: Magnet
    """The electromagnets of an axis."""
    amplifier: Amplifier
    """The amplifier of an axis."""
    stop: Stop | None = None
    """The touch-down bearing with stiffness and damping. By default stiff."""
    coil: Coil | None = None
    """Thermal model of the coils. By default none."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from gap_contradictions(read)
        yield from voltage_contradictions(read)
        yield from coil_contradictions(read)
        if read("type") == "radial" and read("magnet.type") == "one-sided":
            yield "magnet.type", 'must be "two-sided" in a radial bearing; is "one-sided"'
        if read("type") == "thrust" and read("magnet.both_axes") is True:
            yield "magnet.both_axes", "is of a radial bearing"
        if read("type") != "radial" and getattr(read("stop"), "friction", None) is not None:
            yield "stop.friction", "is of a radial bearing, whose rotor slides along a ring"
        if read("type") == "thrust" and abs(read("angle") or 0.0) > 0:
            yield "angle", "is of a radial bearing; a thrust bearing has its axis along the shaft"


class SensorAt(Sensor):
    """A position sensor of the machine, and its place."""

    # A radial sensor has two readings, NAME1 at its angle and NAME2 a quarter turn ahead; a single
    # one has one, NAME; an axial one measures along the shaft.

    name: Label = ""
    """Short name, letters and digits."""
    type: Literal["radial", "single", "axial"] = "radial"
    """Radial with two readings or one, or axial."""
    place: Place = 0.0
    """Position of its target along the shaft [m]."""
    angle: Angle = 0.0
    """Angle of its first reading from x, which is against gravity, towards y [rad]."""

    def tables(self) -> dict[str, Any]:
        values = super().tables()  # a mass has one sensor, described by the values of the file
        return (
            {key: values[key] for key in Sensor.model_fields} if self.type == "single" else values
        )

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if read("type") == "axial" and abs(read("angle") or 0.0) > 0:
            yield "angle", "is of a radial sensor; an axial one looks along the shaft"


class Unbalance(Part):
    """Unbalance in a plane across the shaft: by its amount, or by a balance quality grade."""

    place: Place
    """Position of the plane along the shaft [m]."""
    amount: Annotated[float, Quantity("kg m", "50 g mm", above=0)] | None = None
    """Mass times radius [kg m]; or else grade."""
    grade: Annotated[float, Quantity("m/s", "2.5 mm/s", above=0)] | None = None
    """Balance quality grade of the rotor, G 2.5 is 2.5 mm/s [m/s]; the plane has its share of the
    permissible unbalance at the machine's speed (ISO 21940-11).
    """
    angle: Angle = 0.0
    """Angle from x at the start [rad]."""

    unwritten = ("amount", "grade")

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        amount, grade = read("amount"), read("grade")
        if amount is None and grade is None:
            yield "amount", "missing: give the amount, such as 50 g mm, or a grade"
        if amount is not None and grade is not None and not math.isnan(amount + grade):
            yield "grade", "amount says already how much it is; give one or the other"
