"""Data of the C core written as C: numbers, arrays and structs."""

import zlib
from collections.abc import Iterator, Mapping, Sequence
from struct import pack
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import CoreKernel, core_kernel

CPrecision = Literal["float", "double"]

_UNSIGNED = (
    "frozen_limit", "outlier_limit", "window", "waiting", "lost", "overloaded", "settling",
)  # fmt: skip
"""Fields that are nested structs."""


class Kind(NamedTuple):
    """A magnet of the core in C."""

    type: str
    methods: str
    source: str
    about: str


class Name(str):
    """A value in C syntax."""


def number(value: float, precision: CPrecision) -> str:
    """Format a floating-point number exactly."""
    (text,) = _numbers([value], precision)
    return text


def _numbers(values: Any, precision: CPrecision) -> list[str]:
    # Python's own floats are formatted in a third of NumPy's time.
    if precision == "float":
        texts = [f"{value:.9g}" for value in np.asarray(values, np.float32).tolist()]
    else:
        texts = [f"{value:.17g}" for value in np.asarray(values, float).tolist()]
    end = "F" if precision == "float" else ""
    return [text + end if "." in text or "e" in text or "n" in text else f"{text}.0{end}"
            for text in texts]  # fmt: skip


def array(values: NDArray[Any], precision: CPrecision, indent: str = "  ") -> str:
    """Format an array as an initialiser, rows as structs, lines of at most 100 columns."""
    if values.dtype.kind in "iu":
        literals = [f"{value}{'U' * (values.dtype.kind == 'u')}" for value in values.ravel()]
    else:
        literals = _numbers(values.ravel(), precision)
    items = literals
    if values.ndim > 1:
        n = values.shape[1]
        items = ["{" + ", ".join(literals[k : k + n]) + "}" for k in range(0, len(literals), n)]
    lines, line = [], indent
    for item in items:
        if len(line) + len(item) + 1 > 100 and line != indent:
            lines.append(line.rstrip())
            line = indent
        line += f"{item}, "
    return "\n".join([*lines, line.rstrip(", ")])


def rows(values: NDArray[Any], precision: CPrecision) -> str:
    """Format a matrix as an initialiser of an array of arrays."""
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
    fields: Mapping[str, Any], precision: CPrecision, arrays: Mapping[str, str] | None = None,
    path: str = "",
) -> str:  # fmt: skip
    """Format a struct as an initialiser with field names."""
    level, arrays = path.count("."), arrays or {}
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


def precision_of(filter: Estimator | None) -> CPrecision:
    """Return the precision of a model: a plant's is double, an estimator's its own."""
    return "float" if filter is not None and filter.precision == "float32" else "double"


def called(filter: Estimator) -> CoreKernel:
    """Return the core interface of an estimator."""
    result = core_kernel(filter)
    if result is None:
        raise AmbkitError(f"the {filter.name} cannot be exported yet")
    return result


def own(filter: Estimator, precision: CPrecision) -> str:
    """Format the data of the estimator's kind, including arrays; empty if it has none."""
    fields = filter.core.own
    inner: Estimator | None = getattr(filter, "inner", None)
    if inner is not None:
        if inner.core.own:
            raise AmbkitError(f"{filter.name}: around this filter it cannot be exported")
        fields = {"inner": Name(f"{{&{called(inner).methods}, NULL, NULL, NULL}}")} | fields
    return struct_with_arrays(fields, precision) if fields else ""


def struct_with_arrays(fields: Mapping[str, Any], precision: CPrecision) -> str:
    """Format a struct as an initialiser, including its arrays."""
    held = arrays_of(fields).items()
    texts = {path: "{\n" + array(values, precision, "    ") + "}" for path, values in held}
    return struct(fields, precision, texts)


def declared(arrays: Mapping[str, NDArray[Any]], precision: CPrecision) -> list[dict[str, Any]]:
    """Return the declarations of arrays in a data file: name, type, length and text."""
    return [
        {"name": name, "type": type_of(values), "length": len(values),
         "text": array(values, precision)}
        for name, values in arrays.items()
    ]  # fmt: skip


def arrays_of(fields: Mapping[str, Any], path: str = "") -> dict[str, NDArray[Any]]:
    """Return all arrays in a struct and its nested structs, by the paths of their fields."""
    results: dict[str, NDArray[Any]] = {}
    for name, value in fields.items():
        if isinstance(value, Mapping):
            results |= arrays_of(value, f"{path}{name}.")
        elif isinstance(value, np.ndarray):
            results[f"{path}{name}"] = value
    return results


_COLUMNS = {2: ("k_i", "k_s"), 4: ("f", "f_i", "f_x", "f_ix")}
"""Fields of elements of an array of structs (`data.type_of`)."""


class Crc(NamedTuple):
    """Computation and value of a CRC."""

    lines: list[str]  # statements in C that change `crc`
    value: int  # of 32 bits


class Constants:
    """Collects constants in the order of the data file."""

    def __init__(self, precision: CPrecision) -> None:
        self._format = "<f4" if precision == "float" else "<f8"
        self._lines: list[str] = []
        self._bytes: list[bytes] = []

    def array(self, name: str, values: NDArray[Any]) -> None:
        """Add an array with a name of its own."""
        if values.dtype.kind == "u":
            self._loop(len(values), f"amb_crc_word(crc, {name}[i])")
            self._bytes.append(values.astype("<u4").tobytes())
            return
        self._bytes.append(values.astype(self._format).tobytes())
        if values.ndim == 1:
            self._lines.append(f"crc = amb_crc_reals(crc, {name}, {len(values)});")
            return
        fields = _COLUMNS[values.shape[1]]
        self._loop(len(values), *(f"amb_crc_real(crc, {name}[i].{field})" for field in fields))

    def fields(self, name: str, fields: Mapping[str, Any], *, arrays: bool) -> None:
        """Add a struct; `arrays`: its arrays are in it rather than behind pointers."""
        for place, value in _leaves(fields, name):
            if isinstance(value, np.ndarray):
                if arrays:
                    self._inside(place, value)
            elif isinstance(value, bool):
                self._word(f"{place} ? UINT32_C(1) : UINT32_C(0)", int(value))
            elif isinstance(value, int):
                self._word(f"(uint32_t){place}", value)
            else:
                self._lines.append(f"crc = amb_crc_real(crc, {place});")
                self._bytes.append(np.array(value, self._format).tobytes())

    def structs(self, name: str, rows: Sequence[Any], fields: Sequence[str]) -> None:
        """Add an array of structs, with unsigned integers."""
        real = [isinstance(value, float) for value in rows[0]]
        places = [f"{name}[i].{field}" for field in fields]
        self._loop(len(rows), *(
            f"amb_crc_real(crc, {place})" if is_real else f"amb_crc_word(crc, (uint32_t){place})"
            for place, is_real in zip(places, real, strict=True)
        ))  # fmt: skip
        format = "<" + "".join(self._format[1:] if is_real else "I" for is_real in real)
        format = format.replace("f4", "f").replace("f8", "d")
        self._bytes += [pack(format, *row) for row in rows]

    def crc(self) -> Crc:
        """Return the CRC of all constants."""
        return Crc(self._lines, zlib.crc32(b"".join(self._bytes)))

    def _inside(self, place: str, values: NDArray[Any]) -> None:
        """Add an array in a struct; an array of rows is one of arrays there."""
        if values.ndim == 1:
            self.array(place, values)
            return
        self._loop(len(values), f"amb_crc_reals(crc, {place}[i], {values.shape[1]})")
        self._bytes.append(values.astype(self._format).tobytes())

    def _word(self, text: str, value: int) -> None:
        self._lines.append(f"crc = amb_crc_word(crc, {text});")
        self._bytes.append(pack("<I", value & 0xFFFFFFFF))

    def _loop(self, n: int, *terms: str) -> None:
        inner = [f"  crc = {term};" for term in terms]
        self._lines += [f"for (int i = 0; i < {n}; i++) {{", *inner, "}"]


def _leaves(fields: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    """Yield the place in C and the value of everything that is neither a struct nor C already."""
    for name, value in fields.items():
        place = f"{path}.{name}"
        if isinstance(value, Mapping):
            yield from _leaves(value, place)
        elif not isinstance(value, Name):
            yield place, value
