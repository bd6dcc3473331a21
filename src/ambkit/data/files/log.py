"""What a log file holds, before a channel map gives it a meaning: arrays by name."""

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
    """Arrays as they stand in a file."""

    name: str  #: What the messages call the file.
    arrays: Mapping[str, Array]  #: Numbers as float64, (n,) or matrices; missing: NaN.
    units: Mapping[str, str] = field(default_factory=dict)  #: The unit of each, if it is stated.
    clocks: Mapping[str, str] = field(default_factory=dict)  #: The array with its times (MDF).
    meta: dict[str, Any] = field(default_factory=dict)  #: What else the file says.
    order: tuple[str, ...] = ()  #: Columns of a table in their order.
    remarks: tuple[str, ...] = ()  #: What a user may want to know about how the file was read.
    line_of: Callable[[int], int] | None = None  #: Line of a sample, from 1.
    header: int = 0  #: Line of the names in a text file, from 1; 0 where there is none.
    texts: Mapping[str, Any] = field(default_factory=dict)  #: Columns of times as text.
    titles: Mapping[str, str] = field(default_factory=dict)  #: A label (Simulink's).

    def place(self, sample: int) -> str:
        """Say where a sample stands: ``log.csv:17``, or the file alone."""
        return self.name if self.line_of is None else f"{self.name}:{self.line_of(sample)}"

    @property
    def head(self) -> str:
        """Where the names of the columns stand."""
        return f"{self.name}:{self.header}" if self.header else self.name

    @cached_property
    def contents(self) -> str:
        """What the file holds, in a line."""
        entries = [
            name if array.ndim == 1 and self.order else f"{name} {array.shape}"
            for name, array in self.arrays.items()
        ]
        entries += [f"{name} (times as text)" for name in self.texts]
        more = f" and {len(entries) - 30} more" if len(entries) > 30 else ""
        return ", ".join(entries[:30]) + more or "nothing"


class Request(NamedTuple):
    """What is read of a file."""

    columns: Collection[str | int] | None = None  #: Names of arrays, or places of columns.
    progress: Callable[[str], object] = lambda _: None
    lenient: bool = False  #: Leave out columns without numbers instead of refusing them.
    texts: Collection[str | int] = ()  #: Columns of times as text.


class DamagedLog(RecordError):
    """A log that can be read in part."""

    def __init__(self, problems: list[str], log: Log, samples: tuple[int, ...]) -> None:
        super().__init__(problems, log.name)
        self.log, self.samples = log, samples


def too_coarse(values: Array) -> bool:
    """Whether a column (n,) rises by steps that float64 can hardly tell apart at its size."""
    # Seconds or nanoseconds since 1970 do, at a high rate.
    head = values[:10_000]
    head = head[np.isfinite(head)]
    if head.size < 3 or (largest := float(np.abs(head).max())) < 1e8:
        return False
    with np.errstate(over="ignore"):  # a step between the ends of all floats is infinite
        steps = np.diff(head)
    rising = steps[steps > 0]
    if rising.size == 0 or np.mean(steps >= 0) < 0.9:
        return False
    return bool(np.finfo(np.float64).eps * largest > 1e-6 * np.median(rising))


def whole_numbers(name: str, values: NDArray[Any]) -> tuple[Array, list[str]]:
    """Turn integers (n,) into float64; a time that would lose digits counts from its first."""
    numbers = np.asarray(values, dtype=np.float64)
    if values.dtype.kind not in "iu" or values.ndim != 1 or not too_coarse(numbers):
        return numbers, []
    return (values - values[0]).astype(np.float64), [counted_from(name, str(values[0]))]


def noted(text: str) -> Any:
    """Read a note; what is no JSON, has too long a number or is nested too deeply is its text."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text


FIRST = re.compile(r"(.*) counts from its first value, ([-\d.]+)")  #: What `counted_from` says.


def counted_from(name: str, first: str) -> str:
    """Say that a column counts from its first value."""
    return f"{name} counts from its first value, {first}: as a whole it has too many digits"


@contextmanager
def library_errors(path: str) -> Iterator[None]:
    """Call a file damaged, whatever a library stumbles over in it."""
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
    """Refuse in one way, for all binary formats, what is not there, not to be read, or no file."""
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
    """Return the names of the wanted columns of a table; all of them if none are named."""
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
