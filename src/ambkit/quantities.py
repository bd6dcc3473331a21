"""Pydantic types for values with units: strings at the surface, SI floats inside."""

import json
import math
import numbers
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, ValidationInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ambkit import units

_signal_unit: ContextVar[str | None] = ContextVar("signal unit", default=None)


@dataclass(frozen=True)
class Quantity:
    """Marks a float that stands in files as a string with a unit.

    Used as ``Annotated[float, Quantity("m", "2 mm")]``. In a file a bare number is refused, save
    for unit ``"1"``; in Python a number counts as SI and a string is read like one in a file.

    Attributes
    ----------
    unit : str
        SI unit. ``@`` stands for the unit of the signal, which the place of use knows (`SignalIn`).
    example : str
        How a user would write a sensible value.
    above, at_least : float or None
        Limits, in `unit`.
    """

    unit: str
    example: str
    above: float | None = None
    at_least: float | None = None

    def read(self, value: Any, info: ValidationInfo) -> float:
        """Give the value in SI, or say what is wrong with it."""
        try:
            number = self._number(value, in_file=info.context is not None)
        except ValueError as error:
            raise self._wrong(f"{error}, write it like {self.shown_example()}") from None
        shown = value if isinstance(value, str) else self._shown(number)
        if not math.isfinite(number):
            raise self._wrong(f"must be finite, is {shown}")
        if self.above is not None and not number > self.above:
            raise self._wrong(f"must be greater than {self._shown(self.above)}, is {shown}")
        if self.at_least is not None and not number >= self.at_least:
            raise self._wrong(f"must be at least {self._shown(self.at_least)}, is {shown}")
        return number

    def _number(self, value: Any, in_file: bool) -> float:
        unit = self._unit()
        if isinstance(value, str):
            if unit is None:
                raise ValueError(f'"{value}": outside a scenario a signal has no unit, give SI')
            return units.parse(value, unit)
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ValueError(f"{json.dumps(value, default=repr)} is not a number")
        if in_file and unit != "1":
            raise ValueError(f"{value} has no unit")
        return float(value)

    def _unit(self) -> str | None:
        place = _signal_unit.get()
        if "@" in self.unit:
            return None if place is None else self.unit.replace("@", place)
        return self.unit

    def _shown(self, number: float) -> str:
        return units.engineering(number, self._unit() or "SI")

    def shown_example(self) -> str:
        """Give the example as it stands in a file; for a signal, in the unit of its place."""
        unit = self._unit()
        if unit == "1":
            return self.example
        if "@" in self.unit:
            return f'"{self.example} {unit}"' if unit else self.example
        return f'"{self.example}"'

    def _wrong(self, text: str) -> PydanticCustomError:
        return PydanticCustomError("problem", "{text}", {"text": text})

    def write(self, value: float, info: core_schema.SerializationInfo) -> float | str:
        """Give the string for a file, which reads back as exactly `value`."""
        unit = self._unit()
        if info.context is None or unit in (None, "1"):
            return value
        return units.engineering(value, unit, digits=None)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(
            self.read,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self.write, info_arg=True
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        if self.unit == "1":
            return {"type": "number", "examples": [float(self.example)]}
        unit = self.unit.replace("@", "unit of the signal")
        return {"type": "string", "unit": unit, "examples": [self.example]}


@dataclass(frozen=True)
class SignalIn:
    """Marks where a signal is used, and so in which unit: ``Annotated[Signal, SignalIn("N")]``."""

    unit: str

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            self._inside,
            handler(source),
            serialization=core_schema.wrap_serializer_function_ser_schema(
                self._inside, schema=handler(source)
            ),
        )

    def _inside(self, value: Any, inner: Any) -> Any:
        token = _signal_unit.set(self.unit)
        try:
            return inner(value)
        finally:
            _signal_unit.reset(token)
