"""Pydantic types for values with units: strings in files, SI floats inside."""

from __future__ import annotations

import json
import math
import numbers
import os
import re
from collections.abc import Callable
from contextlib import suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    SerializationInfo,
    ValidationInfo,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ambkit.base import units
from ambkit.base.escaping import one_line

place_of_signal: ContextVar[SignalIn | None] = ContextVar("place of a signal", default=None)
"""Place of the signal that is being read or written."""


class ParsedValue(float):
    """A value of a signal with its unit, before its place of use is known."""

    text: str  #: Original text.
    unit: str  #: As in `Quantity`, with ``@`` for the unit of the place.

    @classmethod
    def of(cls, text: str, unit: str) -> ParsedValue:
        """Parse a text like ``"50 µm"``."""
        quantity = cls(units.parse(text, units.base_unit(text)))
        quantity.text, quantity.unit = text, unit
        return quantity


class InOther(float):
    """A value in a unit other than that of its `Quantity`, written in that unit."""

    unit: str  #: The other unit.

    @classmethod
    def like(cls, old: Any, value: Any) -> Any:
        """Return a number in the unit of the one it replaces."""
        if not isinstance(old, InOther) or not isinstance(value, numbers.Real):
            return value
        return cls.of(float(value), old.unit)

    @classmethod
    def of(cls, value: float, unit: str) -> Self:
        """Return a number in a unit."""
        made = cls(value)
        made.unit = unit
        return made


@dataclass(frozen=True)
class Quantity:
    """Marks a float that stands in files as a string with a unit."""

    # Used as ``Annotated[float, Quantity("m", "2 mm")]``. In a file a bare number is rejected,
    # except for unit ``"1"``; in Python a number is in SI and a string is parsed as in a file.

    unit: str  #: SI unit; ``@`` for that of the signal at its place of use (`SignalIn`).
    example: str = ""  #: A sensible value; a signal's place of use has its own.
    above: float | None = None  #: Limits, in `unit`.
    at_least: float | None = None
    at_most: float | None = None
    also: tuple[str, ...] = ()  #: Other units in files; their values are in `unit`.

    def read(self, value: Any, info: ValidationInfo) -> float:
        """Return the value in SI, or an error message."""
        try:
            number = self._number(value, in_file=info.context is not None)
        except ValueError as error:
            raise self._wrong(f"{error}, write it like {self.shown_example()}") from None
        wrong = ""
        if not math.isfinite(number):
            wrong = "finite"
        elif self.above is not None and not number > self.above:
            wrong = f"greater than {self._shown(self.above)}"
        elif self.at_least is not None and not number >= self.at_least:
            wrong = f"at least {self._shown(self.at_least)}"
        elif self.at_most is not None and not number <= self.at_most:
            wrong = f"at most {self._shown(self.at_most)}"
        if wrong:
            value_text = value if isinstance(value, str) else self._shown(number)
            raise self._wrong(f"must be {wrong}, is {value_text}")
        return number

    def _number(self, value: Any, in_file: bool) -> float:
        unit = self._unit()
        if isinstance(value, InOther) and value.unit in self.also:
            return value
        if isinstance(value, str):
            for other in self.also:
                with suppress(ValueError):
                    return InOther.of(units.parse(value, other), self.also[0])
            return ParsedValue.of(value, self.unit) if unit is None else units.parse(value, unit)
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise ValueError(f"{json.dumps(value, default=repr)} is not a number")
        if in_file and unit != "1":
            raise ValueError(f"{value!s:.60} has no unit")
        try:
            return float(value)
        except OverflowError:
            raise ValueError(f"{value!s:.60}... is too large a number") from None

    def _unit(self) -> str | None:
        if "@" not in self.unit:
            return self.unit
        place = place_of_signal.get()
        return self.unit.replace("@", place.unit) if place else None

    def _shown(self, number: float) -> str:
        unit = self._unit()
        return units.engineering(number, unit) if unit else f"{number:g}"

    def shown_example(self) -> str:
        """Return the example as in a file."""
        place = place_of_signal.get()
        if "@" in self.unit:
            return f'"{self.unit.replace("@", place.example)}"' if place else "0.001"
        return self.example if self.unit == "1" else f'"{self.example}"'

    def _wrong(self, text: str) -> PydanticCustomError:
        return PydanticCustomError("problem", "{text}", {"text": text})

    def write(self, value: float) -> float | str:
        """Return the string for a file, which is read as exactly `value`."""
        unit = value.unit if isinstance(value, InOther) else self._unit()
        return value if unit in (None, "1") else units.engineering(value, str(unit), digits=None)

    def _serialize(self, value: float, info: core_schema.SerializationInfo) -> float | str:
        plain = info.context is None and not isinstance(value, InOther)
        return value if plain else self.write(value)

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(
            self.read,
            serialization=core_schema.plain_serializer_function_ser_schema(
                self._serialize, info_arg=True
            ),
        )

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        if self.unit == "1":
            if self.example.endswith("%"):
                return {"type": ["number", "string"], "examples": [self.example]}
            return {"type": "number", "examples": [float(self.example)]}
        if "@" in self.unit:
            examples = [self.unit.replace("@", example) for example in ("0.5 mm", "3 N")]
        else:
            examples = [self.example]
        return {"type": "string", "examples": examples}


@dataclass(frozen=True)
class KeywordOrQuantity(Quantity):
    """Marks a value that is one of some words, or a quantity."""

    # Used as ``Annotated[float | Literal["none"], WordOrQuantity("rad", "45 deg", words=...)]``.

    words: tuple[str, ...] = ()  #: The words.

    def read(self, value: Any, info: ValidationInfo) -> Any:
        """Return the word, or the value in SI; or an error message."""
        if isinstance(value, str) and value in self.words:
            return value
        if isinstance(value, str) and not any(map(str.isdigit, value)):
            known = ", ".join(f'"{word}"' for word in self.words)
            value_text = json.dumps(value, ensure_ascii=False)
            raise self._wrong(f"must be {known} or like {self.shown_example()}, is {value_text}")
        return super().read(value, info)

    def write(self, value: Any) -> Any:
        """Return the word, or the string for a file, which is read as exactly `value`."""
        return value if isinstance(value, str) else super().write(value)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        quantity = super().__get_pydantic_json_schema__(schema, handler)
        return {"anyOf": [{"enum": list(self.words), "type": "string"}, quantity]}


@dataclass(frozen=True)
class ScalarOrList(Quantity):
    """Marks one quantity for all, or a list with one for each."""

    # Used as ``Annotated[float | tuple[float, ...], OneOrEach("m^2", "225 µm^2")]``.

    def read(self, value: Any, info: ValidationInfo) -> Any:
        """Return the value in SI, or a tuple of them; or an error message."""
        if not isinstance(value, list | tuple):
            return super().read(value, info)
        if not value:
            raise self._wrong(f"must not be empty, write it like {self.shown_example()}")
        return tuple(super(ScalarOrList, self).read(item, info) for item in value)

    def write(self, value: Any) -> Any:
        """Return the content for a file, which is read as exactly `value`."""
        if isinstance(value, tuple):
            return [super(ScalarOrList, self).write(item) for item in value]
        return super().write(value)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        one = super().__get_pydantic_json_schema__(schema, handler)
        return {"anyOf": [one, {"type": "array", "items": one, "minItems": 1}]}


@dataclass(frozen=True)
class SignalIn:
    """Marks a signal and its unit: ``Annotated[Signal, SignalIn("N", "3 N")]``."""

    unit: str  #: SI unit of the signal's values.
    example: str  #: Example of such a value.

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner = handler(source)
        return core_schema.no_info_wrap_validator_function(
            self._inside,
            inner,
            serialization=core_schema.wrap_serializer_function_ser_schema(
                self._inside, schema=inner
            ),
        )

    def _inside(self, value: Any, inner: Callable[[Any], Any]) -> Any:
        token = place_of_signal.set(self)
        try:
            result = inner(value)
            self._check(result)
            return result
        finally:
            place_of_signal.reset(token)

    def _check(self, signal: Any) -> None:
        """Reject a value in the unit of something else, once its place is known."""
        match signal:
            case ParsedValue(text=text, unit=unit):
                try:
                    units.parse(text, unit.replace("@", self.unit))
                except ValueError as error:
                    raise PydanticCustomError("problem", "{text}", {"text": str(error)}) from None
            case tuple():
                for item in signal:
                    self._check(item)
            case BaseModel():
                for item in vars(signal).values():
                    self._check(item)


def from_folder(value: Any, info: ValidationInfo) -> Any:
    """Resolve a relative name from the folder of the description."""
    folder = (info.context or {}).get("folder")
    if folder is not None and isinstance(value, str):
        return str(Path(folder, value).absolute())
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def to_folder(value: str, info: SerializationInfo) -> str:
    """Return the name relative to the description's destination, so that both can be moved."""
    folder = (info.context or {}).get("folder")
    if folder is None:
        return value
    try:
        return Path(os.path.relpath(value, folder)).as_posix()
    except ValueError:  # on Windows, another drive
        return str(Path(value).absolute())


FilePath = Annotated[str, BeforeValidator(from_folder), PlainSerializer(to_folder)]
"""Name of a file."""


#: Maximum length of a name: it appears in headings, legends and comments of one line.
LONGEST_NAME = 80
LONGEST_LINE = 1000
LONGEST_DESCRIPTION = 10_000

_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff]")  # all but tab and line feed


def _refusing(wrong: Callable[[str], object], limit: str) -> AfterValidator:
    def checked(text: str) -> str:
        if wrong(text):
            excerpt = one_line(text)
            excerpt = excerpt if len(excerpt) <= 60 else f"{excerpt[:57]}..."
            problem = f'must be {limit}, is "{excerpt}"'
            raise PydanticCustomError("problem", "{text}", {"text": problem})
        return text

    return AfterValidator(checked)


_printable = _refusing(lambda text: one_line(text) != text, "one line of printable characters")
_readable = _refusing(_CONTROL.search, "text without control characters")
Line = Annotated[str, Field(max_length=LONGEST_LINE), _printable]
"""A text of one line, such as the name of an array in a file."""
Name = Annotated[str, Field(max_length=LONGEST_NAME), _printable]  #: A name.
Description = Annotated[str, Field(max_length=LONGEST_DESCRIPTION), _readable]
"""A text with several lines; it is escaped when it is printed."""
