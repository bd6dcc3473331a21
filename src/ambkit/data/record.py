"""The record: measured or simulated time series with units."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError, shortened
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.data import frames
from ambkit.data import signals as names
from ambkit.result.showing import Shown

if TYPE_CHECKING:
    from ambkit.result.card import Card


TIME_TOLERANCE = 0.01  #: Tolerance of a time step, because logs print rounded times.


@dataclass(frozen=True, eq=False, repr=False)
class Record(Shown, frames.Framed):
    """Evenly sampled signals of one run, n samples; simulated or measured.

    The arrays are copied and read-only. NaN in a signal is a missing sample.

    Parameters
    ----------
    t : array_like (n,)
        Time [s], evenly sampled, n >= 2.
    signals : mapping of str to array_like (n,)
        The signals by name, in SI. The standard names are those of the symbol table: measured
        ``y`` [m], ``u`` [V], ``r`` [m], ``injected`` [m]; and the truth of a simulation, ``x`` [m],
        ``v`` [m/s], ``f_d`` [N], ``x_m`` [m], ``iu`` [A], ``f_mag`` [N].
    units : mapping of str to str, optional
        SI unit of each signal; optional for the standard names.
    meta : mapping, optional
        Origin of the record, representable in JSON: ``bearing`` (its TOML), ``scenario``, ``seed``,
        ``version`` of a simulation; ``source`` of a log.

    Raises
    ------
    RecordError
        Time not increasing, uneven or not finite; an infinite value; lengths that differ; a
        signal without unit, or in one that is not SI.
    """

    t: Array
    signals: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t = _frozen("t", self.t)
        if t.ndim == 1 and t.size < 2:
            raise RecordError(f"t must have at least 2 samples, has {t.size or 'none'}")
        if t.ndim != 1:
            raise RecordError(f"t must be a row of at least 2 samples, has shape {t.shape}")
        if problems := list(time_problems(t)):
            raise RecordError(shortened(problems))
        signals = {name: _frozen(name, values) for name, values in self.signals.items()}
        for name, values in signals.items():
            if name == "t":
                raise RecordError("t is the time, no signal can have this name")
            if values.shape != t.shape:
                raise RecordError(f"signal {name} has shape {values.shape}, t has {t.shape}")
            if np.isinf(values).any():
                at = int(np.argmax(np.isinf(values)))
                raise RecordError(f"signal {name} is {values[at]} at sample {at} (t = {t[at]:g} s)")
        units = {name: _si(name, (names.UNITS | dict(self.units)).get(name)) for name in signals}
        checked = {"t": t, "signals": signals, "units": units, "meta": dict(self.meta)}
        for key, value in checked.items():
            object.__setattr__(self, key, value)

    def __getitem__(self, name: str) -> Array:
        """Return a signal by its name, ``t`` too."""
        if name == "t":
            return self.t
        if name not in self.signals:
            raise RecordError(f"the record has no signal {name}; it has {', '.join(self)}")
        return self.signals[name]

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.signals

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __len__(self) -> int:
        return self.t.size

    def __repr__(self) -> str:
        columns = ", ".join(f"{name} [{self.units[name]}]" for name in self)
        return f"<Record {self.t[0]:g} to {self.t[-1]:g} s, {len(self)} samples: {columns}>"

    @property
    def sampling_time(self) -> float:
        """Mean time between two samples [s]."""
        return float(self.t[-1] - self.t[0]) / (len(self) - 1)

    @cached_property
    def truth(self) -> dict[str, Array]:
        """Signals known in simulation only; empty for a measured record.

        A record is simulated if its ``meta`` has the scenario: signals of an estimate have the same
        names, but are not the truth.
        """
        if "scenario" not in self.meta:
            return {}
        return {name: self.signals[name] for name in self if names.OF_TRUTH.fullmatch(name)}

    @property
    def has_truth(self) -> bool:
        """Whether there is a truth to judge estimates."""
        return bool(self.truth)

    def between(
        self, start: QuantityLike | None = None, stop: QuantityLike | None = None
    ) -> Record:
        """Return the part with start <= t < stop; its time is not shifted.

        Parameters
        ----------
        start, stop : float or str, optional
            Time [s], such as 0.2 or ``"200 ms"``, to half a sampling time. By default the start or
            end of the record.

        Raises
        ------
        RecordError
            The part has fewer than two samples.
        AmbkitError
            `start` or `stop` is not a time.
        """
        start, stop = in_si("start", start, "s"), in_si("stop", stop, "s")
        half = 0.5 * self.sampling_time
        first = 0 if start is None else int(np.searchsorted(self.t, start - half))
        last = len(self) if stop is None else int(np.searchsorted(self.t, stop - half))
        if last - first < 2:
            span = f"it goes from {self.t[0]:g} to {self.t[-1]:g} s"
            range_text = "" if start is None else f" from {start:g} s on"
            if stop is not None:
                range_text = (
                    f" before {stop:g} s" if start is None else f" from {start:g} to {stop:g} s"
                )
            raise RecordError(f"the record has no samples{range_text}: {span}")
        part = slice(first, last)
        return Record(
            self.t[part], {name: self[name][part] for name in self}, self.units, self.meta
        )

    def select(self, *signals: str) -> Record:
        """Return the record with some of its signals.

        Parameters
        ----------
        *signals : str
            Names, in the desired order.
        """
        return Record(self.t, {name: self[name] for name in signals}, self.units, self.meta)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the record; `load` restores its exact values.

        Parameters
        ----------
        path : path
            Ends with ``.csv`` or ``.parquet``.

        Raises
        ------
        RecordError
            Another ending, or ``meta`` that JSON cannot hold.
        AmbkitError
            The file cannot be written; an existing one is unchanged.
        """
        from ambkit.data.files.tables import Table

        units = {"t": "s"} | dict(self.units)
        Table({"t": self.t, **self.signals}, units, dict(self.meta)).save(path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Record:
        """Read a file written by `save`, or any table with units and an even clock.

        `ambkit.load` also accepts a channel map, and `ambkit.read` logs with defects.

        Parameters
        ----------
        path : path
            The file. A CSV has a header with units, ``t [s],y [mm],u [V]``; they are converted
            to SI.

        Raises
        ------
        RecordError
            The file is truncated, has text instead of a number, lacks units, or is not a valid
            record; the message states file and line.
        AmbkitError
            The file cannot be read.
        """
        from ambkit.data.files.tables import read_log, to_table

        log = read_log(path)
        table = to_table(log)
        if "t" not in table.columns:
            raise RecordError(f"{path}: has no column t [s]; it has {', '.join(table.columns)}")
        columns = dict(table.columns)
        t = columns.pop("t")
        problems = list(time_problems(t, log.place)) if t.size > 1 else []
        if problems:
            raise RecordError(shortened(problems), log.name)
        try:
            return cls(t, columns, table.units, table.meta)
        except RecordError as error:
            raise RecordError(f"{path}: {error}") from None

    def _series(self) -> frames.Series:
        return frames.Series(self.t, self.signals, self.units, {"meta": dict(self.meta)})

    @classmethod
    def _of_series(cls, series: frames.Series, units: Mapping[str, str] | None) -> Record:
        result = frames.in_si(series, units)
        return cls(result.t, result.columns, result.units, result.about.get("meta", {}))

    def _card(self) -> Card:
        from ambkit.data.record_card import record_card

        return record_card(self)


def _frozen(name: str, values: ArrayLike) -> Array:
    try:
        array = np.array(values)
        if np.iscomplexobj(array):
            raise RecordError(f"signal {name} holds complex numbers; give its real part")
        array = array.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        raise RecordError(f"signal {name} must be numeric") from None
    array.flags.writeable = False
    return array


def time_problems(t: Array, place: Callable[[int], str] | None = None) -> Iterator[str]:
    """Yield the reasons why times are not even."""
    # t (n,) [s]

    def at_(sample: int) -> str:
        return f"{place(sample)}: " if place else ""

    for at in np.flatnonzero(~np.isfinite(t)).tolist():
        yield f"{at_(at)}t is {t[at]} at sample {at}"
    steps = np.diff(t)
    for at in (np.flatnonzero(steps <= 0) + 1).tolist():
        before = f"{t[at]:g} s after {t[at - 1]:g} s"
        yield f"{at_(at)}t must increase, but sample {at} has {before}"
    step = float(np.nanmedian(steps)) if np.isfinite(steps).any() else math.nan
    uneven = (np.abs(steps - step) > TIME_TOLERANCE * step) & (steps > 0)
    for at in (np.flatnonzero(uneven) + 1).tolist():
        yield (
            f"{at_(at)}t must be even, but from sample {at - 1} to {at} (t = {t[at]:g} s) it goes "
            f"on by {steps[at - 1]:.6g} s instead of {step:.6g} s; a missing sample is an empty "
            "cell"
        )


def _si(name: str, unit: str | None) -> str:
    """Return the unit of a signal if it is the one in records."""
    if unit is None:
        raise RecordError(f"signal {name} has no unit")
    try:
        si = names.held_in(name, unit)
    except ValueError as error:
        raise RecordError(f"signal {name}: {error}") from None
    if unit == si:
        return unit
    raise RecordError(f"signal {name} must be given in {si}, not in {unit}")
