"""An axis of a machine among others: its name, the reading that shows it, and a change of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.machine.geometry import Line
    from ambkit.machine.machine import Bearing, Machine

ALIGNED = math.cos(math.radians(1))
"""Cosine of the angle between an axis and a reading that still shows it."""


def axis_named(machine: Machine, axis: str | None) -> str:
    """Return the name of an axis; it may be left out where there is only one."""
    names = [item.name for item in machine.axes]
    if axis is None and len(names) == 1:
        return names[0]
    if axis not in names:
        hint = "name one of them" if axis is None else f"there is no axis {axis}"
        there = "one axis" if machine.single else f"the axes {', '.join(names)}"
        raise AmbkitError(f"{machine.name} has {there}: {hint}")
    return axis


def isolated(machine: Machine, axis: str | None) -> Bearing:
    """Return an axis alone; its name may be left out where there is only one."""
    return machine.isolated_axis(axis_named(machine, axis))


def reading_along(machine: Machine, axis: str) -> int:
    """Return the number of the reading that shows an axis, at its place or next to it."""
    if machine.single:
        return 0
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


def with_axis(machine: Machine, axis: str, result: Bearing) -> Machine:
    """Return a copy with magnet, amplifier, sensor and times of an axis, not checked."""
    machine = machine.long
    own = next(item.bearing for item in machine.axes if item.name == axis)
    seen = machine.readings[reading_along(machine, axis)].sensor
    changes = {
        "magnet": result.magnet, "amplifier": result.amplifier, "coil": result.coil,
        "clearance": result.rotor.clearance,
    }  # fmt: skip
    return machine.model_copy(
        update={
            "sampling_time": result.sampling_time,
            "delay": result.delay,
            "bearing": tuple(
                bearing.model_copy(update=changes) if bearing is own else bearing
                for bearing in machine.bearings
            ),
            "sensor": tuple(
                sensor.model_copy(update=dict(result.sensor)) if sensor is seen else sensor
                for sensor in machine.sensors
            ),
        }
    )
