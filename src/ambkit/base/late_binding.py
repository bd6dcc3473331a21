"""Functions of upper rooms behind methods of lower ones, as the package's root binds them."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

TYPE_CHECKING = False  # without importing typing before a command starts

_places: dict[str, str] = {}


def bind(functions: Mapping[str, Mapping[str, str]]) -> None:
    """Take the functions of each module, and the name or the class by which each is called."""
    for module, names in functions.items():
        for function, name in names.items():
            _places[name] = f"{module}:{function}"


def call(name: str, *args: Any, **options: Any) -> Any:
    """Call the function by its name; its module is imported now."""
    module, _, function = _places[name].partition(":")
    return getattr(import_module(f"ambkit.{module}"), function)(*args, **options)
