"""A class in a user's Python file, named as ``file.py:Class``, and its step."""

import importlib.util
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import (
    PlainSerializer,
    PlainValidator,
    SerializationInfo,
    ValidationInfo,
    WithJsonSchema,
)

from ambkit.base.config.quantities import from_folder, to_folder
from ambkit.base.errors import AmbkitError

MARK = ".py:"  #: Part of such a name.


def _checked(value: Any, info: ValidationInfo) -> Any:
    if is_class(value):
        return from_folder(value, info)
    raise ValueError('must be "file.py:Class", or in Python a class')


def _written(make: Any, info: SerializationInfo) -> str:
    return to_folder(make, info) if isinstance(make, str) else name_of(make)


OwnClass = Annotated[
    Any, PlainValidator(_checked), WithJsonSchema({"type": "string"}),
    PlainSerializer(_written, when_used="json-unless-none"),
]  # fmt: skip
"""A class of the user in a document, or ``file.py:Class``, whose file is executed."""


def is_class(value: Any) -> bool:
    """Return whether it is a class, or the name of one in a file."""
    return isinstance(value, type) or (isinstance(value, str) and MARK in value)


def name_of(make: Any) -> str:
    """Return the name of a class."""
    return make if isinstance(make, str) else str(getattr(make, "__name__", "own"))


def load_class(text: str) -> tuple[str, Callable[..., Any]]:
    """Return name and class, or function, from a user's Python file."""
    path, _, name = text.rpartition(":")
    if not Path(path).is_file():
        raise AmbkitError(f"{path}: there is no such file")
    module_name = f"ambkit_own_{Path(path).stem}"
    spec = importlib.util.spec_from_file_location(module_name, path)
    assert spec is not None  # it ends with .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module  # for dataclasses
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise AmbkitError(f"{path}: {type(error).__name__}: {error}") from error
    make = getattr(module, name, None)
    if not callable(make):
        own = [key for key, value in vars(module).items()
               if getattr(value, "__module__", "") == module_name]  # fmt: skip
        hint = f"; it has {', '.join(own)}" if own else ""
        raise AmbkitError(f"{path}: there is no class or function {name}{hint}")
    return name, make


def made(name: str, make: Callable[..., Any], machine: Any) -> Any:
    """Return an object of a class, constructed with the machine or without arguments."""
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


class OwnStep:
    """An object with ``step``, called by C."""

    name: str
    wrapped: Any
    _call: str
    _returns: str
    _single: bool
    _sample: int = 0
    _failed: BaseException | None = None

    def plain(self, values: list[float]) -> Any:
        """Return an array, or its number for a single axis."""
        return values[0] if self._single else np.array(values)

    def numbers(self, count: int, *arguments: Any) -> list[float]:
        """Call ``step``; NaN once it failed: no exception may reach C."""
        if self._failed is None:
            try:
                result = np.ravel(np.asarray(self.wrapped.step(*arguments), float))
                if result.shape != (count,):
                    raise ValueError(f"it returned {result.size} numbers")
                self._sample += 1
                return result.tolist()
            except BaseException as error:  # including Ctrl-C
                self._failed = error
        return [np.nan] * count

    def check(self) -> None:
        """Raise the exception of ``step``."""
        error, self._failed = self._failed, None
        if error is None:
            return
        if not isinstance(error, Exception):
            raise error
        raise AmbkitError(
            f"{self.name}: {self._call} at sample {self._sample}: {type(error).__name__}: "
            f"{error}; it must return {self._returns}"
        ) from error


class OwnPart(OwnStep):
    """An object with ``step``, made anew for each run."""

    def __init__(self, make: Any, machine: Any, call: str, returns: str) -> None:
        self.name = name_of(make)
        loaded = load_class(make)[1] if isinstance(make, str) else make
        self.wrapped = made(self.name, loaded, machine)
        self._call, self._returns, self._single = call, returns, machine.single
