"""An estimator as a file: its complete definition, with the origin of each number.

::

    format = 1
    kind = "extended"
    sampling_time = "0.25 ms"

    [machine]
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

With several axes ``[magnets.NAME]`` of a bearing replaces ``[magnet]``; a variance may be a list
with a number for each reading or axis, and ``synchronous = ["unbalance"]`` lists the estimated
synchronous states.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, model_serializer

from ambkit.base import units
from ambkit.base.config import Document, Read, unknown_key
from ambkit.base.config.quantities import Description, Line, Name, Quantity
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si
from ambkit.data.input_scaling import Inputs
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_parts import NoiseSettings, PlantOf, Reference
from ambkit.estimate.machine_model import View
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS, FilterKind, get_kind, learned_magnet
from ambkit.machine.axes import force_laws, isolated_axes
from ambkit.machine.forces.force_map import surface_in
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision
from ambkit.machine.placement_checks import OF_A_ROTOR

Limit = Annotated[int, Field(ge=0, strict=True)]

LISTS = ("scales",)  #: Options that hold several numbers.
FORMAT = 1  #: Newest file format: written by this ambkit, and the newest that it reads.


class FilterFile(Document):
    """An estimator as a file."""

    format: Annotated[int, Field(ge=1, strict=True)] = FORMAT
    """Version of the file format. By default 1."""
    kind: Name
    """Kind, as listed by ``ambkit filter --help``."""
    description: Description = ""
    """Purpose."""
    machine: PlantOf
    """Machine."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)]
    """Time between two steps [s]: that of the machine."""
    gravity: Literal["known", "disturbance"] = "known"
    """Whether the weight is known, or part of the disturbance force."""
    gate: Annotated[float, Quantity("1", "8", above=0)] = 8.0
    """Innovations beyond this many standard deviations are outliers."""
    frozen_limit: Limit = 10
    """Equal consecutive measurements from which the sensor counts as frozen; 0: never."""
    outlier_limit: Limit = 3
    """Consecutive outliers after which the filter restarts; 0: never."""
    as_printed: bool = False
    """Whether to use eq. 19 as printed."""
    noise: NoiseSettings = NoiseSettings()
    """Assumed noise."""
    options: dict[Name, float | Line | tuple[float, ...]] = Field(default_factory=dict)
    """Options of the kind, such as memory or bandwidth, with units."""
    synchronous: tuple[Literal["unbalance", "runout"], ...] = ()
    """Synchronous quantities that are estimated too."""
    magnet: Reference | None = None
    """Expert (.json) or force map (.csv, .parquet) of the magnet. By default that of its kind."""
    magnets: dict[Name, Reference] = Field(default_factory=dict)
    """Such files for all bearings of a machine, by name."""
    start: dict[Name, Line] = Field(default_factory=dict)
    """Initial standard deviations other than the default, by state."""
    inputs: Inputs = Field(default_factory=Inputs)
    """Scaling of its inputs in the rig, also in the exported C."""
    origin: dict[Name, Line] = Field(default_factory=dict)
    """Origin of numbers by key: record, command, version."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        version = read("format")
        if version > FORMAT:
            yield "format", f"is {version}, and this ambkit reads up to {FORMAT}: use a newer one"
        wrong = list(_of_options(read("kind"), read("options")))
        yield from wrong
        keys = list(cls.model_fields)
        for name in read("origin") if isinstance(read("origin"), dict) else ():
            if name.partition(".")[0] not in keys:
                yield f"origin.{name}", unknown_key(name, keys)
        of = read("machine")
        if not isinstance(of, PlantOf):
            return
        T, own = read("sampling_time"), of.plant.sampling_time
        if abs(T - own) > 1e-9 * own:
            time_texts = [units.engineering(item, "s") for item in (own, T)]
            yield "sampling_time", f"must be the machine's, {time_texts[0]}, is {time_texts[1]}"
        yield from _contradictions_of(View(of.plant), read)
        options = read("options")
        if read("kind") in KINDS and isinstance(options, dict) and options and not wrong:
            yield from _out_of_range(of.plant, KINDS[read("kind")], options)

    @property
    def plant(self) -> Any:
        """The machine."""
        return self.machine.plant

    @model_serializer(mode="wrap")
    def _without_empty(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Omit empty values."""

        def without_empty(value: Any) -> Any:
            if not isinstance(value, dict):
                return value
            entries = {key: without_empty(item) for key, item in value.items()}
            return {
                key: entry for key, entry in entries.items() if entry not in ("", {}, (), [], None)
            }

        data: dict[str, Any] = without_empty(handler(self))
        if not self.plant.single:
            data.pop("inputs", None)  # for a single axis only
        return data

    def magnet_model(self) -> MagnetModel | None:
        """Return its magnet model; None for the default of its kind.

        Raises
        ------
        AmbkitError
            The magnet's file is neither an expert nor a force map.
        """
        if self.magnets:
            parts = {
                axis.bearing.name: magnet_in(self.magnets[axis.bearing.name].file, isolated)
                for axis, isolated in zip(self.plant.axes, isolated_axes(self.plant), strict=True)
            }
            return force_laws([parts[axis.bearing.name] for axis in self.plant.axes], self.plant)
        if self.magnet is None:
            return learned_magnet(self.kind, self.plant)
        return magnet_in(self.magnet.file, self.plant)

    def make(
        self, *, precision: Precision = "float64", magnet: MagnetModel | None = None
    ) -> Estimator:
        """Return the estimator.

        Parameters
        ----------
        precision : {"float64", "float32"}
            Precision of the core.
        magnet : optional
            Magnet model in place of `magnet_model`, such as the table of its expert.

        Raises
        ------
        AmbkitError
            The magnet's file is neither an expert nor a force map; or an option or start is out of
            range.
        """
        kind = KINDS[self.kind]
        if magnet is None:
            magnet = self.magnet_model()
        limits = ("gravity", "gate", "frozen_limit", "outlier_limit", "as_printed")
        options = {name: _option(v, kind.option_units[name]) for name, v in self.options.items()}
        if self.synchronous:
            options["synchronous"] = self.synchronous
        try:
            made = kind.make(
                self.plant, magnet, precision=precision,
                noise=FilterNoise(**self.noise.model_dump()),
                **{name: getattr(self, name) for name in limits}, **options,
            )  # fmt: skip
            made.start_std = _start(self.start, made)
            made.reset()
        except ValueError as error:
            raise AmbkitError(str(error)) from None
        if "inputs" in self.model_fields_set:
            made.inputs = self.inputs
        made.origin, made.description = self.origin, self.description
        return made


def filter_file_for(path: str | os.PathLike[str], machine: Machine) -> FilterFile:
    """Read a filter for a machine with equal sampling time, axes and readings."""
    result, T = FilterFile.load(path), machine.sampling_time
    _check_alike(path, result.plant, machine)
    if abs(result.sampling_time - T) > 1e-9 * T:
        steps, is_sampled = (units.engineering(t, "s") for t in (result.sampling_time, T))
        raise AmbkitError(
            f"{os.fspath(path)}: this filter steps every {steps}, and {machine.name} "
            f"is sampled every {is_sampled}"
        )
    return result


def magnet_in(path: str | os.PathLike[str], machine: Machine) -> MagnetModel:
    """Return the expert in a file, or the surface through the points of a force map."""
    from ambkit.fuzzy.expert import Expert

    return Expert.load(path) if Path(path).suffix.lower() == ".json" else surface_in(path, machine)


def _of_options(kind: Any, options: Any) -> Iterator[tuple[str, str]]:
    """Yield unknown kinds and options."""
    if not isinstance(kind, str):
        return
    try:
        known = get_kind(kind).option_units
    except AmbkitError as error:
        yield "kind", str(error)
        return
    for name, value in options.items() if isinstance(options, dict) else ():
        if name not in known:
            yield f"options.{name}", f"{unknown_key(name, known)}, of the {kind}"
            continue
        if isinstance(value, tuple) != (several := name in LISTS):
            yield f"options.{name}", f"must be {'a list of numbers' if several else 'one number'}"
            continue
        try:
            _option(value, known[name])
        except ValueError as error:
            yield f"options.{name}", str(error)


def _out_of_range(
    machine: Machine, kind: FilterKind, options: Mapping[str, Any]
) -> Iterator[tuple[str, str]]:
    """Yield an option that its kind refuses, with the reason."""
    try:
        kind.make(machine, **{k: _option(v, kind.option_units[k]) for k, v in options.items()})
    except ValueError as error:
        name, _, text = str(error).partition(" ")
        if name in options:
            yield f"options.{name}", text


def _contradictions_of(view: View, read: Read) -> Iterator[tuple[str, str]]:
    """Yield settings that do not match a filter of these axes."""
    machine, kind, single = view.machine, read("kind"), view.single
    if kind in KINDS and not KINDS[kind].estimator.takes(machine):
        names = ", ".join(machine.axis_names)
        yield "kind", f"the {kind} takes one axis; {machine.name} has the axes {names}"
    synchronous = read("synchronous")
    known = isinstance(synchronous, tuple)
    if known and "unbalance" in synchronous and machine.rotor.type == "mass":
        yield "synchronous", f"unbalance {OF_A_ROTOR}"
    magnets, names_of = read("magnets"), [bearing.name for bearing in machine.bearings]
    if single and magnets:
        yield "magnets", "are of named bearings; the one axis has its [magnet]"
    elif isinstance(magnets, dict) and magnets and sorted(magnets) != sorted(names_of):
        yield "magnets", f"must be of {', '.join(names_of)}, is of {', '.join(magnets)}"
    if not single and isinstance(read("magnet"), Reference):
        yield "magnet", "is of one axis; of several write [magnets.NAME] for each bearing"
    inputs = read("inputs")
    if not single and isinstance(inputs, Inputs) and inputs != Inputs():
        yield "inputs", "are of one axis; readings of several are in m, control signals in V"
    if (
        single
        and isinstance(inputs, Inputs)
        and (inputs.u.si_unit, machine.control_unit) == ("A", "V")
    ):
        yield "inputs.u.unit", "makes u a quantity in A, it is one in V"
    noise = read("noise")
    if isinstance(noise, NoiseSettings):
        yield from view.count_of(FilterNoise(**noise.model_dump()))


def _check_alike(path: str | os.PathLike[str], own: Any, other_machine: Machine) -> None:
    """Reject a filter of other axes or readings."""

    def about(machine: Machine) -> str:
        if machine.single:
            return f"{machine.name}, which has one axis"
        axes, readings = (
            ", ".join(item.name for item in many) for many in (machine.axes, machine.readings)
        )
        return f"{machine.name}, a machine with axes {axes} and readings {readings}"

    def lines(machine: Machine) -> list[list[str]]:
        return [[item.name for item in many] for many in (machine.axes, machine.readings)]

    if lines(own) != lines(other_machine):
        raise AmbkitError(
            f"{os.fspath(path)}: this filter is of {about(own)}; not of {about(other_machine)}"
        )


def _option(value: Any, unit: str) -> Any:
    """Return an option's value in SI; a word if its unit is empty."""
    if not unit:
        return value
    if isinstance(value, str):
        return units.parse(value, unit)
    if unit != "1":
        raise ValueError(f"{value!r} has no unit, write it like {written(float(value), unit)!r}")
    return value


def written(value: Any, unit: str) -> Any:
    """Return a value for a file."""
    if not unit or unit == "1":
        return value
    return units.engineering(in_si("option", value, unit), unit, digits=None)


def _start(std_texts: Mapping[str, str], made: Estimator) -> dict[str, float]:
    """Return initial standard deviations in SI."""
    known = {state.name: state.unit for state in made.states}
    results = {}
    for name, text in std_texts.items():
        if name not in known:
            raise ValueError(f"start.{name}: {unknown_key(name, known)}")
        std = units.parse(text, known[name])
        if not (math.isfinite(std) and std > 0):
            raise ValueError(f"start.{name}: must be finite and greater than 0, is {text}")
        results[name] = std
    return results
