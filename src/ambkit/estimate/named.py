"""Estimators by name, with their default magnet models."""

import logging
import os
from collections.abc import Callable, Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import Any, Protocol

from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import MARK, load_class
from ambkit.base.quantity_arguments import names_in, of_type
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile, filter_file_for, magnet_in
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import (
    FILTER_SUFFIX,
    KINDS,
    check_named,
    default_name,
    learned_magnet,
    make_filter,
    split_name,
)
from ambkit.estimate.user_filter import OwnEstimator, is_own, own_factory
from ambkit.fuzzy.expert import Expert
from ambkit.machine.axes import force_laws, isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, Precision

EXPERTS = (".json", ".csv", ".parquet")
"""Suffixes of an expert's file, and of the points of a force map."""


def experts(path: Path, machine: Machine) -> MagnetModel:
    """Return the expert in a file for each axis of a machine, whose magnets must be equal."""
    axes = isolated_axes(machine)
    other = next((b.name for b in axes if b.magnet != axes[0].magnet), None)
    if other is not None:
        raise AmbkitError(
            f"{path}: an expert is of one magnet, and the axes {axes[0].name} and {other} of "
            f"{machine.name} have different ones"
        )
    magnet = magnet_in(path, axes[0])
    if isinstance(magnet, Expert) and not magnet.source.startswith(axes[0].name):
        logging.getLogger("ambkit").warning(
            "%s: was trained for %s, not for %s", path, magnet.source, axes[0].name
        )
    return force_laws([magnet] * len(axes), machine)


USUAL = ("linear", "adaptive", "closed-law")
"""Default comparison: constant, learned and exact stiffness."""


class Factory(Protocol):
    """Builder of an estimator."""

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build a new one; by default with the machine's own noise."""


@dataclass(frozen=True)
class FromKind:
    """Builder of a kind."""

    name: str
    machine: Machine
    magnet: MagnetModel | None

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build one with this noise, by default the machine's."""
        try:
            return make_filter(
                self.name, self.machine, self.magnet, noise=noise, precision=precision
            )
        except ValueError as error:
            raise AmbkitError(str(error)) from error


@dataclass(frozen=True)
class FromFile:
    """Builder of a filter file, which defines the noise too."""

    file: FilterFile
    magnet: MagnetModel | None = None

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build a new one; `noise` is ignored."""
        return self.file.make(precision=precision, magnet=self.magnet)


@dataclass(frozen=True)
class FromObject:
    """Copies an existing filter, or calls a function that makes one."""

    name: str
    source: Estimator | Callable[[], Any]
    machine: Machine

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision | None = None
    ) -> Estimator:
        """Return a new one; `noise` is ignored."""
        made: Any = self.source
        if not isinstance(made, Estimator):
            needed = [p for p in signature(made).parameters.values() if p.default is p.empty]
            made = made(self.machine) if needed else made()
        if not isinstance(made, Estimator):  # a class of the user, or an object of one
            make: Any = made if is_own(made) else self.source
            made = OwnEstimator(self.machine, make, self.name)
        if precision not in (None, made.precision):
            raise AmbkitError(f"{self.name} computes in {made.precision}, not in {precision}")
        T, T_machine = made.machine.sampling_time, self.machine.sampling_time
        if abs(T - T_machine) > 1e-9 * T:
            raise AmbkitError(
                f"{self.name}: its sampling_time is {T:g} s, that of {self.machine.name} "
                f"{T_machine:g} s"
            )
        one: Estimator = deepcopy(made)
        return one


def factories(filters: Any, machine: Machine) -> dict[str, Factory]:
    """Return the builders of filters, from any argument of a verb; None: the usual ones."""
    if filters is None:
        filters = [default_name(machine, kind) for kind in USUAL]
    if isinstance(filters, Mapping):
        return {name: _factory(name, item, machine) for name, item in filters.items()}
    several = names_in(Estimator, type, filter=filters)
    names = [item for item in several if isinstance(item, str | os.PathLike)]
    results: dict[str, Factory] = dict(_named(names, machine))
    for item in several:
        if isinstance(item, str | os.PathLike):
            continue
        name = item.__name__ if isinstance(item, type) else item.name
        if name in results:
            raise AmbkitError(f"two filters are called {name}: give them as a mapping")
        results[name] = _factory(name, item, machine)
    return results


def filter_of(filter: Any, machine: Machine) -> Estimator:
    """Return the filter of a loop: an estimator itself, anything else built for the machine."""
    if isinstance(filter, str | os.PathLike):
        built = factories([os.fspath(filter)], machine)
        if len(built) > 1:
            raise AmbkitError("a loop has one filter: name one of them, not all")
        return built[os.fspath(filter)]()
    if is_own(filter):
        return OwnEstimator(machine, filter)
    of_type(Estimator, str, filter=filter)
    made: Estimator = filter
    return made


def _factory(name: str, item: Any, machine: Machine) -> Factory:
    if isinstance(item, FromKind | FromFile | FromObject):
        return item
    if isinstance(item, str | os.PathLike):
        (factory,) = _named([item], machine).values()
        return factory
    if is_own(item):
        return own_factory(name, item, machine)
    if isinstance(item, type) or not (isinstance(item, Estimator) or callable(item)):
        of_type(Estimator, **{name: item})
    return FromObject(name, item, machine)


def _named(names: Iterable[Any], machine: Machine) -> dict[str, Factory]:
    def factory(name: str) -> Factory:
        if name.endswith(FILTER_SUFFIX):
            return FromFile(filter_file_for(name, machine))
        if MARK in name:
            return own_factory(*load_class(name), machine)
        if not name.endswith(EXPERTS):
            return FromKind(name, machine, learned_magnet(name, machine))
        file = split_name(name)[2]
        return FromKind(name if file else "adaptive", machine, experts(Path(file or name), machine))

    return {name: factory(name) for name in expanded(names)}


def expanded(names: Iterable[str]) -> list[str]:
    """Return unique names of estimators, with all kinds for ``"all"``."""
    results: dict[str, None] = {}
    for name in map(os.fspath, names):
        check_named(name)
        results |= dict.fromkeys(KINDS if name == "all" else [name])
    return list(results)
