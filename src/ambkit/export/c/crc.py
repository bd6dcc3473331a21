"""The CRC of all constants of an export: what a controller computes, and what it must be.

Numbers are taken one by one, in the order in which the data file has them, and not as bytes of a
struct: padding, byte order and pointers differ from processor to processor.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.export.c.c_literals import CPrecision, Name

_COLUMNS = {2: ("k_i", "k_s"), 4: ("f", "f_i", "f_x", "f_ix")}
"""Fields of what stands in an array of structs (`data.type_of`)."""


class Crc(NamedTuple):
    """How it is computed, and its value."""

    lines: list[str]  # statements in C that change `crc`
    value: int  # of 32 bits


class Constants:
    """Gathers constants, in the order of the data file."""

    def __init__(self, precision: CPrecision) -> None:
        self._format = "<f4" if precision == "float" else "<f8"
        self._lines: list[str] = []
        self._bytes: list[bytes] = []

    def array(self, name: str, values: NDArray[Any]) -> None:
        """Take in an array with a name of its own."""
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
        """Take in a struct; `arrays`: its arrays are in it, and not behind pointers."""
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

    def crc(self) -> Crc:
        """Return the CRC of all that was taken in."""
        return Crc(self._lines, zlib.crc32(b"".join(self._bytes)))

    def _inside(self, place: str, values: NDArray[Any]) -> None:
        """Take in an array that is in a struct: one of rows is one of arrays there."""
        if values.ndim == 1:
            self.array(place, values)
            return
        self._loop(len(values), f"amb_crc_reals(crc, {place}[i], {values.shape[1]})")
        self._bytes.append(values.astype(self._format).tobytes())

    def _word(self, text: str, value: int) -> None:
        self._lines.append(f"crc = amb_crc_word(crc, {text});")
        self._bytes.append(struct.pack("<I", value & 0xFFFFFFFF))

    def _loop(self, n: int, *terms: str) -> None:
        inner = [f"  crc = {term};" for term in terms]
        self._lines += [f"for (int i = 0; i < {n}; i++) {{", *inner, "}"]


def _leaves(fields: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    """Give the place in C and the value of all that is neither a struct nor C already."""
    for name, value in fields.items():
        place = f"{path}.{name}"
        if isinstance(value, Mapping):
            yield from _leaves(value, place)
        elif not isinstance(value, Name):
            yield place, value
