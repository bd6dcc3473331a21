"""Telemetry frames: ``core/include/ambkit/telemetry.h``, and their content."""

import json
from collections.abc import Sequence
from typing import NamedTuple

from ambkit.data.signals import signal
from ambkit.export.c.exported import Export
from ambkit.export.c.model import State

TEMPLATES = {"{}_telemetry.h": "telemetry.h", "{}_telemetry.c": "telemetry.c"}


class Number(NamedTuple):
    """One number of a frame."""

    name: str
    unit: str
    place: str  # in the output struct of a step


def frame(export: Export, fields: Sequence[State]) -> list[Number]:
    """Return the numbers of a frame."""
    machine, inside = export.filter.machine, "estimates." if export.beside else ""
    results = [
        Number(state.name, state.unit, inside + field.field)
        for state, field in zip(export.filter.states, fields, strict=True)
    ]

    def at(what: str, k: int) -> str:
        return f"{what}[{k}]" if export.several else what

    results += [
        Number(signal(what, reading.name), unit, inside + at(what, r))
        for what, unit in (("innovation", "m"), ("variance", "m^2"))
        for r, reading in enumerate(machine.readings)
    ]
    for f, axis in enumerate(machine.axes if export.controller is not None else ()):
        coils = 2 if axis.bearing.magnet.type == "two-sided" else 1
        results += [
            Number(signal(f"coil_{k}", axis.name), "A", f"{at('coil', f)}[{k}]")
            for k in range(coils)
        ]
        results += [Number(signal("iu", axis.name), "A", at("iu", f)),
                  Number(signal("u", axis.name), machine.control_unit, at("u", f))]  # fmt: skip
    return results


def described(
    name: str, configuration: str, sampling_time: float, numbers: Sequence[Number]
) -> str:
    """Return the description of frames for their decoding, as JSON."""
    description = {
        "prefix": name,
        "layout": int(configuration[:8], 16),
        "sampling_time": sampling_time,
        "numbers": [{"name": number.name, "unit": number.unit} for number in numbers],
    }
    return json.dumps(description, indent=2) + "\n"
