"""Names of the signals in a record, and the SI unit of each."""

import re
from collections.abc import Sequence
from functools import cache
from typing import Any

MEASURED = {"y": "m", "u": "V", "r": "m", "injected": "m"}
"""In a rig's log: position, control signal, reference, excitation added to the measurement."""

TRUTH = {"x": "m", "v": "m/s", "f_d": "N", "x_m": "m", "iu": "A", "f_mag": "N"}
"""In a simulation: displacement, velocity, disturbance force, lagged position, currents, forces."""

ON = "on"  #: 1 while the magnets have current from this sample to the next, 0 while they have none.
CONTROL = "control"  #: Input of a measured current, in any unit.
UNITS = {"t": "s"} | MEASURED | TRUTH  #: SI unit of each standard signal.

SI_UNITS = (
    *dict.fromkeys(UNITS.values()),
    *("1", "m/s^2", "rad", "rad/s", "Hz", "kg", "kg m", "K", "Pa", "J", "W"),
    *("m^2", "m^2/s^2", "V^2", "A^2", "N^2", "N/A", "N/m", "N m", "N s/m", "N m^2/A^2"),
    *("A/V", "V/A", "V/m", "A/s", "V/s", "N/s", "ohm", "H", "T", "Wb", "C"),
)
"""SI units in records; other units of the same kind are converted."""


def signal(what: str, name: str) -> str:
    """Name of a signal of an axis or a reading, ``y_A1``; a single one has no suffix."""
    return f"{what}_{name}" if name else what


def displacement(axis: str) -> str:
    """Return the name of an axis's true displacement: ``s_A1``; of a single one ``x``."""
    return signal("s", axis) if axis else "x"


def held_in(name: str, unit: str) -> str:
    """Return the SI unit in which records hold a signal with a unit."""
    si = UNITS.get(name) or si_unit(unit)
    return "A" if name == "u" and si_unit(unit) == "A" else si


OF_TRUTH = re.compile(f"({'|'.join((*TRUTH, 's', 'q'))})(_.+)?")
"""Signals known in simulation only."""


def by_name(names: Sequence[str], values: Sequence[Any]) -> Any:
    """Return values by name; of a single one without a name the value itself."""
    return dict(zip(names, values, strict=True)) if any(names) else values[0]


def values_of(values: Any) -> list[Any]:
    """Return the values of a result of `by_name`."""
    return list(values.values()) if isinstance(values, dict) else [values]


@cache
def si_unit(unit: str) -> str:
    """Return the SI unit of the same dimension as `unit`."""
    from ambkit.base.units import factor

    if unit in ("", "-"):
        return "1"
    if unit in SI_UNITS:
        return unit
    factor(unit, unit)  # raises for an unknown unit, with the right message
    for candidate in SI_UNITS:
        try:
            factor(unit, candidate)
        except ValueError:
            continue
        return candidate
    raise ValueError(f"{unit} measures nothing that a record holds; known: {', '.join(SI_UNITS)}")


def to_si(name: str, unit: str, values: Any) -> tuple[Any, str]:
    """Convert a signal to the SI unit of records; SI values keep their bits."""
    from ambkit.base.units import factor

    target = held_in(name, unit)
    scale = 1.0 if unit == target else factor(unit, target)
    return (values if scale == 1.0 else values * scale), target
