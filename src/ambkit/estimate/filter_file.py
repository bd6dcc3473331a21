"""An estimator as a file: all that makes it what it is, and where each number came from.

::

    kind = "extended"
    sampling_time = "0.25 ms"

    [bearing]
    file = "found.toml"            # or preset = "zittau_axial"
    sha256 = "9f8e..."

    [noise]
    measurement = "225 µm^2"
    control = "100 mV^2"
    disturbance = "77 N^2/s"

    [magnet]                       # where it is not the bearing's own
    file = "expert.json"
    sha256 = "31aa..."

    [inputs.y]                     # what the controller reads: y = 10 mm - z
    unit = "mm"
    sign = -1
    offset = "10 mm"

    [origin]
    "noise.disturbance" = "likelihood of log.csv, 0 to 2 s; ambkit tune 0.2.0"
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from ambkit.base import files, units
from ambkit.base.asked import in_si
from ambkit.base.config import Document, Part, Read
from ambkit.base.config.paths import FilePath
from ambkit.base.config.quantities import Quantity
from ambkit.base.config.texts import Description, Line, Name
from ambkit.base.errors import AmbkitError
from ambkit.data.rig_units import Inputs
from ambkit.estimate.noise import FilterNoise
from ambkit.estimate.registry import KINDS, kind_called, kind_of, learned_magnet
from ambkit.machine.bearing import Bearing
from ambkit.machine.forces.map_of import surface_in

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.magnets import MagnetModel, Precision

Limit = Annotated[int, Field(ge=0, strict=True)]


class Reference(Part):
    """A file that belongs to a filter, and what it was when the filter was made."""

    file: FilePath
    """Its name, from where the filter's file lies."""
    sha256: Line = ""
    """Hash of its content; without it any content will do."""

    @classmethod
    def to(cls, path: str | os.PathLike[str]) -> Self:
        """Return a reference to a file as it is now.

        Parameters
        ----------
        path : path
            The file.

        Raises
        ------
        AmbkitError
            It cannot be read.
        """
        return cls(file=os.fspath(path), sha256=files.sha256(path))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from _changed(read("file"), read("sha256"))


class BearingOf(Part):
    """The bearing that a filter assumes: a preset, or a file."""

    preset: Name | None = None
    """Its name, where it comes with ambkit."""
    file: FilePath | None = None
    """Its TOML file."""
    sha256: Line = ""
    """Hash of that file; without it any content will do."""

    @cached_property
    def bearing(self) -> Bearing:
        """The bearing itself."""
        return Bearing.load(self.file) if self.file else Bearing.preset(self.preset or "")

    @classmethod
    def of(cls, name: str | os.PathLike[str]) -> Self:
        """Return what a user names: a preset, or a file as it is now."""
        from ambkit.machine import presets

        if isinstance(name, str) and name in presets.names():
            return cls(preset=name)
        return cls(file=os.fspath(name), sha256=files.sha256(name))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        file, preset = read("file"), read("preset")
        if (file is None) == (preset is None):
            yield "file", "give either file or preset"
            return
        yield from _changed(file, read("sha256"))
        try:
            cls.model_construct(file=file, preset=preset).bearing  # noqa: B018
        except AmbkitError as error:
            yield "file" if file else "preset", str(error)


class Assumed(Part):
    """Variances that a filter assumes; the bearing's own where one is not given."""

    measurement: Annotated[float, Quantity("m^2", "225 µm^2", at_least=0)] | None = None
    """R, of the measured position [m^2]."""
    control: Annotated[float, Quantity("V^2", "100 mV^2", at_least=0)] | None = None
    """Of the control signal [V^2]."""
    disturbance: Annotated[float, Quantity("N^2/s", "77 N^2/s", at_least=0)] | None = None
    """Q: growth of the disturbance force's variance [N^2/s]."""


class FilterFile(Document):
    """An estimator as a file."""

    kind: Name
    """Of estimator, as ``ambkit filter --help`` lists them."""
    description: Description = ""
    """What it is for."""
    bearing: BearingOf
    """What it assumes of machine and sensor."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)]
    """Time between two steps [s]: the bearing's."""
    gravity: Literal["known", "disturbance"] = "known"
    """Whether the weight is known, or part of the disturbance force."""
    gate: Annotated[float, Quantity("1", "8", above=0)] = 8.0
    """Innovations beyond so many standard deviations are outliers."""
    frozen_limit: Limit = 10
    """Equal measurements in a row from which on the sensor counts as frozen; 0: never."""
    outlier_limit: Limit = 3
    """Outliers in a row after which the filter believes them; 0: never."""
    as_printed: bool = False
    """Eq. 19 as the paper prints it."""
    noise: Assumed = Assumed()
    """What it assumes of the noise."""
    options: dict[Name, float | Line | tuple[float, ...]] = Field(default_factory=dict)
    """What only this kind has, such as memory or bandwidth, with units."""
    magnet: Reference | None = None
    """Expert (.json) or force map (.csv, .parquet) that it asks; without it, what its kind asks."""
    start: dict[Name, Line] = Field(default_factory=dict)
    """Standard deviations at the start that are not the usual ones, by the names of states."""
    inputs: Inputs = Field(default_factory=Inputs)
    """What its inputs are in the rig; the exported C takes them so."""
    origin: dict[Name, Line] = Field(default_factory=dict)
    """Where a number came from, by its key: record, command, version."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        kind, given = read("kind"), read("options")
        if isinstance(kind, str):
            try:
                known = kind_called(kind).option_units
            except AmbkitError as error:
                yield "kind", str(error)
                return
            for name, value in given.items() if isinstance(given, dict) else ():
                if name not in known:
                    has = ", ".join(known) or "none"
                    yield f"options.{name}", f"the {kind} has no such option; it has: {has}"
                    continue
                try:
                    _option(value, known[name])
                except ValueError as error:
                    yield f"options.{name}", str(error)
        of = read("bearing")
        if isinstance(of, BearingOf):
            T = read("sampling_time")
            own = of.bearing.sampling_time
            if abs(T - own) > 1e-9 * own:
                shown = [units.engineering(each, "s") for each in (own, T)]
                yield "sampling_time", f"must be the bearing's, {shown[0]}, is {shown[1]}"

    @model_serializer(mode="wrap")
    def _without_empty(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what says nothing."""

        def said(value: Any) -> Any:
            if not isinstance(value, dict):
                return value
            kept = {key: said(each) for key, each in value.items()}
            return {key: each for key, each in kept.items() if each not in ("", {}, None)}

        data: dict[str, Any] = said(handler(self))
        return data

    @classmethod
    def load_for(cls, path: str | os.PathLike[str], bearing: Bearing) -> Self:
        """Read a filter that is to run beside others on a bearing.

        Parameters
        ----------
        path : path
            The file.
        bearing : Bearing
            What it is to filter; it assumes its own.

        Raises
        ------
        AmbkitError
            As `load`; or it steps at another rate than the bearing is sampled.
        """
        found, T = cls.load(path), bearing.sampling_time
        if abs(found.sampling_time - T) > 1e-9 * T:
            steps, is_sampled = (units.engineering(t, "s") for t in (found.sampling_time, T))
            raise AmbkitError(
                f"{os.fspath(path)}: this filter steps every {steps}, and bearing {bearing.name} "
                f"is sampled every {is_sampled}"
            )
        return found

    def asked(self) -> MagnetModel | None:
        """Return what it asks for k_i and k_s; None where its kind knows by itself.

        Raises
        ------
        AmbkitError
            What the magnet's file holds is no expert and no force map.
        """
        if self.magnet is None:
            return learned_magnet(self.kind, self.bearing.bearing)
        return magnet_in(self.magnet.file, self.bearing.bearing)

    def make(
        self, *, precision: Precision = "float64", magnet: MagnetModel | None = None
    ) -> Estimator:
        """Return the estimator.

        Parameters
        ----------
        precision : {"float64", "float32"}
            What it computes in.
        magnet : optional
            What it asks in the place of `asked`, such as the table of its expert.

        Raises
        ------
        AmbkitError
            What the magnet's file holds is no expert and no force map; or an option or a start is
            out of its range.
        """
        kind, bearing = KINDS[self.kind], self.bearing.bearing
        if magnet is None:
            magnet = self.asked()
        limits = ("gravity", "gate", "frozen_limit", "outlier_limit", "as_printed")
        options = {name: _option(v, kind.option_units[name]) for name, v in self.options.items()}
        try:
            made = kind.make(
                bearing, magnet, noise=FilterNoise(**self.noise.model_dump()), precision=precision,
                **{name: getattr(self, name) for name in limits}, **options,
            )  # fmt: skip
            made.start_std = _start(self.start, made)
            made.reset()
        except ValueError as error:
            raise AmbkitError(str(error)) from None
        made.inputs, made.origin, made.description = self.inputs, self.origin, self.description
        return made


def described(
    estimator: Estimator,
    bearing: str | os.PathLike[str],
    magnet: str | os.PathLike[str] | None = None,
) -> FilterFile:
    """Return what makes an estimator, for a file.

    Parameters
    ----------
    estimator : Estimator
        Which.
    bearing : path
        A preset's name, or the file of its bearing.
    magnet : path, optional
        The expert or force map that it asks, where that is not its kind's own.
    """
    kind = kind_of(estimator)
    own = KINDS[kind].option_units
    options = {name: _written(value, own[name]) for name, value in estimator.options.items()
               if name in own and value is not None}  # fmt: skip
    limits = {name: v for name, v in estimator.options.items() if name in FilterFile.model_fields}
    by_name = {state.name: state.unit for state in estimator.states}
    return FilterFile(
        kind=kind,
        description=estimator.description,
        bearing=BearingOf.of(bearing),
        sampling_time=estimator.bearing.sampling_time,
        noise=Assumed(**estimator.variances._asdict()),
        options=options,
        magnet=None if magnet is None else Reference.to(magnet),
        start={name: _written(std, by_name[name]) for name, std in estimator.start_std.items()},
        inputs=estimator.inputs,
        origin=dict(estimator.origin),
        **limits,
    )


def magnet_in(path: str | os.PathLike[str], bearing: Bearing) -> MagnetModel:
    """Return the expert in a file, or the surface through the points of a force map.

    Parameters
    ----------
    path : path
        From ``ambkit train`` (.json), or points of iu, x and f_mag (.csv, .parquet).
    bearing : Bearing
        Whose magnet that is.

    Raises
    ------
    AmbkitError
        It cannot be read, or is neither.
    """
    if Path(path).suffix.lower() not in (".csv", ".parquet"):
        from ambkit.fuzzy.expert import Expert

        return Expert.load(path)
    return surface_in(path, bearing)


def made_by(command: str, what: str) -> str:
    """Return where a number came from, as a filter's file tells it: from what, by which command."""
    return f"{what}; ambkit {command} {version('ambkit')}"


def origin_of(values: Iterable[str], said: str) -> dict[str, str]:
    """Return where numbers came from, by their keys in a file, for the names of tunables."""
    return {name if "." in name else f"options.{name}": said for name in values}


class NoFile(AmbkitError):
    """What a filter knows of its magnet cannot be written."""


def _changed(file: Any, sha256: Any) -> Iterator[tuple[str, str]]:
    """Tell of a file that is not there, or not what it was."""
    if not isinstance(file, str):
        return
    try:
        now = files.sha256(file)
    except AmbkitError as error:
        yield "file", str(error)
        return
    if isinstance(sha256, str) and sha256 and sha256 != now:
        yield (
            "sha256",
            (
                f"{file} is not what it was when this filter was made (its hash begins {now[:8]}, "
                f"not {sha256:.8}); make it anew, or leave out sha256 to take the file as it is"
            ),
        )


def _option(value: Any, unit: str) -> Any:
    """Return an option's value in SI; a word, where its unit is empty."""
    if not unit:
        return value
    if isinstance(value, str):
        return units.parse(value, unit)
    if unit != "1":
        raise ValueError(f"{value!r} has no unit, write it like {_written(float(value), unit)!r}")
    return value


def _written(value: Any, unit: str) -> Any:
    """Return a value as a file has it."""
    if not unit or unit == "1":
        return value
    return units.engineering(in_si("option", value, unit), unit, digits=None)


def _start(given: Mapping[str, str], made: Estimator) -> dict[str, float]:
    """Return standard deviations at the start in SI."""
    known = {state.name: state.unit for state in made.states}
    found = {}
    for name, text in given.items():
        if name not in known:
            raise ValueError(f"start.{name}: there is no such state; there are {', '.join(known)}")
        std = units.parse(text, known[name])
        if not (math.isfinite(std) and std > 0):
            raise ValueError(f"start.{name}: must be finite and greater than 0, is {text}")
        found[name] = std
    return found


def save(
    estimator: Estimator,
    path: str | os.PathLike[str],
    bearing: str | os.PathLike[str] | None = None,
    magnet: str | os.PathLike[str] | None = None,
) -> None:
    """Write an estimator, and beside it what it needs and has no file yet.

    Parameters
    ----------
    estimator, path, bearing, magnet
        See `ambkit.Estimator.save`.
    """
    path, known = Path(path), estimator.bearing
    if bearing is None:
        bearing = preset_of(known)
    if bearing is None:
        bearing = path.with_suffix(".bearing.toml")
        known.save(bearing)
    if magnet is None and not _asks_its_own(estimator):
        magnet = _written_beside(path, estimator.magnet)
    described(estimator, bearing, magnet).save(path)


def preset_of(bearing: Bearing) -> str | None:
    """Return the name of the preset that a bearing is, if it is one."""
    from ambkit.machine import presets

    name = bearing.name
    return name if name in presets.names() and Bearing.preset(name) == bearing else None


def _asks_its_own(estimator: Estimator) -> bool:
    """Whether an estimator knows of its magnet what its kind does by itself."""
    kind = kind_of(estimator)
    if KINDS[kind].magnet is None and kind != "table":
        return False
    made = KINDS[kind].make(estimator.bearing, learned_magnet(kind, estimator.bearing))
    own, its = (each.magnet.in_core(made.engine.core) for each in (made, estimator))
    return type(own) is type(its) and _alike(own.parameters, its.parameters)


def _alike(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    return a.keys() == b.keys() and all(
        _alike(a[key], b[key]) if isinstance(a[key], Mapping) else np.array_equal(a[key], b[key])
        for key in a
    )


def _written_beside(path: Path, magnet: MagnetModel) -> Path:
    """Write what a filter asks beside its file, and return where.

    Raises
    ------
    AmbkitError
        There is no file of such.
    """
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.forces.surface import ForceSurface

    if isinstance(magnet, Expert):
        magnet.save(beside := path.with_suffix(".expert.json"))
        return beside
    if isinstance(magnet, ForceSurface):
        magnet.points.save(beside := path.with_suffix(".forces.csv"))
        return beside
    raise NoFile(
        f"{path}: this filter knows its magnet by a {type(magnet).__name__} that is not its "
        "bearing's own, and there is no file of such; save a filter with an expert or a force map"
    )
