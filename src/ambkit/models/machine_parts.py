"""A machine's parts, and its sampled model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ambkit.models.compose import compose
from ambkit.models.declaration import Part
from ambkit.models.model import Model
from ambkit.models.parts import PARTS, SENSOR_NOISE, SYNCHRONOUS, Delay
from ambkit.models.parts.typical_sizes import Typical


def machine_parts(
    machine: Any,
    *,
    noise: bool = True,
    delay: bool = True,
    synchronous: Sequence[str] = (),
    speeding: float = 0.0,
) -> list[Part]:
    """Return the parts of a machine, as its keys give them."""
    sizes = [Typical.of(machine.isolated_axis(axis.name)) for axis in machine.axes]
    kinds: list[Any] = [item for item in PARTS if delay or item is not Delay]
    parts: list[Part] = [part for kind in kinds for part in kind.of(machine, sizes)]
    for name in (item for item in SYNCHRONOUS if item in synchronous):
        parts += SYNCHRONOUS[name].of(machine, speeding)
    for kind in SENSOR_NOISE if noise else ():
        parts += kind.of(machine, sizes)
    return parts


def machine_model(
    machine: Any,
    *,
    T: float | None = None,
    noise: bool = True,
    synchronous: Sequence[str] = (),
    speeding: float = 0.0,
) -> Model:
    """Return the sampled model of a machine."""
    parts = machine_parts(machine, noise=noise, synchronous=synchronous, speeding=speeding)
    return compose(parts, machine.sampling_time if T is None else T, name="machine")
