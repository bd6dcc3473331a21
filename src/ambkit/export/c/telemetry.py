"""Frames of what each sample found: ``core/include/ambkit/telemetry.h``, and what is in them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import NamedTuple

from ambkit.export.c.model import State
from ambkit.models.model import Descriptor

SOURCES = ("src/telemetry.c",)
TEMPLATES = {"{}_telemetry.h": "telemetry.h", "{}_telemetry.c": "telemetry.c"}


class Number(NamedTuple):
    """One number of a frame."""

    name: str
    unit: str
    place: str  # in the struct that comes out of a step


def frame(
    described: Sequence[Descriptor],
    fields: Sequence[State],
    readings: Sequence[str],
    coils: int | None,
    control_unit: str,
) -> list[Number]:
    """Return the numbers of a frame."""
    found = [
        Number(state.name, state.unit, field.field)
        for state, field in zip(described, fields, strict=True)
    ]
    for what, unit in (("innovation", "m"), ("variance", "m^2")):
        if readings:
            found += [Number(f"{what}_{of}", unit, f"{what}[{r}]") for r, of in enumerate(readings)]
        else:
            found.append(Number(what, unit, what))
    if coils is not None:
        found += [Number(f"coil_{k}", "A", f"coil[{k}]") for k in range(coils)]
        found += [Number("iu", "A", "iu"), Number("u", control_unit, "u")]
    return found


def described(
    name: str, configuration: str, sampling_time: float, numbers: Sequence[Number]
) -> str:
    """Return what frames are read by, as JSON."""
    told = {
        "prefix": name,
        "layout": int(configuration[:8], 16),
        "sampling_time": sampling_time,
        "numbers": [{"name": each.name, "unit": each.unit} for each in numbers],
    }
    return json.dumps(told, indent=2) + "\n"
