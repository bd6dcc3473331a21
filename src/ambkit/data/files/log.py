"""Content of a log file, before a channel map defines its meaning: arrays by name."""

from __future__ import annotations

import json
import os
import re
import stat
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError, RecordError


@dataclass(frozen=True)
class Log:
    """Arrays of a file."""

    name: str  #: Name of the file in messages.
    arrays: Mapping[str, Array]  #: Numbers as float64, (n,) or matrices; missing: NaN.
    units: Mapping[str, str] = field(default_factory=dict)  #: Units, if stated.
    clocks: Mapping[str, str] = field(default_factory=dict)  #: The array with its times (MDF).
    meta: dict[str, Any] = field(default_factory=dict)  #: Other content of the file.
    order: tuple[str, ...] = ()  #: Columns of a table in order.
    remarks: tuple[str, ...] = ()  #: Remarks on the reading of the file.
    line_of: Callable[[int], int] | None = None  #: Line of a sample, from 1.
    head_text: str = ""  #: The lines above the numbers of a text file.
    header: int = 0  #: Line of the names in a text file, from 1; 0 if there are none.
    texts: Mapping[str, Any] = field(default_factory=dict)  #: Columns of times as text.
    titles: Mapping[str, str] = field(default_factory=dict)  #: Labels (Simulink's).

    def place(self, sample: int) -> str:
        """Return the place of a sample: ``log.csv:17``, or the file only."""
        return self.name if self.line_of is None else f"{self.name}:{self.line_of(sample)}"

    @property
    def head(self) -> str:
        """Place of the column names."""
        return f"{self.name}:{self.header}" if self.header else self.name

    @cached_property
    def contents(self) -> str:
        """Content of the file in one line."""
        entries = [
            name if array.ndim == 1 and self.order else f"{name} {array.shape}"
            for name, array in self.arrays.items()
        ]
        entries += [f"{name} (times as text)" for name in self.texts]
        more = f" and {len(entries) - 30} more" if len(entries) > 30 else ""
        return ", ".join(entries[:30]) + more or "nothing"


class Request(NamedTuple):
    """Parts of a file to read."""

    columns: Collection[str | int] | None = None  #: Names of arrays, or indices of columns.
    progress: Callable[[str], object] = lambda _: None
    lenient: bool = False  #: Omit columns without numbers instead of rejecting them.
    texts: Collection[str | int] = ()  #: Columns of times as text.


class DamagedLog(RecordError):
    """A log that is readable in part."""

    def __init__(self, problems: list[str], log: Log, samples: tuple[int, ...]) -> None:
        super().__init__(problems, log.name)
        self.log, self.samples = log, samples


def too_coarse(values: Array) -> bool:
    """Return whether a column (n,) rises in steps close to float64's resolution at its size."""
    # Seconds or nanoseconds since 1970 do, at a high rate.
    head = values[:10_000]
    head = head[np.isfinite(head)]
    if head.size < 3 or (largest := float(np.abs(head).max())) < 1e8:
        return False
    with np.errstate(over="ignore"):  # a step between the extremes of float64 is infinite
        steps = np.diff(head)
    rising = steps[steps > 0]
    if rising.size == 0 or np.mean(steps >= 0) < 0.9:
        return False
    return bool(np.finfo(np.float64).eps * largest > 1e-6 * np.median(rising))


def integers(name: str, values: NDArray[Any]) -> tuple[Array, list[str]]:
    """Convert integers (n,) to float64; times that would lose digits are relative to the first."""
    numbers = np.asarray(values, dtype=np.float64)
    if values.dtype.kind not in "iu" or values.ndim != 1 or not too_coarse(numbers):
        return numbers, []
    return (values - values[0]).astype(np.float64), [counted_from(name, str(values[0]))]


def noted(text: str) -> Any:
    """Parse a note; invalid JSON, or JSON with long numbers or deep nesting, remains text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


FIRST = re.compile(r"(.*) counts from its first value, ([-\d.]+)")  #: Text of `counted_from`.


def counted_from(name: str, first: str) -> str:
    """Return that a column is relative to its first value."""
    return f"{name} counts from its first value, {first}: as a whole it has too many digits"


@contextmanager
def library_errors(path: str) -> Iterator[None]:
    """Report any error of a library as a damaged file."""
    try:
        yield
    except AmbkitError:
        raise
    except (FileNotFoundError, PermissionError, IsADirectoryError) as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:
        what = str(error).partition("\n")[0].partition(";")[0] or type(error).__name__
        raise RecordError(f"{path}: is damaged or cut short: {what}") from error


def check_readable(path: str | os.PathLike[str]) -> None:
    """Reject a missing or unreadable file, or a non-file, equally for all binary formats."""
    try:
        if not stat.S_ISREG(os.stat(path).st_mode) and not os.path.isdir(path):
            raise RecordError(
                f"{path}: is a pipe or a device; a {Path(path).suffix} is read from a file only"
            )
        with open(path, "rb") as file:
            if not file.read(1):
                raise RecordError(f"{path}: is empty; is the file cut short?")
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}") from error


def column_names(
    order: Sequence[str], selection: Collection[str | int] | None, place: str
) -> list[str]:
    """Return the names of the wanted columns of a table; by default all."""
    if selection is None:
        return list(order)
    results: list[str] = []
    for item in selection:
        if isinstance(item, int) and item >= len(order):
            raise RecordError(f"{place}: has no column {item}, it has {len(order)} (from 0)")
        name = order[item] if isinstance(item, int) else item
        if name not in order:
            twins = [other for other in order if other.startswith(f"{name}#")]
            if twins:
                raise RecordError(f"{place}: has several columns {name}: use {' or '.join(twins)}")
            raise RecordError(f"{place}: has no column {name}; it has {', '.join(order)}")
        results.append(name)
    return list(dict.fromkeys(results))
