"""Waveforms of references and disturbances.

Values of a waveform are in the unit of its use (a reference in m, a disturbance in N). Times are
seconds from the start of the run.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import (
    BeforeValidator,
    Field,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    WrapSerializer,
)

from ambkit.base.arrays import Array, real
from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import FilePath, Quantity, place_of_signal
from ambkit.base.errors import AmbkitError

Value = Annotated[float, Quantity("@")]
Time = Annotated[float, Quantity("s", "20 ms", at_least=0)]


def _plain_list(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _serialized(
    values: tuple[float, ...], one_by_one: SerializerFunctionWrapHandler, info: SerializationInfo
) -> Any:
    """Return numbers unchanged; only a file needs units."""
    return values if info.context is None else one_by_one(values)


Values = Annotated[tuple[Value, ...], BeforeValidator(_plain_list), WrapSerializer(_serialized)]
Times = Annotated[tuple[Time, ...], BeforeValidator(_plain_list), WrapSerializer(_serialized)]


class Waveform(Part, ABC):
    """A signal over time."""

    def sample(self, t: ArrayLike) -> Array:
        """Return the signal's values at given times.

        Parameters
        ----------
        t : array_like, (n,)
            Times [s], increasing.

        Returns
        -------
        ndarray, (n,)
            The values, in the SI unit of the signal.
        """
        return np.asarray(self._at(real("t", t)), dtype=np.float64)

    @abstractmethod
    def _at(self, t: Array) -> Any: ...

    def __add__(self, other: "Signal") -> "Sum":
        return Sum(parts=cast("tuple[Signal, ...]", (self, other)))


class Constant(Waveform):
    """A constant."""

    type: Literal["constant"] = "constant"
    value: Value
    """Value."""

    def _at(self, t: Array) -> Any:
        return np.full(t.shape, self.value)


class Step(Waveform):
    """Zero until a time, then constant."""

    type: Literal["step"] = "step"
    amplitude: Value
    """Value after the step."""
    time: Time = 0.0
    """Time of the step [s]."""

    def _at(self, t: Array) -> Any:
        return np.where(_reached(t, self.time), self.amplitude, 0.0)


class Ramp(Waveform):
    """Zero, then linear, then constant."""

    type: Literal["ramp"] = "ramp"
    slope: Annotated[float, Quantity("@/s")]
    """Slope per second."""
    start: Time = 0.0
    """Start of the ramp [s]."""
    end: Time | None = None
    """End of the ramp [s]. By default none."""

    def _at(self, t: Array) -> Any:
        end = math.inf if self.end is None else self.end
        return self.slope * (np.clip(t, self.start, end) - self.start)

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        start, end = read("start"), read("end")
        if end is not None and end <= start:
            yield "end", f"must be after start, {start:g} s; is {end:g} s"


class Sine(Waveform):
    """``offset + amplitude sin(2 pi frequency t + phase)``."""

    type: Literal["sine"] = "sine"
    amplitude: Value
    """Amplitude."""
    frequency: Annotated[float, Quantity("Hz", "50 Hz", above=0)]
    """Frequency [Hz]."""
    phase: Annotated[float, Quantity("rad", "90 deg")] = 0.0
    """Phase at t = 0 [rad]."""
    offset: Value = 0.0
    """Mean value."""

    def _at(self, t: Array) -> Any:
        angle = 2 * np.pi * self.frequency * t + self.phase
        return self.offset + self.amplitude * np.sin(angle)


class Impulse(Waveform):
    """Rectangular pulse with a given integral.

    Each sample is the mean over the interval to the next one, so that the area is exact for any
    duration of the pulse.
    """

    type: Literal["impulse"] = "impulse"
    area: Annotated[float, Quantity("@ s")]
    """Integral over time: for a force, its momentum."""
    time: Time
    """Start [s]."""
    duration: Annotated[float, Quantity("s", "1 ms", above=0)]
    """Duration [s]."""

    def _at(self, t: Array) -> Any:
        last = t[-1] - t[-2] if t.size > 1 else self.duration
        edges = np.append(t, t[-1] + last)
        area = np.interp(edges, [self.time, self.time + self.duration], [0.0, self.area])
        return np.diff(area) / np.diff(edges)


class HalfSine(Waveform):
    """Half a period of a sine: the shock of IEC 60068-2-27."""

    type: Literal["half-sine"] = "half-sine"
    amplitude: Value
    """Maximum."""
    time: Time = 0.0
    """Start [s]."""
    duration: Annotated[float, Quantity("s", "11 ms", above=0)]
    """Duration [s]."""

    def _at(self, t: Array) -> Any:
        part = (t - self.time) / self.duration
        return np.where((part > 0) & (part < 1), self.amplitude * np.sin(np.pi * part), 0.0)


class Sequence(Waveform):
    """Values in sequence, each held until the next; zero before the first."""

    type: Literal["sequence"] = "sequence"
    times: Times
    """Start times of the values [s], increasing."""
    values: Values
    """The values."""

    def _at(self, t: Array) -> Any:
        index = np.searchsorted(np.asarray(self.times), t * (1 + _ROUNDING), side="right")
        return np.concatenate([[0.0], self.values])[index]

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        yield from _check_series(read("times"), read("values"))


class Recorded(Waveform):
    """Recorded signal, interpolated; constant before and after.

    Either `file` and `signal`, or `times` and `values`.
    """

    type: Literal["recorded"] = "recorded"
    file: FilePath | None = None
    """A recording (see `Record`), relative to the scenario's file."""
    signal: str | None = None
    """Name of the signal in the recording."""
    times: Times | None = None
    """Times of the values [s], increasing; instead of a file."""
    values: Values | None = None
    """The values; instead of a file."""

    @classmethod
    def of(cls, t: NDArray[Any], values: NDArray[Any]) -> Self:
        """Return samples without checks, which take longer than many simulations.

        Parameters
        ----------
        t, values : ndarray (n,)
            Times [s], ascending, and values in the unit of the waveform.

        Returns
        -------
        Recorded
            The waveform.
        """
        return cls.model_construct(times=tuple(t.tolist()), values=tuple(values.tolist()))

    def _at(self, t: Array) -> Any:
        if self.file is not None and self.signal is not None:
            from ambkit.data.record import Record

            record = Record.load(self.file)
            return np.interp(t, record.t, record[self.signal])
        return np.interp(t, np.asarray(self.times), np.asarray(self.values))

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        file, signal, times, values = map(read, ("file", "signal", "times", "values"))
        if file is None and signal is None:
            if times is None or values is None:
                yield "file", "missing: give file and signal, or times and values"
            else:
                yield from _check_series(times, values)
        elif times is not None or values is not None:
            yield "file", "give either file and signal, or times and values"
        elif signal is None:
            yield "signal", f"missing: which signal of {file}"
        elif file is None:
            yield "file", "missing: the recording with this signal"
        elif isinstance(file, str) and isinstance(signal, str):
            yield from _check_recording(file, signal)


class Sum(Waveform):
    """Sum of several waveforms; in Python also ``Step(...) + Sine(...)``."""

    type: Literal["sum"] = "sum"
    parts: tuple["Signal", ...]
    """The waveforms."""

    def _at(self, t: Array) -> Any:
        return sum((part.sample(t) for part in self.parts), np.zeros_like(t))


Signal = Annotated[
    Constant | Step | Ramp | Sine | Impulse | HalfSine | Sequence | Recorded | Sum,
    Field(discriminator="type"),
]
Sum.model_rebuild()

_ROUNDING = 1e-12


def _reached(t: Array, time: float) -> NDArray[np.bool_]:
    """Return whether a time is reached, with tolerance for the rounding in t = k T."""
    return t * (1 + _ROUNDING) >= time


def _check_series(times: Any, values: Any) -> Iterator[tuple[str, str]]:
    if not isinstance(times, tuple):
        return
    if not times:
        yield "times", "must not be empty"
    for before, after in pairwise(times):
        if after <= before:
            yield "times", f"must increase, but {after:g} s follows {before:g} s"
            break
    if isinstance(values, tuple) and len(times) != len(values):
        yield "values", f"must be as many as times, {len(times)}; are {len(values)}"


def _check_recording(file: str, signal: str) -> Iterator[tuple[str, str]]:
    from ambkit.data.record import Record

    try:
        record = Record.load(file)
        values = record[signal]
    except AmbkitError as error:
        yield "file", str(error)
        return
    place, unit = place_of_signal.get(), record.units.get(signal, "1")
    if place and unit != place.unit:
        yield "signal", f"must be in {place.unit}; {signal} of {file} is in {unit}"
    missing = np.count_nonzero(~np.isfinite(values))
    if missing:
        yield "signal", f"must be finite throughout; {signal} of {file} lacks {missing} samples"
