"""A variable of a model, and variables of each axis or reading."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from ambkit.data.signals import signal
from ambkit.estimate.machine_model import several

Role = Literal["time", "fixed", "tunable", "input", "output", "local"]
Limit = Literal["any", "not negative", "positive", "losable"]


@dataclass(frozen=True)
class Variable:
    """A variable of a model; its value reference is its place in the table."""

    name: str  #: As the importer shows it.
    #: Fixed parameters hold from the start, tunable ones can be changed between steps; local is
    #: what only importers that integrate ask for.
    role: Role
    unit: str  #: As in `UNITS`; empty for integers.
    about: str  #: In a few words.
    start: float = 0.0  #: Start value; of an output, nothing.
    #: Of a value that is set; what is losable may be NaN, as of a lost sensor.
    limit: Limit = "any"
    #: Inputs and parameters that an output follows at once, not with the next step.
    follows: tuple[str, ...] = ()
    held: bool = False  #: Changes only with a sample.
    rate_of: str = ""  #: State whose derivative it is.
    event: bool = False  #: Whether an event begins where its sign changes.
    #: In C, of those that stand together and of which this is the first; empty for others.
    first: str = ""

    @property
    def integer(self) -> bool:
        """Whether it is a whole number: those have no unit."""
        return not self.unit

    @property
    def reference(self) -> str:
        """Name of its value reference in C."""
        return "VR_" + re.sub(r"\W", "_", self.name)


UNITS = (
    "1", "s", "m", "m2", "m/s", "m/s2", "rad", "rad/s", "kg.m", "N/s", "kg", "A", "A/s", "A/m",
    "A/(m.s)", "A.s/m", "V", "A2", "V2", "N", "N/A", "N/m", "N2/s", "N.m2/A2",
)  # fmt: skip
"""Units of variables, in the order of the file."""

_DERIVED = {"N": {"kg": 1, "m": 1, "s": -2}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1}}


def exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units in a unit."""
    total: dict[str, int] = {}
    for sign, product in zip((1, -1), unit.split("/"), strict=False):
        for name, power in re.findall(r"([A-Za-z]+)(\d?)", product):
            for base, exponent in _DERIVED.get(name, {name: 1}).items():
                total[base] = total.get(base, 0) + sign * exponent * int(power or 1)
    order = ("kg", "m", "s", "A") if total.get("kg") else ("rad", "A", "m", "s")
    return {base: total[base] for base in order if total.get(base)}


TIME = Variable("time", "time", "s", "time")


def in_unit(variables: Sequence[Variable], control: str) -> tuple[Variable, ...]:
    """Return variables with control signals in their unit."""
    units = {"V": control, "V2": f"{control}2"}
    return tuple(
        replace(variable, unit=units.get(variable.unit, variable.unit)) for variable in variables
    )


def per_name(
    what: str, role: Role, unit: str, about: str, names: Sequence[str],
    starts: Iterable[float] | float = 0.0, **more: Any,
) -> list[Variable]:  # fmt: skip
    """Return a variable for each name of an axis or a reading."""
    start_values = several(starts) * (1 if isinstance(starts, tuple | list) else len(names))
    block = what.rsplit(".", 1)[-1]
    return [
        Variable(signal(what, name), role, unit, about + (f", {name}" if name else ""),
                 float(start), first="" if k else block, **more)
        for k, (name, start) in enumerate(zip(names, start_values, strict=True))
    ]  # fmt: skip
