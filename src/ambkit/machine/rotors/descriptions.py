"""Flexible rotors, as descriptions: a table of the shaft, matrices in a file, measured modes."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from ambkit.base.arrays import Array
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import FilePath, Quantity
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.machine.rotors import beam
from ambkit.machine.rotors.matrix_file import read_matrices
from ambkit.machine.rotors.modes import RANGE, Bending, Body, body_of, reduced
from ambkit.machine.rotors.shaft_elements import (
    NAMED,
    Disc,
    Material,
    Section,
    inertia_contradictions,
)

Ratio = Annotated[float, Quantity("1", "0.002", above=0)]
Frequency = Annotated[float, Quantity("Hz", "1 kHz", above=0)]
Gravity = Literal["-x", "-z", "none"]


class OfMatrices(Part):
    """A rotor with modes computed from its matrices."""

    gravity: Gravity = "-x"
    """Direction of gravity: "-x" for a horizontal shaft, "-z" for a vertical one."""
    modes_up_to: Frequency | None = None
    """Upper limit of the frequencies of retained bending modes [Hz]. By default as many modes as
    `modes_within` requires up to 2 kHz or three times the speed (ISO 14839-3).
    """
    modes_within: Annotated[float, Quantity("1", "1 %", above=0)] = 0.01
    """Maximum error of the modal truncation, of whirl frequencies, critical speeds and the
    sensitivity, against the full matrices [1].
    """
    damping_ratio: Ratio | None = None
    """Damping ratio of each bending mode, non-rotating [1]. By default from the damping matrix."""
    internal_damping_ratio: Ratio | None = None
    """The same of the rotating parts: fits, laminations, material [1]. Above the critical speed of
    a mode it destabilises the whirl.
    """
    residual: Annotated[bool, Field(strict=True)] = False
    """Whether to retain the residual flexibility at the magnets, by one static shape for each: it
    matters for a stiff magnet or a high gain.
    """

    @property
    def matrices(self) -> beam.Matrices:
        """Matrices of the free rotor, in one plane."""
        raise NotImplementedError

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Return a copy with other values, unchecked."""
        copy = super().model_copy(update=update, deep=deep)
        for computed in ("matrices", "body", "_known", "every_mode"):  # of the previous rotor
            copy.__dict__.pop(computed, None)
        return copy

    @cached_property
    def body(self) -> Body:
        """The rotor as a rigid body."""
        return body_of(self.matrices)

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.body.mass

    transverse_inertia = property(attrgetter("body.transverse_inertia"))
    polar_inertia = property(attrgetter("body.polar_inertia"))
    centre = property(attrgetter("body.centre"))
    first_end = property(attrgetter("body.first_end"))
    second_end = property(attrgetter("body.second_end"))

    def bending(self, magnets: tuple[float, ...]) -> Bending:
        """Return its bending modes."""
        known: dict[tuple[float, ...], Bending] = self._known
        places = magnets if self.residual else ()
        if places not in known:
            highest = 2 * math.pi * self._highest
            known[places] = reduced(
                self.matrices, highest, self.damping_ratio, places, self.internal_damping_ratio
            )
        return known[places]

    @property
    def _highest(self) -> float:
        """Upper limit of the retained modes [Hz], selected by the machine by default."""
        if self.modes_up_to is not None:
            return self.modes_up_to
        first = math.sqrt(self.matrices.free_modes[0][0]) / (2 * math.pi)
        return max(RANGE, 1.01 * first)

    @cached_property
    def every_mode(self) -> Bending:
        """All bending modes of its matrices."""
        return reduced(self.matrices, math.inf, self.damping_ratio, (), self.internal_damping_ratio)

    @cached_property
    def _known(self) -> dict[tuple[float, ...], Bending]:
        return {}

    unwritten: ClassVar[tuple[str, ...]] = (
        "modes_up_to", "modes_within", "damping_ratio", "internal_damping_ratio", "residual",
    )  # fmt: skip


class ShaftRotor(OfMatrices):
    """A rotor by a table of its shaft: sections in sequence, and discs."""

    # All places of its machine are relative to the start of the shaft.

    type: Literal["shaft"]
    """A table of the shaft."""
    section: Annotated[tuple[Section, ...], Field(min_length=1, max_length=500)]
    """Sections, from the start on."""
    disc: Annotated[tuple[Disc, ...], Field(max_length=500)] = ()
    """Rigid discs."""
    material: Annotated[tuple[Material, ...], Field(max_length=100)] = ()
    """Materials by name."""
    unwritten = (*OfMatrices.unwritten, "disc", "material")

    @cached_property
    def matrices(self) -> beam.Matrices:
        return _of_shaft(self.section, self.disc, self.material)

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        sections, discs, materials = (read(key) for key in ("section", "disc", "material"))
        if read("damping_ratio") is None and read("internal_damping_ratio") is None:
            yield "damping_ratio", "missing: damping ratio of the bending modes, such as 0.002"
        if not all(isinstance(entry, tuple) for entry in (sections, discs, materials)):
            return
        result = False
        names = {*NAMED, *(material.name for material in materials)}
        for key, placed in (("section", sections), ("disc", discs)):
            for at, item in enumerate(placed):
                if item.material not in names:
                    result = True
                    text = f'must be one of {", ".join(sorted(names))}, is "{item.material}"'
                    yield f"{key}.{at}.material", text
        length = sum(section.length for section in sections)
        for at, item in enumerate(discs):
            if item.place > length * (1 + 1e-9):
                result = True
                limit = f"is beyond the shaft, which ends at {engineering(length, 'm')}"
                yield f"disc.{at}.place", f"{engineering(item.place, 'm')} {limit}"
        if result or _is_wrong(read("modes_up_to")):
            return
        rotor = cls.model_construct(
            type="shaft", section=sections, disc=discs, material=materials,
            modes_up_to=read("modes_up_to"), damping_ratio=read("damping_ratio") or 0.01,
            internal_damping_ratio=read("internal_damping_ratio"),
        )  # fmt: skip
        yield from _no_mode(rotor, "section")


@lru_cache(maxsize=16)
def _of_shaft(
    section: tuple[Section, ...], disc: tuple[Disc, ...], material: tuple[Material, ...]
) -> beam.Matrices:
    """Return the matrices of a shaft, cached between check and use."""
    known = NAMED | {m.name: (m.density, m.youngs_modulus, m.poisson_ratio) for m in material}
    sections = [
        beam.Element(s.length, s.outer_diameter, s.inner_diameter, *known[s.material])
        for s in section
    ]
    discs = [item.on(known[item.material][0]) for item in disc]
    return beam.assemble(beam.divided(sections, [d.place for d in discs]), discs)


class MatrixRotor(OfMatrices):
    """A rotor by matrices M, K, G and optionally D of the free rotor at nodes, in a file."""

    # All places of its machine are relative to the origin of the file's places.

    type: Literal["matrices"]
    """Matrices in a file."""
    file: FilePath
    """A ``.npz`` or ``.mat`` file, see `ambkit.machine.rotors.matrix_file`."""

    @cached_property
    def matrices(self) -> beam.Matrices:
        about = Path(self.file).stat() if Path(self.file).exists() else None
        return _of_file(self.file, about and (about.st_mtime_ns, about.st_size))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        file, highest = read("file"), read("modes_up_to")
        if not isinstance(file, str) or _is_wrong(highest):
            return
        rotor = cls.model_construct(
            type="matrices",
            file=file,
            modes_up_to=highest,
            damping_ratio=read("damping_ratio"),
            internal_damping_ratio=read("internal_damping_ratio"),
        )
        try:
            dampings = rotor.matrices.D, rotor.matrices.D_internal
        except AmbkitError as error:
            yield "file", str(error)
            return
        if all(item is None for item in (*dampings, *_ratios(rotor).values())):
            text = "missing: damping ratio of the bending modes, such as 0.002; the file has no D"
            yield "damping_ratio", text
            return
        yield from _no_mode(rotor, "file")


@lru_cache(maxsize=16)
def _of_file(path: str, about: tuple[int, int] | None) -> beam.Matrices:
    """Return the matrices of a file, read again if it has changed."""
    return read_matrices(path)


def _is_wrong(highest: float | None) -> bool:
    return highest is not None and math.isnan(highest)


def _no_mode(rotor: OfMatrices, key: str) -> Iterator[tuple[str, str]]:
    """Yield if a rotor is not free, has impossible inertia, or no mode is retained."""
    try:
        squares, _ = rotor.matrices.free_modes
        body = rotor.body
    except (ValueError, np.linalg.LinAlgError) as error:
        yield key, str(error)
        return
    if body.polar_inertia > 2 * body.transverse_inertia:
        polar = engineering(body.polar_inertia, "kg m^2")
        most = f"twice the transverse one, {engineering(body.transverse_inertia, 'kg m^2')}"
        yield key, f"gives a polar inertia of {polar}, which is more than {most}"
    yield from _overdamped(_ratios(rotor))
    first = math.sqrt(squares[0]) / (2 * math.pi)
    if rotor.modes_up_to is not None and rotor.modes_up_to < first:
        limit = f"at least {engineering(first, 'Hz')}, the first bending mode of the free rotor"
        yield "modes_up_to", f"must be {limit}; is {engineering(rotor.modes_up_to, 'Hz')}"


def _ratios(described: OfMatrices) -> dict[str, float | None]:
    return {key: getattr(described, key) for key in ("damping_ratio", "internal_damping_ratio")}


def _shape(splines: Sequence[Callable[[float], Any]], place: float) -> Array:
    """Return the deflection of each measured mode (modes,) [1] at a place [m]."""
    return np.array([float(spline(place)) for spline in splines])


def _overdamped(ratios: Mapping[str, float | None]) -> Iterator[tuple[str, str]]:
    for key, ratio in ratios.items():
        if ratio is not None and ratio >= 1:
            yield key, f"must be less than 1, is {ratio:g}"


class MeasuredMode(Part):
    """A measured bending mode of the free rotor, such as from an impact test."""

    frequency: Frequency
    """Frequency, at standstill [Hz]."""
    damping_ratio: Ratio
    """Damping ratio, non-rotating [1]."""
    internal_damping_ratio: Ratio | None = None
    """Damping ratio of the rotating parts [1]."""
    mass: Annotated[float, Quantity("kg", "1.45 kg", above=0)]
    """Modal mass for this scaling of the shape [kg]."""
    places: Annotated[
        tuple[Annotated[float, Quantity("m", "-0.25 m")], ...], Field(min_length=2, max_length=1000)
    ]
    """Places of the shape's points, ascending [m]; the outermost beyond all magnets and sensors."""
    shape: Annotated[
        tuple[Annotated[float, Quantity("1", "0.8")], ...], Field(min_length=2, max_length=1000)
    ]
    """Deflection at these places [1]; interpolated by a cubic spline."""

    unwritten = ("internal_damping_ratio",)

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        keys = ("damping_ratio", "internal_damping_ratio")
        yield from _overdamped({key: read(key) for key in keys})
        places, shape = read("places"), read("shape")
        if not (isinstance(places, tuple) and isinstance(shape, tuple)):
            return
        if len(places) != len(shape):
            yield "shape", f"must be {len(places)} numbers, one for each place; is {len(shape)}"
        if any(b <= a for a, b in pairwise(places)):
            yield "places", "must increase"
        if not any(shape):
            yield "shape", "must not be 0 everywhere"


class ModalRotor(Part):
    """A rotor by its rigid body and measured bending modes."""

    # All places of its machine are relative to the centre of mass. Gyroscopic effects on the modes
    # were not measured: they act on the rigid body only.

    type: Literal["modes"]
    """Measured modes."""
    mass: Annotated[float, Quantity("kg", "3.3 kg", above=0)]
    """Mass m [kg]."""
    transverse_inertia: Annotated[float, Quantity("kg m^2", "0.125 kg m^2", above=0)]
    """Transverse moment of inertia I_t about the centre of mass [kg m^2]."""
    polar_inertia: Annotated[float, Quantity("kg m^2", "0.0036 kg m^2", above=0)]
    """Polar moment of inertia I_p about the shaft [kg m^2]."""
    gravity: Gravity = "-x"
    """Direction of gravity: "-x" for a horizontal shaft, "-z" for a vertical one."""
    mode: Annotated[tuple[MeasuredMode, ...], Field(min_length=1, max_length=10)]
    """Bending modes, the slowest first."""

    centre: ClassVar = 0.0  #: Position of the centre of mass, the origin of places [m].

    @property
    def first_end(self) -> float:
        """Start of the range in which all shapes were measured [m]."""
        return max(item.places[0] for item in self.mode)

    @property
    def second_end(self) -> float:
        """End of the range in which all shapes were measured [m]."""
        return min(item.places[-1] for item in self.mode)

    def bending(self, magnets: tuple[float, ...]) -> Bending:
        """Return its bending modes."""
        return self._bending

    @cached_property
    def _bending(self) -> Bending:
        from scipy.interpolate import CubicSpline

        largest = np.array([max(map(abs, item.shape)) for item in self.mode])
        mass = np.array([item.mass for item in self.mode]) / largest**2
        frequency = 2 * math.pi * np.array([item.frequency for item in self.mode])
        ratios = np.array([item.damping_ratio for item in self.mode])
        inner = np.array([item.internal_damping_ratio or 0.0 for item in self.mode])
        polar = np.zeros((1 + len(mass), 1 + len(mass)))
        polar[0, 0] = self.polar_inertia
        damping = np.diag(np.concatenate([[0.0, 0.0], 2 * ratios * mass * frequency]))
        ends = self.first_end, self.second_end
        internal = np.diag(2 * inner * mass * frequency)
        splines = [
            CubicSpline(item.places, np.asarray(item.shape, float) / size, bc_type="natural")
            for item, size in zip(self.mode, largest, strict=True)
        ]
        shape = partial(_shape, splines)
        return Bending(frequency, mass, damping, polar, shape, ends, internal)

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from inertia_contradictions(read)
        modes = read("mode")
        if not isinstance(modes, tuple):
            return
        for at, (one, other) in enumerate(pairwise(modes), 1):
            if other.frequency <= one.frequency:
                text = f"must be greater than the previous one, {engineering(one.frequency, 'Hz')}"
                yield f"mode.{at}.frequency", f"{text}; is {engineering(other.frequency, 'Hz')}"
