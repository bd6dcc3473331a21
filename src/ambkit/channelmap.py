"""The channel map: which row or column of a log is which signal, and what its numbers mean.

::

    array = "logouts"              # the array in the .mat that holds the channels

    [signals.t]
    row = 0
    unit = "s"

    [signals.y]                    # y = 10 mm - z: distance from the magnet, turned around
    row = 2
    unit = "m"
    sign = -1
    offset = "10 mm"

    [signals.u]                    # a current stands for the control signal at 1 V/A
    row = 4
    unit = "A"
    scale = "1 V/A"
    offset = "-0.94 V"

Of each number in the log, ``value = sign * scale * number * unit + offset``, in SI. So what ties a
log to a bearing, such as the point around which the bearing is described, is data, not code.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ambkit import units
from ambkit.config import Document, Part, Read
from ambkit.errors import RecordError
from ambkit.files.tables import Table
from ambkit.signals import UNITS, si_unit

Array = NDArray[np.float64]
Index = Annotated[int, Field(ge=0, strict=True)]

_SCALE = re.compile(r"\s*(\S+)\s+(\S.*?)\s*")


class Channel(Part):
    """One signal: where it stands in the log, and what its numbers mean."""

    row: Index | None = None
    """Row of the array, from 0, where each sample is a column of it."""
    column: Index | Annotated[str, Field(min_length=1)] | None = None
    """Column of the array, from 0, where each sample is a row; of a CSV or Parquet its name."""
    array: str | None = None
    """The array in the ``.mat``, where it is not the map's own; alone, it must be a vector."""
    unit: str
    """Unit of the numbers in the log, such as "mm"."""
    scale: float | str = 1.0
    """Factor; with a unit where it makes one quantity of another, such as "2 A/V"."""
    sign: Annotated[int, Field(strict=True)] = 1
    """1, or -1 where the log counts the other way."""
    offset: str = ""
    """Added in the end, with its unit, such as "10 mm"."""

    @property
    def si_unit(self) -> str:
        """SI unit of the signal."""
        return si_unit(_scaled_unit(self.unit, self.scale))

    def value(self, numbers: Array) -> Array:
        """Turn the log's numbers into the signal, in SI."""
        gain = self.sign * _factor(self.unit, self.scale, self.si_unit)
        offset = units.parse(self.offset, self.si_unit) if self.offset else 0.0
        return gain * numbers + offset if offset or gain != 1.0 else numbers

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if isinstance(read("row"), int) and isinstance(read("column"), int | str):
            yield "column", "give either row or column"
        if read("sign") not in (1, -1) and isinstance(read("sign"), int):
            yield "sign", f"must be 1 or -1, is {read('sign')}"
        unit, scale, offset = read("unit"), read("scale"), read("offset")
        if scale == 0.0:
            yield "scale", "must not be 0"
        key = "unit"
        try:
            si_unit(unit if isinstance(unit, str) else "1")
            if isinstance(unit, str) and isinstance(scale, str | float):
                key = "scale"
                si = si_unit(_scaled_unit(unit, scale))
                _factor(unit, scale, si)
                key = "offset"
                units.parse(offset, si) if offset and isinstance(offset, str) else 0.0
        except ValueError as error:
            yield key, str(error)


class ChannelMap(Document):
    """What the channels of a log mean; read from TOML with `load` or `from_toml`."""

    name: str = ""
    """What kind of log this is for."""
    source: str = ""
    """Where such logs come from."""
    array: str | None = None
    """The array in the ``.mat`` that holds the channels."""
    signals: dict[str, Channel]
    """The signals by name; ``t`` is the time."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        signals = read("signals")
        if not isinstance(signals, dict):
            return
        if "t" not in signals:
            yield "signals", "t, the time, is missing"
        for name, channel in signals.items():
            if isinstance(channel, Channel) and UNITS.get(name, channel.si_unit) != channel.si_unit:
                yield (
                    f"signals.{name}.unit",
                    f"makes {name} a quantity in {channel.si_unit}, it is one in {UNITS[name]}",
                )

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that the map reads from a CSV or Parquet file."""
        named = [c.column for c in self.signals.values() if isinstance(c.column, str)]
        return tuple(dict.fromkeys(named))

    def apply(self, arrays: Mapping[str, Array], source: str = "the log") -> Table:
        """Pick the signals out of a log's arrays.

        Parameters
        ----------
        arrays : mapping of str to ndarray
            The arrays of a ``.mat``, or the columns (n,) of a CSV or Parquet file, by name.
        source : str
            What the messages call the log.

        Returns
        -------
        Table
            Signals (n,) in SI, their units, and the map's name and source as ``meta``.

        Raises
        ------
        RecordError
            The log lacks an array, row or column, or these differ in length.
        """
        columns: dict[str, Array] = {}
        for name, channel in self.signals.items():
            try:
                columns[name] = channel.value(self._numbers(channel, arrays))
            except RecordError as error:
                raise RecordError(f"{source}: signal {name}: {error}") from None
        about = {"log": self.name, "origin": self.source}
        meta: dict[str, Any] = {key: text for key, text in about.items() if text}
        return Table(columns, {name: c.si_unit for name, c in self.signals.items()}, meta)

    def _numbers(self, channel: Channel, arrays: Mapping[str, Array]) -> Array:
        name = channel.column if isinstance(channel.column, str) else channel.array or self.array
        if name is None:
            raise RecordError("the channel map does not say which array, or which column by name")
        if name not in arrays:
            raise RecordError(f"there is no {name}; there is {', '.join(arrays) or 'nothing'}")
        array = arrays[name]
        if isinstance(channel.row, int):
            return _pick(array, 0, channel.row, f"{name} has no row")
        if isinstance(channel.column, int):
            return _pick(array, 1, channel.column, f"{name} has no column")
        if array.size != max(array.shape):
            raise RecordError(f"{name} has shape {array.shape}: which row or column is it?")
        return array.ravel()


def _pick(array: Array, axis: int, index: int, complaint: str) -> Array:
    if array.ndim != 2 or index >= array.shape[axis]:
        raise RecordError(f"{complaint} {index}, its shape is {array.shape} (counted from 0)")
    return array[index] if axis == 0 else array[:, index]


def _scaled_unit(unit: str, scale: float | str) -> str:
    """Return the unit of number times scale."""
    match = _SCALE.fullmatch(scale) if isinstance(scale, str) else None
    return f"({unit}) * ({match[2]})" if match else unit


def _factor(unit: str, scale: float | str, to: str) -> float:
    if isinstance(scale, str):
        return units.parse(scale, "1" if unit == to else f"({to}) / ({unit})")
    return scale * units.factor(unit, to)
