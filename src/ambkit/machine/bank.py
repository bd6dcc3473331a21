"""The magnets of a bearing or of a whole machine, axis by axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any, cast

from ambkit.machine import geometry
from ambkit.machine.bearing import GRAVITY, Bearing
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import (
    ConstantStiffness,
    MagnetModel,
    bias_force_of,
    magnet_of,
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


def bank_of(magnet: MagnetModel | Sequence[MagnetModel]) -> MagnetModel:
    """Return what is known of magnets as one: of several axes a `Bank`."""
    return Bank(magnet) if isinstance(magnet, list | tuple) else cast("MagnetModel", magnet)


def alone_of(of: Bearing | Machine) -> tuple[Bearing, ...]:
    """Return the axes, each as a bearing alone; a bearing is its own."""
    if isinstance(of, Machine):
        return tuple(of.alone(axis.name) for axis in of.axes)
    return (of,)


def laws_of(of: Bearing | Machine) -> MagnetModel:
    """Return the magnets that a bearing or a machine describes."""
    return Bank(map(magnet_of, alone_of(of))) if isinstance(of, Machine) else magnet_of(of)


def constants_of(of: Bearing | Machine) -> MagnetModel:
    """Return the constant stiffnesses of the work point."""
    if isinstance(of, Machine):
        return Bank(map(ConstantStiffness.of, alone_of(of)))
    return ConstantStiffness.of(of)


def bias_forces_of(magnet: MagnetModel, of: Bearing | Machine) -> list[float]:
    """Return the force of each axis at iu = 0, x = 0 [N]; see `bias_force_of`."""
    models = magnet.models if isinstance(magnet, Bank) else (magnet,)
    return [bias_force_of(each, b) for each, b in zip(models, alone_of(of), strict=True)]


def weights_of(of: Bearing | Machine) -> list[float]:
    """Return the forces along the axes that do what gravity does [N]."""
    if isinstance(of, Machine):
        return [-float(f) for f in geometry.supporting_forces(of.rotor, of.axes, GRAVITY)]
    return [of.weight]
