"""A machine's model as a function of its parameters: ``core/include/ambkit/rebuild.h``."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple, Self

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.signals import signal
from ambkit.estimate.core_model import numbers
from ambkit.machine.accessories import SHORTEST_LAG
from ambkit.machine.machine import Machine
from ambkit.models.declaration import Plan, Row, Unit
from ambkit.models.machine_parts import machine_parts
from ambkit.models.model import NUMBER, ONE, Pattern
from ambkit.models.sampling import Kinds, Sampling

Slot = tuple[str, int]  #: Destination of a number in C: array and index.
OPERATIONS = ("+", "-", "*", "/")  #: In the order of ``amb_operation`` (``ambkit/rebuild.h``).


class Formulas:
    """Parameters, constants, and operations in order."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.limits: list[tuple[float, float]] = []
        self.constants: dict[float, int] = {}
        self.operations: dict[tuple[int, Slot, Slot], int] = {}

    def parameter(self, name: str, value: float, low: float, high: float) -> Recorded:
        """Return a number that records its operations."""
        self.names.append(name)
        self.limits.append((low, high))
        return Recorded(value, self, ("parameter", len(self.names) - 1))

    def slot(self, value: float) -> Slot:
        """Return a destination in C."""
        if isinstance(value, Recorded):
            return value.slot
        constant = self.constants.setdefault(float(value), len(self.constants))
        return "constant", constant

    def result(self, operation: str, left: float, right: float) -> Recorded:
        """Record an operation."""
        of = OPERATIONS.index(operation), self.slot(left), self.slot(right)
        place = self.operations.setdefault(of, len(self.operations))
        a, b = float(left), float(right)
        value = {"+": a + b, "-": a - b, "*": a * b, "/": a / b if b else 0.0}[operation]
        return Recorded(value, self, ("result", place))

    def place(self, slot: Slot) -> int:
        """Return the index of a slot, once all are known."""
        first = {"parameter": 0, "constant": len(self.names)}
        return first.get(slot[0], len(self.names) + len(self.constants)) + slot[1]

    def fields(self) -> dict[str, Any]:
        """Return the fields of ``amb_rebuild``."""
        of, left, right = zip(*self.operations, strict=True) if self.operations else ((), (), ())
        low, high = zip(*self.limits, strict=True)
        return {
            "low": list(low), "high": list(high), "constant": list(self.constants),
            "operation": list(of), "left": list(map(self.place, left)),
            "right": list(map(self.place, right)),
        }  # fmt: skip


class Recorded(Unit):  # with its own products with a unit
    """A number that records its operations."""

    formulas: Formulas
    slot: Slot

    def __new__(cls, value: float, formulas: Formulas, slot: Slot) -> Self:
        number: Self = float.__new__(cls, value)
        number.formulas, number.slot = formulas, slot
        return number

    def __reduce__(self) -> Any:
        raise TypeError("a recorded number belongs to its formulas")

    def __add__(self, other: float) -> Recorded:
        return self.formulas.result("+", self, other)

    def __radd__(self, other: float) -> Recorded:
        return self.formulas.result("+", other, self)

    def __sub__(self, other: float) -> Recorded:
        return self.formulas.result("-", self, other)

    def __rsub__(self, other: float) -> Recorded:
        return self.formulas.result("-", other, self)

    def __mul__(self, other: float) -> Recorded:
        return self.formulas.result("*", self, other)

    def __rmul__(self, other: float) -> Recorded:
        return self.formulas.result("*", other, self)

    def __truediv__(self, other: float) -> Recorded:
        return self.formulas.result("/", self, other)

    def __rtruediv__(self, other: float) -> Recorded:
        return self.formulas.result("/", other, self)

    def __neg__(self) -> Recorded:
        return self * -1.0

    def __pow__(self, power: int) -> Recorded:  # type: ignore[override]
        return self * self if power == 2 else NotImplemented


Change = Callable[[str, float, float, float], float]
"""Function from a parameter's name, value and limits to its new value."""

DECADE = 10.0  #: Range of the parameters, as a factor in both directions.


class Rebuild(NamedTuple):
    """A model as a function of its parameters."""

    names: tuple[str, ...]  #: Names of the parameters, ...
    values: Array  #: ... their values in the machine, in SI ...
    fields: dict[str, Any]  #: ... and the fields of ``amb_rebuild``.

    @classmethod
    def of(
        cls, machine: Machine, *, parts: Callable[..., Any] = machine_parts, noise: bool = True,
        synchronous: Sequence[str] = (), timed: bool = False,
    ) -> Rebuild:  # fmt: skip
        """Return that of an engine's model of a machine; `timed`: for any T."""
        formulas, values = Formulas(), list[float]()

        def recorded(name: str, value: float, low: float, high: float) -> float:
            values.append(value)
            return formulas.parameter(name, value, low, high)

        T = machine.sampling_time
        plan = Plan(recorded("T", T, 0.0, math.inf) if timed else T)
        changed = with_parameters(machine, recorded)
        for part in parts(changed, noise=noise, synchronous=synchronous):
            plan.add(part)
        fields = _fields(Sampling(plan), formulas)
        return cls(tuple(formulas.names), np.array(values), fields)

    def numbers(self, core: Any, values: Mapping[str, float]) -> Array:
        """Return the values of the model for other parameter values."""
        all_values = dict(zip(self.names, self.values.tolist(), strict=True)) | dict(values)
        return np.asarray(core.rebuild(self.fields, [all_values[name] for name in self.names]))


def with_parameters(machine: Machine, change: Change) -> Machine:
    """Return a machine with other values of parameters that can change on a rig, unchecked."""
    T, rotor = machine.sampling_time, machine.rotor
    update: dict[str, Any] = {}
    if rotor.type != "mass":
        half_a_turn = math.pi / T
        update["speed"] = change("speed", machine.speed, -half_a_turn, half_a_turn)

    def scaled(name: str, value: float) -> float:
        return change(name, value, *sorted((value / DECADE, value * DECADE)))

    inertias: dict[str, Any] = {
        key: scaled(key, getattr(rotor, key))
        for key in ("mass", "transverse_inertia", "polar_inertia")
        if key in type(rotor).model_fields
    }
    update["rotor"] = rotor.model_copy(update=inertias)
    sensors = []
    for sensor in machine.sensors:
        of: dict[str, Any] = {"gain": scaled(signal("gain", sensor.name), sensor.gain)}
        if sensor.lag > SHORTEST_LAG * T:
            low = max(sensor.lag / DECADE, SHORTEST_LAG * T)
            of["lag"] = change(signal("lag", sensor.name), sensor.lag, low, sensor.lag * DECADE)
        sensors.append(sensor.model_copy(update=of))
    bearings = []
    for bearing in machine.bearings:
        amplifier, name = bearing.amplifier, signal("bandwidth", bearing.name)
        if amplifier.bandwidth is not None:
            corner = scaled(name, amplifier.bandwidth)
            amplifier = amplifier.model_copy(update={"bandwidth": corner})
        bearings.append(bearing.model_copy(update={"amplifier": amplifier}))
    return machine.model_copy(
        update=update | {"sensors": tuple(sensors), "bearings": tuple(bearings)}
    )


def _fields(of: Sampling, formulas: Formulas) -> dict[str, Any]:
    """Return the fields of ``amb_rebuild``."""
    plan, layout, (n, p, c, size) = of.plan, of.layout, of.sizes
    value = [formulas.slot(term[2]) for term in of.terms]
    k_i = [formulas.slot(k) for k in of.k_i]
    intensity = [
        formulas.slot(row.get(state.name, 0.0)) for row, _ in plan.sources for state in plan.states
    ]
    zero, one = (formulas.slot(number) for number in (0.0, 1.0))
    forms: dict[str, Sequence[Row]] = {"c": plan.readings, "rest": of.rests()}
    slots = {
        name: [{state: formulas.slot(item) for state, item in row.items()} for row in rows]
        for name, rows in forms.items()
    }
    # From here on all slots are known: values of the model are their sources' indices.
    first = size * size + layout.N.size

    def place(slot: Slot) -> int:
        return first + formulas.place(slot)

    def placed(places: Any, kinds: Pattern) -> Kinds:
        fixed = np.where(kinds == ONE, place(one), place(zero))
        return np.where(kinds == NUMBER, places, fixed).astype(float), kinds

    Phi, _ = placed(np.arange(size * size).reshape(size, size), layout.Phi)
    N, _ = placed(size * size + np.arange(layout.N.size).reshape(layout.N.shape), layout.N)
    model = of.assembled(Phi, N)
    model["r"] = placed(0, model["r"][1])
    for name, rows in slots.items():
        places = [{state: place(slot) for state, slot in row.items()} for row in rows]
        model[name] = placed(of.linear_forms(places)[0], model[name][1])
    described: Any = SimpleNamespace(
        states=plan.states, forces=plan.forces, controls=plan.controls, noises=plan.noises,
        measurements=plan.measurements, pattern={key: kinds for key, (_, kinds) in model.items()},
        **{key: values for key, (values, _) in model.items()},
    )  # fmt: skip
    return formulas.fields() | {
        "T": plan.T, "states": n, "forces": p, "controls": c, "noises": len(plan.sources),
        "row": layout.row.tolist(), "column": layout.column.tolist(), "use": layout.use.tolist(),
        "value": list(map(formulas.place, value)), "k_i": list(map(formulas.place, k_i)),
        "intensity": list(map(formulas.place, intensity)),
        "late": of.late, "from": numbers(described).astype(int).tolist(),
    }  # fmt: skip
