"""Arguments of functions: quantities in SI or with units, and objects of a type."""

import numbers
import os
import re
from collections.abc import Iterable
from typing import Any, TypeVar, overload

from ambkit.base import units
from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import one_line

QuantityLike = float | str  #: A quantity as an argument: a number in SI, or text with a unit.

Kind = TypeVar("Kind")

_SHOWN = 40  # characters of the value in a message


@overload
def in_si(name: str, value: QuantityLike, unit: str) -> float: ...
@overload
def in_si(name: str, value: None, unit: str) -> None: ...
def in_si(name: str, value: Any, unit: str) -> float | None:
    """Return a quantity in SI."""
    if value is None:
        return None
    if isinstance(value, str):
        try:
            return units.parse(value, unit)
        except ValueError as error:
            raise AmbkitError(f"{name} must be in {unit}: {error}") from None
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        either = f"a number in {unit} or a text with its unit"
        raise AmbkitError(f"{name} must be {either}, is {_shown(value)}")
    return float(value)


def seeds_in(seeds: int | range | str) -> range:
    """Return seeds, given by their number from 0 on, as ``"FIRST:N"``, or as a range."""
    if isinstance(seeds, range) and seeds and seeds.start >= 0 and seeds.step == 1:
        return seeds
    match = re.fullmatch(r"(?:(\d{1,9}):)?(\d{1,9})", str(seeds).strip(), re.ASCII)
    if match is None or not int(match[2]):
        text = "a number N of them from 1 on, or FIRST:N with the first from 0 on"
        raise AmbkitError(f"seeds must be {text}, are {_shown(seeds)}")
    first = int(match[1] or 0)
    return range(first, first + int(match[2]))


def of_type(*expected_types: type, **arguments: Any) -> None:
    """Reject an object of another type."""
    for name, value in arguments.items():
        if isinstance(value, expected_types):
            continue
        first, hint = expected_types[0], ""
        ways = [f"{first.__name__}.{way}" for way in ("preset", "load") if hasattr(first, way)]
        if isinstance(value, str) and ways:
            hint = f"; {' or '.join(ways)} gives one"
        elif isinstance(value, type) and issubclass(value, expected_types):
            hint = f"; {value.__name__}(...) makes one"
        elif isinstance(getattr(value, "record", None), expected_types):
            hint = "; give its .record"
        kinds = " or ".join(kind.__name__ for kind in expected_types)
        raise TypeError(f"{name} must be of type {kinds}, is {_shown(value)}{hint}")


def all_of_type(expected_type: type[Kind], **argument: Any) -> list[Kind]:
    """Return one or several objects of a type as a list, and reject all others."""
    ((name, value),) = argument.items()
    several = list(value) if isinstance(value, list | tuple) else [value]
    for one in several:
        of_type(expected_type, **{name: one})
    return several


def names_in(*others: type, **argument: Any) -> list[Any]:
    """Return one or several names as a list, and reject all others."""
    ((name, value),) = argument.items()
    one = isinstance(value, (str, os.PathLike, *others)) or not isinstance(value, Iterable)
    several = [value] if one else list(value)
    for item in several:
        of_type(*others, str, os.PathLike, **{name: item})
    return several


def _shown(value: Any) -> str:
    if value is None or isinstance(value, type):
        return "None" if value is None else f"the type {value.__name__}"
    text = one_line(repr(value))
    short = f" {text}" if len(text) <= _SHOWN else ""
    return f"the {type(value).__name__}{short}"
