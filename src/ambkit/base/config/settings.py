"""What a description sets, as text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from ambkit.base.config.problems import quantity_of
from ambkit.base.units import figure

NAMES = ("name", "description", "source")
"""Fields that say what a description is of, and set nothing."""


def settings_of(part: Any, text: Callable[..., str] = figure) -> Iterator[str]:
    """Yield the values of a part that are not the defaults."""
    for name, field in type(part).model_fields.items():
        value, quantity = getattr(part, name), quantity_of(field)
        words = name.replace("_", " ")
        if value is None or (value == field.default and not field.is_required()):
            continue
        if quantity and isinstance(value, float):
            yield f"{words} {text(value, quantity.unit, 4)}"
        elif isinstance(value, tuple) and value:
            yield f"{len(value)} {words}{'s' * (len(value) > 1 and words[-1] != 's')}"
        elif isinstance(value, str) and value and name not in NAMES:
            yield value if name == "type" else f"{words} {value}"
