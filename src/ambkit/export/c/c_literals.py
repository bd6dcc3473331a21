"""What the C core holds, written as C: numbers, arrays and structs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import InCore, in_core_of

CPrecision = Literal["float", "double"]

_UNSIGNED = (
    "frozen_limit", "outlier_limit", "window", "waiting", "lost", "overloaded", "settling",
)  # fmt: skip
"""The fields of the structs that are."""


class Kind(NamedTuple):
    """How a magnet of the core is called in C."""

    type: str
    methods: str
    source: str
    about: str


class Name(str):
    """A value that is C already."""


def number(value: float, precision: CPrecision) -> str:
    """Write a floating-point number such that it is read back to the last bit."""
    text = f"{np.float32(value):.9g}" if precision == "float" else f"{value:.17g}"
    if not any(mark in text for mark in ".en"):
        text += ".0"
    return text + ("F" if precision == "float" else "")


def array(values: NDArray[Any], precision: CPrecision, indent: str = "  ") -> str:
    """Write an array as an initialiser, rows as structs, lines of at most 100 columns."""

    def literal(value: Any) -> str:
        if values.dtype.kind == "i":
            return str(value)
        return f"{value}U" if values.dtype.kind == "u" else number(value, precision)

    items = map(literal, values) if values.ndim == 1 else (
        "{" + ", ".join(map(literal, row)) + "}" for row in values
    )  # fmt: skip
    lines, line = [], indent
    for item in items:
        if len(line) + len(item) + 1 > 100 and line != indent:
            lines.append(line.rstrip())
            line = indent
        line += f"{item}, "
    return "\n".join([*lines, line.rstrip(", ")])


def rows(values: NDArray[Any], precision: CPrecision) -> str:
    """Write a matrix as an initialiser of an array of arrays."""
    return ", ".join("{" + array(row, precision, "") + "}" for row in values)


def type_of(values: NDArray[Any]) -> str:
    """Return the C type of an array's elements, by its columns."""
    if values.dtype.kind == "u":
        return {1: "unsigned char", 2: "unsigned short"}[values.dtype.itemsize]
    if values.dtype.kind == "i":
        return "int"
    columns = values.shape[1] if values.ndim == 2 else 1
    return {1: "amb_real", 2: "amb_stiffness", 4: "amb_force_node"}[columns]


def struct(
    fields: Mapping[str, Any], precision: CPrecision, arrays: Mapping[str, str], path: str = ""
) -> str:
    """Write a struct as an initialiser with the names of its fields."""
    level = path.count(".")
    lines = []
    for name, value in fields.items():
        place = f"{path}{name}"
        if isinstance(value, Name):
            text = str(value)
        elif isinstance(value, Mapping):
            text = struct(value, precision, arrays, f"{place}.")
        elif isinstance(value, bool):
            text = "true" if value else "false"
        elif isinstance(value, int):
            text = f"{value}U" if name in _UNSIGNED else str(value)
        elif isinstance(value, np.ndarray):
            text = arrays[place]
        else:
            text = number(value, precision)
        lines.append(f"{'  ' * (level + 1)}.{name} = {text},\n")
    return "{\n" + "".join(lines) + "  " * level + "}"


def called(filter: Estimator) -> InCore:
    """Return how the core calls an estimator."""
    result = in_core_of(filter)
    if result is None:
        raise AmbkitError(f"the {filter.name} cannot be exported yet")
    return result


def own(filter: Estimator, precision: CPrecision) -> str:
    """Write what only this kind of estimator has, its arrays in it; empty where it has nothing."""
    fields = filter.core.own
    inner: Estimator | None = getattr(filter, "inner", None)
    if inner is not None:
        if inner.core.own:
            raise AmbkitError(f"{filter.name}: around this filter it cannot be exported")
        fields = {"inner": Name(f"{{&{called(inner).methods}, NULL, NULL, NULL}}")} | fields
    return struct_with_arrays(fields, precision) if fields else ""


def struct_with_arrays(fields: Mapping[str, Any], precision: CPrecision) -> str:
    """Write a struct as an initialiser, its arrays in it."""
    held = arrays_of(fields).items()
    texts = {path: "{\n" + array(values, precision, "    ") + "}" for path, values in held}
    return struct(fields, precision, texts)


def declared(arrays: Mapping[str, NDArray[Any]], precision: CPrecision) -> list[dict[str, Any]]:
    """Return what a data file says of arrays: name, type, length and text of each."""
    return [
        {"name": name, "type": type_of(values), "length": len(values),
         "text": array(values, precision)}
        for name, values in arrays.items()
    ]  # fmt: skip


def arrays_of(fields: Mapping[str, Any], path: str = "") -> dict[str, NDArray[Any]]:
    """Return all arrays in a struct and in the structs in it, by the paths of their fields."""
    results: dict[str, NDArray[Any]] = {}
    for name, value in fields.items():
        if isinstance(value, Mapping):
            results |= arrays_of(value, f"{path}{name}.")
        elif isinstance(value, np.ndarray):
            results[f"{path}{name}"] = value
    return results
