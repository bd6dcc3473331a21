"""Functions of upper rooms as methods of lower ones, bound by the package's root."""

from __future__ import annotations

from importlib import import_module
from typing import Any

TYPE_CHECKING = False  # without importing typing before a command starts
PLACES: dict[str, str] = {}  #: Module and function by name.


def call(name: str, *args: Any, **options: Any) -> Any:
    """Call a function by name, importing its module now."""
    module, _, function = PLACES[name].partition(":")
    return getattr(import_module(f"ambkit.{module}"), function)(*args, **options)
