"""Estimators by their names, each with what it asks of the magnet where nobody gives it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import MARK, load_class
from ambkit.base.quantity_arguments import names_in
from ambkit.estimate.experts import EXPERTS, experts
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.registry import FILTER_SUFFIX, KINDS, check_named, learned_magnet
from ambkit.estimate.user_filter import own_factory

if TYPE_CHECKING:
    from ambkit.estimate.estimator import Estimator
    from ambkit.estimate.noise_model import FilterNoise
    from ambkit.machine.machine import Machine
    from ambkit.machine.magnets import MagnetModel, Precision

AT = "@"
"""Between a kind and the file with what it asks of its magnet, as in ``adaptive@expert.json``."""

PLUS = "+"
"""Between a kind and what it estimates too of a rotor that turns, as in ``linear+unbalance``."""

USUAL = ("linear", "adaptive", "closed-law")
"""Who is compared where nobody says it: without, with a learned and with the exact stiffness."""


class Factory(Protocol):
    """What builds an estimator."""

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build a fresh one; by default it assumes the bearing's own noise."""


@dataclass(frozen=True)
class FromFile:
    """What builds the filter in a file: it assumes what the file says, and nothing else."""

    file: FilterFile

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Build a fresh one; `noise` is that of others, and left alone."""
        return self.file.make(precision=precision)


@dataclass(frozen=True)
class FromObject:
    """What returns a filter that exists: it assumes what it was made with."""

    filter: Estimator

    def __call__(
        self, noise: FilterNoise | None = None, *, precision: Precision = "float64"
    ) -> Estimator:
        """Return it; `noise` is that of others, and left alone."""
        return self.filter


def factories(
    names: Iterable[str],
    bearing: Machine,
    magnets: Mapping[str, MagnetModel] | None = None,
    synchronous: Sequence[str] = (),
) -> dict[str, Factory]:
    """Return what builds each of the chosen estimators, as often as asked."""
    chosen, own_magnets = expanded(names), dict(magnets or {})
    for name in own_magnets:
        if name not in chosen:
            raise AmbkitError(f"a magnet is given for {name}, which is not among those chosen")

    def factory(name: str) -> Factory:
        if name.endswith(FILTER_SUFFIX):
            if synchronous:
                raise AmbkitError(f"synchronous is of kinds; {name} says itself what it estimates")
            return FromFile(FilterFile.load_for(name, bearing))
        if MARK in name:
            if synchronous:
                raise AmbkitError(f"synchronous is of kinds; {name} is a class of your own")
            return own_factory(*load_class(name), bearing)
        kind, *own = name.partition(AT)[0].split(PLUS)
        magnet: MagnetModel | None
        if name.endswith(EXPERTS):
            file = name.partition(AT)[2]
            magnet = experts(Path(file or name), bearing)
            kind = kind if file else "adaptive"
        else:
            magnet = own_magnets[name] if name in own_magnets else learned_magnet(kind, bearing)
        sync_options = {"synchronous": (*synchronous, *own)} if synchronous or own else {}

        def make(noise: FilterNoise | None = None, **options: Any) -> Estimator:
            try:
                return KINDS[kind].make(bearing, magnet, noise=noise, **sync_options, **options)
            except ValueError as error:
                raise AmbkitError(str(error)) from error

        return make

    return {name: factory(name) for name in chosen}


def expanded(names: Iterable[str]) -> list[str]:
    """Return names of estimators, each once, with all kinds for ``"all"``."""
    results: dict[str, None] = {}
    for name in map(os.fspath, names_in(estimators=names)):
        check_named(name)
        results |= dict.fromkeys(KINDS if name == "all" else [name])
    return list(results)
