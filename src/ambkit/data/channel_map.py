"""Channel map: the signals in the rows or columns of a log, and the meaning of their numbers.

For each number in the log, in SI: ``value = sign * scale * number * unit + offset``, as in::

    [signals.y]                    # y = 10 mm - z: distance from the magnet, turned around
    row = 2
    unit = "m"
    sign = -1
    offset = "10 mm"

A channel that was logged late has a ``delay``. A ``u`` that is a measured current is ``measured``,
and not held between samples; ``control`` is the signal that drives it, in any unit. A channel with
its own clock names it with ``time``; a log without times has ``sampling_time``.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import Field

from ambkit.base.arrays import Array
from ambkit.base.config import Document, Read
from ambkit.base.config.quantities import Description, Line, Name, Quantity
from ambkit.base.errors import RecordError
from ambkit.data.files import timestamps
from ambkit.data.files.log import Log
from ambkit.data.files.timestamps import pattern
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.data.signals import CONTROL, UNITS, held_in

Index = Annotated[int, Field(ge=0, strict=True)]


PLACES = ("r", "x_logged")  #: Signals on the same scale as y.


class MappedSignals(NamedTuple):
    """Signals selected by a channel map."""

    signals: Mapping[str, Array]  #: Each signal (n,) in SI, without the clocks.
    units: Mapping[str, str]  #: SI unit of each signal.
    clocks: Mapping[str, Array]
    """Times of samples (n,) [s], by clock; ``t`` first, if there is one."""
    clock_of: Mapping[str, str]  #: The clock of each signal.
    delays: Mapping[str, float]  #: Logging delay of a signal [s], if there is one.
    meta: dict[str, Any]  #: The map's name and source.
    remarks: tuple[str, ...] = ()  #: How times in text form were parsed.


class Channel(Scaling):
    """One signal: its place in the log, and the meaning of its numbers."""

    row: Index | None = None
    """Row of the array, from 0, if each sample is a column."""
    column: Index | Annotated[Line, Field(min_length=1)] | None = None
    """Column of the array, from 0, if each sample is a row; of a table its name or index."""
    array: Line | None = None
    """Array in the file, if not the map's default; without row or column it must be a vector."""
    delay: Annotated[float, Quantity("s", "0.25 ms")] = 0.0
    """Logging delay [s]; the signal is shifted back by it."""
    format: Line = ""
    """Format of times as text, such as "%d.%m.%Y %H:%M:%S.%f"; most are recognised."""
    measured: Annotated[bool, Field(strict=True)] = False
    """Of u: whether it is a measured current, which is interpolated between samples, as it is with
    a ``control``; otherwise it is a control signal, which is held.
    """
    time: Name | None = None
    """Signal with the times of its samples, if that is not ``t``."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        if isinstance(read("row"), int) and isinstance(read("column"), int | str):
            yield "column", "give either row or column"
        yield from super()._contradictions(read)
        layout = read("format")
        if isinstance(layout, str) and layout:
            if read("unit") != "s":
                yield "format", 'is of times as text, which are read as seconds: unit = "s"'
            try:
                pattern(layout)
            except ValueError as error:
                yield "format", str(error)


class ChannelMap(Document):
    """Meaning of the channels of a log; read from TOML with `load` or `from_toml`."""

    name: Name = ""
    """Kind of log."""
    source: Description = ""
    """Origin of such logs."""
    array: Line | None = None
    """Array in the file with the channels."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)] | None = None
    """Time between samples [s], for a log without times, or with meaningless ones."""
    signals: dict[Annotated[Name, Field(min_length=1)], Channel]
    """The signals by name; ``t`` is the time."""

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        signals = read("signals")
        if not isinstance(signals, dict):
            return
        even = isinstance(read("sampling_time"), float) and read("sampling_time") > 0
        if "t" not in signals and not even:
            yield "signals", "t, the time, is missing; without one, give sampling_time"
        if "t" in signals and even:
            yield "sampling_time", "give either sampling_time or signals.t"
        for name, channel in signals.items():
            if not isinstance(channel, Channel):
                continue
            place = f"signals.{name}"
            if held_in(name, channel.si_unit) != channel.si_unit:
                what = f"makes {name} a quantity in {channel.si_unit}, it is one in {UNITS[name]}"
                yield f"{place}.unit", what
            clock = signals.get(channel.time) if channel.time else None
            if channel.time and (channel.time == name or not isinstance(clock, Channel)):
                yield f"{place}.time", f"there is no other signal {channel.time} in this map"
            elif clock and clock.si_unit != "s":
                yield f"{place}.time", f"{channel.time} is a quantity in {clock.si_unit}, not in s"
            elif channel.time and even:
                yield f"{place}.time", "with sampling_time there is no other clock"

    def with_inputs(self, inputs: Inputs) -> "ChannelMap":
        """Return the map with y and u as the inputs of a filter."""
        # Other positions on the same scale as y, the reference and the rig's estimates, move with
        # it.
        signals = dict(self.signals)
        moved = inputs.y.zero - signals["y"].zero if "y" in signals else 0.0
        for name in PLACES:
            if name in signals:
                signals[name] = signals[name].shifted(moved)
        for name in ("y", "u"):
            if name in signals:
                scaling = getattr(inputs, name)
                update = {key: getattr(scaling, key) for key in Scaling.model_fields}
                signals[name] = signals[name].model_copy(update=update)
        return self.model_copy(update={"signals": signals})

    @property
    def texts(self) -> tuple[str | int, ...]:
        """Columns with times as text, in a format stated by the map."""
        formatted = [c for c in self.signals.values() if c.format]
        result = (self.array if c.column is None else c.column for c in formatted if not c.array)
        arrays = (c.array for c in formatted if c.array)
        return tuple(item for item in (*result, *arrays) if item is not None)

    @property
    def columns_needed(self) -> tuple[str | int, ...]:
        """What the map needs of a file: names of arrays or columns, and indices of columns."""
        channels = self.signals.values()
        places = (c.column if (name := self._name(c)) is None else name for c in channels)
        return tuple(dict.fromkeys(place for place in places if place is not None))

    def apply(self, log: Log) -> MappedSignals:
        """Select the signals of a log; see `pick`."""
        mapped, problems = self.pick(log)
        if problems:
            raise RecordError(problems, log.name)
        return mapped

    def pick(self, log: Log) -> tuple[MappedSignals, list[str]]:
        """Select the signals that a log has."""
        values: dict[str, Array] = {}
        remarks: list[str] = []
        problems: list[str] = []
        for name, channel in self.signals.items():
            try:
                values[name] = channel.value(self._numbers(channel, log, remarks))
            except RecordError as error:
                for problem in error.problems:
                    placed = problem.startswith(f"{log.name}:")
                    problems.append(problem if placed else f"{log.name}: signal {name}: {problem}")
        clock_names = {"t", *(c.time for c in self.signals.values() if c.time)}
        signals = {name: v for name, v in values.items() if name not in clock_names}
        clock_of = {name: self.signals[name].time or "t" for name in signals}
        clocks = {name: v for name, v in values.items() if name in clock_names}
        if self.sampling_time is not None:
            n = max((v.size for v in signals.values()), default=0)
            clocks["t"] = self.sampling_time * np.arange(n, dtype=np.float64)
        if not problems:
            problems = list(self._clock_problems(log, signals, clocks, clock_of))
        about = {"log": self.name, "origin": self.source}
        # A measured u is not the control signal.
        is_current = "u" in signals and (self.signals["u"].measured or CONTROL in signals)
        mapped = MappedSignals(
            signals,
            {name: self.signals[name].si_unit for name in signals},
            clocks,
            clock_of,
            {name: c.delay for name, c in self.signals.items() if c.delay and name in signals},
            {key: text for key, text in about.items() if text}
            | ({"measured": ["u"]} if is_current else {}),
            tuple(dict.fromkeys(remarks)),
        )
        return mapped, problems

    def _clock_problems(
        self,
        log: Log,
        signals: Mapping[str, Array],
        clocks: dict[str, Array],
        clock_of: dict[str, str],
    ) -> Iterator[str]:
        """Yield signals with another clock than stated, and give them their own."""
        for name, values in signals.items():
            clock = clock_of[name]
            place = f"{log.name}: signal {name}"
            column, used = map(self._name, map(self.signals.get, (name, clock)))
            own = log.clocks.get(column or "")
            if own is not None and own != used and self.sampling_time is None:
                clocks[own], clock_of[name] = log.arrays[own], own
                yield (
                    f'{place}: has the clock "{own}" in the file, and {clock} is "{used}"; give it '
                    f'a clock of its own: time = "t_{name}", and [signals.t_{name}] with column = '
                    f'"{own}"'
                )
            elif values.shape != clocks[clock].shape:
                yield (
                    f"{place} has shape {values.shape}, its time {clock} has {clocks[clock].shape}"
                )

    def _name(self, channel: Channel | None) -> str | None:
        """Return the name of the array or column of a signal."""
        if channel is None:
            return None
        return channel.column if isinstance(channel.column, str) else channel.array or self.array

    def _numbers(self, channel: Channel, log: Log, remarks: list[str]) -> Array:
        name = self._name(channel)
        if name is None and isinstance(channel.column, int) and log.order:
            name = log.order[channel.column]
            if name in log.arrays:
                return log.arrays[name]
        if name is not None and name in log.texts:
            if channel.unit != "s":
                raise RecordError(f'{name} holds times as text, which are seconds: unit = "s"')
            moments = timestamps.read(log.texts[name], channel.format, name, log.place)
            remarks += moments.remarks
            return moments.seconds
        if name is None:
            raise RecordError("the channel map does not say which array, or which column by name")
        if name not in log.arrays:
            raise RecordError(f"there is no {name}; there is {', '.join(log.arrays) or 'nothing'}")
        array = log.arrays[name]
        if isinstance(channel.row, int):
            return _pick(array, 0, channel.row, f"{name} has no row")
        if isinstance(channel.column, int):
            return _pick(array, 1, channel.column, f"{name} has no column")
        if array.size != max(array.shape):
            raise RecordError(f"{name} has shape {array.shape}: which row or column is it?")
        return array.ravel()


def inputs_of(channels: ChannelMap) -> Inputs:
    """Return a controller's inputs with the same numbers as a log."""
    keys = tuple(Scaling.model_fields)
    return Inputs(**{
        name: Scaling(**{key: getattr(channels.signals[name], key) for key in keys})
        for name in ("y", "u")
        if name in channels.signals
    })  # fmt: skip


def _pick(array: Array, axis: int, index: int, complaint: str) -> Array:
    if array.ndim == 1 and index == 0:  # some readers drop the other dimension
        return array
    if array.ndim != 2 or index >= array.shape[axis]:
        raise RecordError(f"{complaint} {index}, its shape is {array.shape} (counted from 0)")
    return array[index] if axis == 0 else array[:, index]
