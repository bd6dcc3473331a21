"""Formulas of numbers by parameters: Python's operations, recorded and repeated in C."""

from __future__ import annotations

from typing import Any, Self

from ambkit.models.declaration import Unit

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
