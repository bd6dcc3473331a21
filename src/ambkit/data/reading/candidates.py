"""The channels of a log, and what their names and units speak for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.files import timestamps
from ambkit.data.files.log import Log
from ambkit.data.reading.role_names import role_of
from ambkit.data.signals import si_unit

BY_UNIT = "by its unit"
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
    weak: bool = False  #: Whether no more than a letter of its name says its role.
    drives: bool = False  #: Whether it is the duty or voltage of a power stage.


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


_UNIT_IN_NAME = re.compile(r"(.*?)(?: in |[ _]*(?:/ ?|_in_|_))(µm|um|mm|m|ms|us|s|A|mA|V|mV|mps|%)")
_ROLES = {"s": "t", "m": "y", "m/s": "v", "A": "i", "V": "u"}
_USUAL = {"t": "s", "r": "m", "y": "m", "v": "m/s", "i": "A", "u": "V"}
_ALSO = {("u", "A"), ("y", "V"), ("r", "V")}  #: Demanded currents; sensors that were not scaled.
_HOLDERS = re.compile(r"values?|data|signals?|\d*|(?:out|in)\d*|yout|logsout|simout")
"""Parts of a name that say nothing, as of a structure that Simulink saves."""


def role_from_name(candidate: Candidate) -> None:
    """Read role and unit from the name."""
    if candidate.role or any(isinstance(place, int) for place in candidate.where.values()):
        return
    label = candidate.label
    in_name = _UNIT_IN_NAME.fullmatch(label)
    # x_A is in the plane A, and in no amperes.
    bare = role_of(in_name[1]) if in_name is not None and in_name[2] == "A" else None
    of_plane = bare is not None and (bare.role == "y" or (bare.role == "r" and bare.weak))
    if in_name and in_name[1] and not candidate.unit and not of_plane:
        label, candidate.unit = in_name[1], in_name[2].replace("mps", "m/s")
        candidate.why.append("unit from its name")
    label = _own_part(label)
    named = role_of(label)
    role, candidate.estimated = named.role, named.estimated
    candidate.weak, candidate.drives = named.weak, named.drives
    try:
        measured = si_unit(candidate.unit) if candidate.unit else ""
    except ValueError:
        candidate.why.append(f'its unit "{candidate.unit}" is not known')
        candidate.unit = measured = ""
    of_unit = _ROLES.get(measured, "")
    if role == "-":
        candidate.role = role
        candidate.why.append("by its name neither position nor current")
        return
    if role == "r" and measured == "A":
        role = "u"  # a demanded current
    if role == "u" and measured == "m":
        role = "r"  # a demanded position
    kept = not named.weak and (role, measured) in _ALSO
    if role and measured and si_unit(_USUAL[role]) != measured and not kept:
        role = of_unit if of_unit not in ("", "u") or role not in ("u", "r") else role
        role = of_unit if not role or (role != "u" and si_unit(_USUAL[role]) != measured) else role
    if role:
        candidate.role = role
        candidate.why.append("by its name")
    elif of_unit:
        candidate.role = of_unit
        candidate.why.append(BY_UNIT)


def _own_part(label: str) -> str:
    """Return the last part of a full name that says something: ``pos`` of ``pos.values``."""
    parts = [re.sub(r"\[\d+\]$", "", part) for part in re.split(r"[/.]", label)]
    own_parts = [part for part in parts if not _HOLDERS.fullmatch(part.lower())]
    return (own_parts or parts)[-1]
