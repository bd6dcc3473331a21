"""Saving of a filter, with the files it needs."""

import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.config.quantities import InOther
from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile, written
from ambkit.estimate.filter_parts import NoiseSettings, PlantOf, Reference
from ambkit.estimate.noise_model import UNITS
from ambkit.estimate.registry import KINDS, kind_of, learned_magnet
from ambkit.machine import presets
from ambkit.machine.axes import ForceLaws
from ambkit.machine.forces.patches import PatchedForce
from ambkit.machine.loading import load_machine
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision


def described(
    filter: Estimator,
    machine: str | os.PathLike[str],
    magnet: str | os.PathLike[str] | Mapping[str, Path] | None = None,
) -> FilterFile:
    """Return the definition of a filter for a file."""
    kind = kind_of(filter)
    own = KINDS[kind].option_units
    all_options = {**getattr(filter, "inner", filter).options, **filter.options}
    options = {name: written(value, own[name]) for name, value in all_options.items()
               if name in own and value is not None}  # fmt: skip
    limits = {name: v for name, v in all_options.items() if name in FilterFile.model_fields}
    of: dict[str, Any] = {"machine": PlantOf.of(machine)}
    if isinstance(magnet, Mapping):
        of["magnets"] = {name: Reference.to(path) for name, path in magnet.items()}
    elif magnet is not None:
        of["magnet"] = Reference.to(magnet)
    by_name = {state.name: state.unit for state in filter.states}
    return FilterFile(
        kind=kind,
        description=filter.description,
        sampling_time=filter.machine.sampling_time,
        noise=_assumed(filter),
        options=options,
        start={name: written(std, by_name[name]) for name, std in filter.start_std.items()},
        inputs=filter.inputs,
        origin=dict(filter.origin),
        **limits,
        **of,
    )


def in_memory(filter: Estimator) -> FilterFile:
    """Return the definition of a filter without its magnet, which is in memory."""
    with tempfile.TemporaryDirectory() as folder:
        machine: str | Path | None = preset_of(filter.machine)
        if machine is None:
            filter.machine.save(machine := Path(folder, "machine.toml"))
        result = described(filter, machine)
        result.plant  # noqa: B018  read while its file is there
    return result


def _assumed(filter: Estimator) -> NoiseSettings:
    """Return the assumed noise, that of a control signal in the signal's unit."""
    results = {name: getattr(filter.variances, name) for name in UNITS}
    for name, own in results.items():
        if isinstance(own, tuple) and len(set(own)) == 1:
            results[name] = own[0]
    if filter.machine.control_unit == "A":
        control_noise = results["control"]
        parts = control_noise if isinstance(control_noise, tuple) else (control_noise,)
        variances = tuple(InOther.of(value, "A^2") for value in parts)
        results["control"] = variances if isinstance(control_noise, tuple) else variances[0]
    return NoiseSettings(**results)


def made_by(command: str, what: str) -> str:
    """Return the origin of a number for a filter file: source and command."""
    return f"{what}; ambkit {command} {version('ambkit')}"


def origin_of(values: Iterable[str], origin: str) -> dict[str, str]:
    """Return the origin of numbers by their keys in a file, for the names of tunables."""
    return {name if "." in name else f"options.{name}": origin for name in values}


class NotSaveable(AmbkitError):
    """The magnet model of a filter has no file format."""


def load(path: str | os.PathLike[str], precision: Precision) -> Estimator:
    """Return the filter in a file."""
    return FilterFile.load(path).make(precision=precision)


def save(
    filter: Estimator,
    path: str | os.PathLike[str],
    machine: str | os.PathLike[str] | None = None,
    magnet: str | os.PathLike[str] | None = None,
) -> None:
    """Save a filter, and beside it the files it needs."""
    path, known, single = Path(path), filter.machine, filter.view.single
    if machine is None:
        machine = preset_of(known)
    if machine is None:
        machine = path.with_suffix(".machine.toml")
        known.save(machine)
    magnet_files: str | os.PathLike[str] | Mapping[str, Path] | None = magnet
    if magnet is not None and not single:  # one file for all bearings
        magnet_files = dict.fromkeys((item.name for item in filter.machine.bearings), Path(magnet))
    if magnet is None and not _has_custom_force_law(filter):
        magnet_files = (
            _written_beside(path, filter.magnet) if single
            else _bearings_beside(path, filter.machine, filter.magnet)
        )  # fmt: skip
    described(filter, machine, magnet_files).save(path)


def preset_of(known: Machine) -> str | None:
    """Return the name of the preset that a machine equals, if there is one."""
    usual = known.name in presets.names() and load_machine(known.name) == known
    unit_matches = usual and load_machine(known.name).control_unit == known.control_unit
    return known.name if unit_matches else None


def _has_custom_force_law(filter: Estimator) -> bool:
    """Return whether a filter has the default magnet model of its kind."""
    kind = kind_of(filter)
    if KINDS[kind].magnet is None and kind != "table":
        return False
    made = KINDS[kind].make(filter.machine, learned_magnet(kind, filter.machine))
    own, its = (_in_core(item, made) for item in (made, filter))
    return all(
        type(one) is type(other) and _alike(one.parameters, other.parameters)
        for one, other in zip(own, its, strict=True)
    )


def _in_core(filter: Estimator, made: Estimator) -> Sequence[Any]:
    """Return the magnets of all axes in the core of another filter."""
    result = filter.magnet.in_core(made.engine.core)
    return result if isinstance(result, list) else [result]


def _alike(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    return a.keys() == b.keys() and all(
        _alike(a[key], b[key]) if isinstance(a[key], Mapping) else np.array_equal(a[key], b[key])
        for key in a
    )


def _bearings_beside(path: Path, machine: Machine, magnet: MagnetModel) -> dict[str, Path]:
    """Write the magnet models of a machine's filter beside its file: for each bearing, by name."""
    assert isinstance(magnet, ForceLaws)
    parts: dict[str, MagnetModel] = {}
    for axis, model in zip(machine.axes, magnet.models, strict=True):
        if parts.setdefault(axis.bearing.name, model) is not model:
            raise NotSaveable(
                f"{path}: the axes of bearing {axis.bearing.name} know it by two magnets"
            )
    return {
        name: _written_beside(path.with_suffix(f".{name}{path.suffix}"), model)
        for name, model in parts.items()
    }


def _written_beside(path: Path, magnet: MagnetModel) -> Path:
    """Write a magnet model beside a filter file, and return its path."""
    from ambkit.fuzzy.expert import Expert

    if isinstance(magnet, Expert):
        magnet.save(beside := path.with_suffix(".expert.json"))
        return beside
    if isinstance(magnet, PatchedForce):
        magnet.points.save(beside := path.with_suffix(".forces.csv"))
        return beside
    raise NotSaveable(
        f"{path}: this filter knows its magnet by a {type(magnet).__name__} that is not its "
        "bearing's own, and there is no file of such; save a filter with an expert or a force map"
    )
