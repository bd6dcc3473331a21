"""The axes of a machine: each isolated, with what is known of its magnet."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import of_type
from ambkit.machine import geometry
from ambkit.machine.geometry import Line
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import (
    ConstantStiffness,
    MagnetModel,
    bias_force_of,
    magnet_of,
    own_time,
)
from ambkit.machine.parts import GRAVITY


@dataclass(frozen=True)
class ForceLaws:
    """What is known of the magnets of several axes."""

    #: (p,) Of each axis, in their order: force laws, experts, maps, constant stiffnesses.
    models: tuple[MagnetModel, ...]

    def __init__(self, models: Iterable[MagnetModel]) -> None:
        object.__setattr__(self, "models", tuple(models))

    def in_core(self, core: ModuleType) -> Any:
        """Build the C implementations, a list."""
        return [model.in_core(core) for model in self.models]


def force_laws(magnet: MagnetModel | Sequence[MagnetModel], of: Machine) -> MagnetModel:
    """Return what is known of magnets as one: of several axes a `ForceLaws`."""
    models = tuple(magnet) if isinstance(magnet, list | tuple) else models_of(magnet)
    for model in models:
        of_type(MagnetModel, magnet=model)
    return models[0] if of.single and len(models) == 1 else ForceLaws(models)


def models_of(magnet: Any) -> tuple[MagnetModel, ...]:
    """Return what is known of the magnet of each axis."""
    return magnet.models if isinstance(magnet, ForceLaws) else (magnet,)


def isolated_axes(of: Machine) -> tuple[Machine, ...]:
    """Return the axes, each with all others held still."""
    return tuple(of.isolated_axis(axis.name) for axis in of.axes)


def slowest_time(of: Machine) -> float:
    """Return the time constant of the slowest axis [s]."""
    return max(map(own_time, isolated_axes(of)))


def _of_axes(of: Machine, made: Callable[[Machine], MagnetModel]) -> MagnetModel:
    return force_laws([made(axis) for axis in isolated_axes(of)], of)


def ideal_laws(of: Machine) -> MagnetModel:
    """Return the magnets that a machine describes."""
    return _of_axes(of, magnet_of)


def constant_stiffness(of: Machine) -> MagnetModel:
    """Return the constant stiffnesses of the operating point."""
    return _of_axes(of, ConstantStiffness.of)


def bias_forces(magnet: MagnetModel, of: Machine) -> list[float]:
    """Return the force of each axis at iu = 0, x = 0 [N]; see `bias_force_of`."""
    return [
        bias_force_of(item, b) for item, b in zip(models_of(magnet), isolated_axes(of), strict=True)
    ]


def weights_of(of: Machine) -> list[float]:
    """Return the forces along the axes that do what gravity does [N]."""
    return [-float(f) for f in geometry.supporting_forces(of.rotor, of.axes, GRAVITY)]


def load_capacity(plant: Machine) -> list[float]:
    """Return the disturbance [N] that each axis can hold at x = 0, in either direction."""
    results = []
    for b, weight in zip(isolated_axes(plant), weights_of(plant), strict=True):
        law = magnet_of(b)
        ends = (b.current_min, b.current_max)
        results.append(min(abs(float(law.force(end, 0.0)) + weight) for end in ends))
    return results


ALIGNED = math.cos(math.radians(1))
"""Cosine of the angle between an axis and a reading that still shows it."""


def axis_named(machine: Machine, axis: str | None) -> str:
    """Return the name of an axis; it may be left out where there is only one."""
    names = [item.name for item in machine.axes]
    if axis is None and len(names) == 1:
        return names[0]
    if axis not in names:
        hint = "name one of them as the axis" if axis is None else f"there is no axis {axis}"
        there = f"the axes {', '.join(names)}" if any(names) else "one axis"
        raise AmbkitError(f"{machine.name} has {there}: {hint}")
    return axis


def isolated(machine: Machine, axis: str | None) -> Machine:
    """Return an axis alone; its name may be left out where there is only one."""
    return machine.isolated_axis(axis_named(machine, axis))


def axis_of(machine: Any) -> Machine:
    """Return the axis of a machine that has one."""
    of_type(Machine, machine=machine)
    return isolated(machine, None)


def reading_along(machine: Machine, axis: str) -> int:
    """Return the number of the reading that shows an axis, at its place or next to it."""
    line = next(item.line for item in machine.axes if item.name == axis)
    lines = [reading.line for reading in machine.readings]
    aligned = [k for k, other in enumerate(lines) if _aligned(line, other)]
    if not aligned:
        raise AmbkitError(f"{machine.name}: no sensor looks along the axis {axis}")
    return min(aligned, key=lambda k: abs(lines[k].place - line.place))


def _aligned(one: Line, other: Line) -> bool:
    if one.axial or other.axial:
        return one.axial and other.axial
    return one.cosine * other.cosine + one.sine * other.sine > ALIGNED


def with_axis(machine: Machine, axis: str, result: Machine) -> Machine:
    """Return a copy with magnet, amplifier, sensor and times of an axis, not checked."""
    own = next(item.bearing for item in machine.axes if item.name == axis)
    seen = machine.readings[reading_along(machine, axis)].sensor
    changes = {
        "magnet": result.magnet, "amplifier": result.amplifier, "coil": result.coil,
        "clearance": result.clearance,
    }  # fmt: skip
    return machine.model_copy(
        update={
            "sampling_time": result.sampling_time,
            "delay": result.delay,
            "bearings": tuple(
                bearing.model_copy(update=changes) if bearing is own else bearing
                for bearing in machine.bearings
            ),
            "sensors": tuple(
                sensor.model_copy(update=result.sensor.tables()) if sensor is seen else sensor
                for sensor in machine.sensors
            ),
        }
    )
