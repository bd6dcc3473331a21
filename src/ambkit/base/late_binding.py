"""Functions of upper rooms behind methods of lower ones, as the package's root binds them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

TYPE_CHECKING = False  # without importing typing before a command starts

PLACES: dict[str, str] = {}  #: Module and function by the name by which each is called.


def call(name: str, *args: Any, **options: Any) -> Any:
    """Call the function by its name; its module is imported now."""
    module, _, function = PLACES[name].partition(":")
    return getattr(import_module(f"ambkit.{module}"), function)(*args, **options)
