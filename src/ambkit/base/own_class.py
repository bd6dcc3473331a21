"""A class in a user's Python file, named as ``file.py:Class``."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ambkit.base.errors import AmbkitError

MARK = ".py:"
"""What such a name has."""


def load_class(text: str) -> tuple[str, Callable[..., Any]]:
    """Return name and class of what a user has in a Python file."""
    path, _, name = text.rpartition(":")
    if not Path(path).is_file():
        raise AmbkitError(f"{path}: there is no such file")
    module_name = f"ambkit_own_{Path(path).stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None  # it ends with .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # dataclasses look it up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise AmbkitError(f"{path}: {type(error).__name__}: {error}") from error
    make = getattr(module, name, None)
    if not callable(make):
        there = [key for key, value in vars(module).items() if isinstance(value, type)]
        hint = f"; it has {', '.join(there)}" if there else ""
        raise AmbkitError(f"{path}: there is no class {name}{hint}")
    return name, make


def made(name: str, make: Callable[..., Any], machine: Any) -> Any:
    """Return an object of a class, made with the machine or without arguments."""
    try:
        takes = len(inspect.signature(make).parameters)
    except (TypeError, ValueError):
        takes = 1
    try:
        result = make(machine) if takes else make()
    except Exception as error:
        argument_text = "with the machine" if takes else "without arguments"
        raise AmbkitError(
            f"{name}: it is made {argument_text}, and fails: {type(error).__name__}: {error}"
        ) from error
    if not callable(getattr(result, "step", None)):
        raise AmbkitError(f"{name}: it needs a method step")
    return result
