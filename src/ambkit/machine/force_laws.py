"""The magnets of a machine, axis by axis: of a single axis its law, of several a `Bank`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from ambkit.base.quantity_arguments import of_type
from ambkit.machine import geometry
from ambkit.machine.bearing import GRAVITY
from ambkit.machine.machine import Bearing, Machine
from ambkit.machine.magnets import (
    ConstantStiffness,
    MagnetModel,
    bias_force_of,
    magnet_of,
    own_time,
)


@dataclass(frozen=True)
class Bank:
    """What is known of the magnets of several axes."""

    #: (p,) Of each axis, in their order: force laws, experts, maps, constant stiffnesses.
    models: tuple[MagnetModel, ...]

    def __init__(self, models: Iterable[MagnetModel]) -> None:
        object.__setattr__(self, "models", tuple(models))

    def in_core(self, core: ModuleType) -> Any:
        """Build the C implementations, a list."""
        return [model.in_core(core) for model in self.models]


def bank_of(magnet: MagnetModel | Sequence[MagnetModel], of: Machine) -> MagnetModel:
    """Return what is known of magnets as one: of several axes a `Bank`."""
    models = tuple(magnet) if isinstance(magnet, list | tuple) else models_of(magnet)
    for model in models:
        of_type(MagnetModel, magnet=model)
    return models[0] if of.single and len(models) == 1 else Bank(models)


def models_of(magnet: Any) -> tuple[MagnetModel, ...]:
    """Return what is known of the magnet of each axis."""
    return magnet.models if isinstance(magnet, Bank) else (magnet,)


def isolated_axes(of: Machine) -> tuple[Bearing, ...]:
    """Return the axes, each with all others held still."""
    return tuple(of.isolated_axis(axis.name) for axis in of.axes)


def slowest_time(of: Machine) -> float:
    """Return the time constant of the slowest axis [s]."""
    return max(map(own_time, isolated_axes(of)))


def _each(of: Machine, made: Callable[[Bearing], MagnetModel]) -> MagnetModel:
    return bank_of([made(axis) for axis in isolated_axes(of)], of)


def laws_of(of: Machine) -> MagnetModel:
    """Return the magnets that a machine describes."""
    return _each(of, magnet_of)


def constants_of(of: Machine) -> MagnetModel:
    """Return the constant stiffnesses of the operating point."""
    return _each(of, ConstantStiffness.of)


def bias_forces_of(magnet: MagnetModel, of: Machine) -> list[float]:
    """Return the force of each axis at iu = 0, x = 0 [N]; see `bias_force_of`."""
    return [
        bias_force_of(item, b) for item, b in zip(models_of(magnet), isolated_axes(of), strict=True)
    ]


def weights_of(of: Machine) -> list[float]:
    """Return the forces along the axes that do what gravity does [N]."""
    return [-float(f) for f in geometry.supporting_forces(of.rotor, of.axes, GRAVITY)]
