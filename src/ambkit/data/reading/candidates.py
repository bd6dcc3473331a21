"""The channels of a log that may be signals: rows, columns, vectors, fields of structures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.files import timestamps
from ambkit.data.files.log import Log

TEXT = "times as text"  #: The first thing that speaks for such a channel.


@dataclass
class Candidate:
    """One channel of a log, and what speaks for what it is."""

    label: str  #: What the log calls it, for the comments.
    where: dict[str, str | int]  #: Keys of the channel map that find it.
    values: Array  #: (n,) Its samples.
    unit: str = ""  #: What the log says of its unit; empty where it does not.
    clock: str = ""  #: Name of the array with its times, where the file says so.
    role: str = ""  #: ``t``, ``y``, ``u``, ``i``, ``v``, ``r`` or, not known, empty.
    why: list[str] = field(default_factory=list)  #: What speaks for that.
    estimated: bool = False  #: Whether it is an estimate of the rig's own.
    damage: RecordError | None = None  #: Why times as text cannot be read.
    turned: bool = False  #: Whether it counts the other way.


def candidates(log: Log) -> list[list[Candidate]]:
    """Return the channels of a log, those of one length together, the longest first."""
    # A log that says which clock each of its channels has is one group.
    key = "column" if log.order or log.clocks else "array"
    results: list[Candidate] = []
    for name, array in log.arrays.items():
        if array.ndim == 2 and min(array.shape) > 1:
            results += _of_matrix(name, array, log)
        elif array.size > 1:
            label = log.titles.get(name) or (f"column {name}" if name.isdigit() else name)
            unit, clock = log.units.get(name, ""), log.clocks.get(name, "")
            results.append(Candidate(label, {key: name}, array.ravel(), unit, clock))
    results += _stamps(log, key)
    if log.clocks:
        return [results] if results else []
    groups: dict[int, list[Candidate]] = {}
    for candidate in results:
        groups.setdefault(candidate.values.size, []).append(candidate)
    return [groups[size] for size in sorted(groups, reverse=True)]


def _of_matrix(name: str, matrix: Array, log: Log) -> Iterator[Candidate]:
    """Yield the rows of a matrix, or its columns if there are fewer."""
    key = "row" if matrix.shape[1] >= matrix.shape[0] else "column"
    single = sum(array.size > 1 for array in log.arrays.values()) == 1
    for n, row in enumerate(matrix if key == "row" else matrix.T):
        label = f"{key} {n}" if single else f"{name}, {key} {n}"
        yield Candidate(label, {"array": name, key: n}, row)


def _stamps(log: Log, key: str) -> Iterator[Candidate]:
    """Yield the columns that are times as text; with their format where it cannot be told."""
    for name, cells in log.texts.items():
        try:
            moments = timestamps.read(cells, "", name, log.place, lenient=True)
        except RecordError as error:
            nothing = np.full(len(cells), np.nan)
            why = [TEXT, error.problems[0]]
            yield Candidate(name, {key: name}, nothing, "s", role="-", why=why, damage=error)
            continue
        where: dict[str, str | int] = {key: name}
        why = [TEXT, *moments.remarks[1:]]
        if not moments.certain:
            where["format"] = moments.layout
            why.append("which is the day and which the month is a mere guess")
        yield Candidate(name, where, moments.seconds, "s", role="t", why=why)
