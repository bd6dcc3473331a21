"""The channels of a log, and what their names and units speak for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.files import timestamps
from ambkit.data.files.log import Log
from ambkit.data.reading.channel_statistics import seen, slow
from ambkit.data.reading.faults import noise
from ambkit.data.reading.role_names import role_of
from ambkit.data.signals import si_unit

BY_UNIT = "by its unit"
TEXT = "times as text"  #: The first thing that speaks for such a channel.


@dataclass(eq=False)
class Candidate:
    """One channel of a log, and what speaks for what it is."""

    label: str  #: What the log calls it, for the comments.
    where: dict[str, str | int]  #: Keys of the channel map that find it.
    values: Array  #: (n,) Its samples.
    unit: str = ""  #: What the log says of its unit; empty where it does not.
    clock: str = ""  #: Name of the array with its times, where the file says so.
    role: str = ""  #: ``t``, ``y``, ``u``, ``i``, ``v``, ``r`` or, not known, empty.
    called: str = ""  #: The role that its name says.
    why: list[str] = field(default_factory=list)  #: What speaks for that.
    #: Channels that may have its role too, and why that is not sure.
    rivals: list[tuple[Candidate, str]] = field(default_factory=list)
    estimated: bool = False  #: Whether it is an estimate of the rig's own.
    damage: RecordError | None = None  #: Why times as text cannot be read.
    turned: bool = False  #: Whether it counts the other way.
    weak: bool = False  #: Whether no more than a letter of its name says its role.
    drives: bool = False  #: Whether it is the duty or voltage of a power stage.
    scale: str = "1"  #: Of its unit: 100 of a time in 100 ns.

    @cached_property
    def noise(self) -> float:
        """Standard deviation of its noise."""
        return noise(self.values)

    @cached_property
    def size(self) -> float:
        """Standard deviation, above zero."""
        return max(float(seen(self.values).std()), 1e-300)

    @cached_property
    def slow(self) -> Array:
        """Its slow part (n,)."""
        return slow(self.values)


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
            why.append("day and month are guessed")
        yield Candidate(name, where, moments.seconds, "s", role="t", why=why)


_UNITS = (
    r"[mµuμn]?m[/_]s|mps|(?:\d+(?:[.,p]\d+)? ?)?(?:[mµuμn]?m|[mµuμn]?s|mils?)|"
    r"mA|A|mV|V|%|rpm|counts?|lsb|мкм|мм|м|мкс|мс|с|А|мА|В"
)
_UNIT_AT_END = re.compile(
    rf"(?P<name>.*?)(?:(?P<sign> in |, ?| */ ?|_+|_in_|\.| +|(?<=[\u3000-\u9fff]))"
    rf"(?P<unit>{_UNITS})"
    r"|(?<=[a-z])(?P<camel>Um|Mm|Nm|Ms|Us|Ma)"
    r"|(?<=[A-Z\d])[ _](?P<capitals>MILS?|UM|MM|MS|US))"
)
_UNIT_IN_BRACKETS = re.compile(rf"(.*?) ?[\[(] ?({_UNITS}) ?[\])](.*)")
_SEVERAL = re.compile(r"(\d+)(?:[.,p](\d+))? ?([^\W\d]\D*)")  #: Of a fieldbus: 100ns, 0.1um, 0p1um.
_PEAKS = re.compile(r"[ _](?:p-?p|pk(?:-?pk)?|0-?p|peak|rms)$", re.I)  #: Of a vibration.
_DEGREES = re.compile(r"(?:°|º|deg) ?[cf]|℃", re.I)
_IN_WORDS = {"mps": "m/s", "amps": "A", "amp": "A", "amperes": "A", "ampere": "A", "volts": "V",
             "volt": "V", "s": "s",
             "millis": "ms", "micros": "us", "ma": "mA"}  # fmt: skip
_OF_LETTERS = {"m": "yr", "s": "t", "A": "ui", "V": "u"}  #: Roles that have these units.
_CYRILLIC = str.maketrans("мксАВ", "mµsAV")
_ROLES = {"s": "t", "m": "y", "m/s": "v", "A": "i", "V": "u"}
_USUAL = {"t": "s", "k": "V", "r": "m", "y": "m", "v": "m/s", "i": "A", "u": "V"}
_ALSO = {("u", "A"), ("u", "1"), ("y", "V"), ("r", "V"), ("k", "1")}
"""Demanded currents; sensors that were not scaled."""
_HOLDERS = re.compile(r"values?|data|signals?|\d*|(?:out|in)\d*|yout|logsout|simout")
"""Parts of a name that say nothing, as of a structure that Simulink saves."""
_AXIS = re.compile(r"[a-z]{0,2}[V-Z]\d*|[v-z]\d*")  #: Of a structure: stCurrent.fX1.


def role_from_name(candidate: Candidate, *, planes: bool) -> None:
    """Read role and unit from the name; an A at its end may be a plane."""
    if candidate.role:
        return
    label = _own_part(_without_unit(candidate, planes))
    named = role_of(label)
    role, candidate.estimated = named.role, named.estimated
    candidate.called = "i" if named.demands else role
    candidate.weak, candidate.drives = named.weak, named.drives
    measured = _known_unit(candidate)
    of_unit = _ROLES.get(measured, "")
    if role == "-":
        candidate.role = role
        candidate.why.append("by its name neither position nor current")
        return
    if role == "r" and measured == "A":
        role = "u"  # a demanded current
    if role == "u" and measured == "m":
        role = "y" if named.weak else "r"  # a displacement u_x, or a demanded position
    kept, as_named = not named.weak and (role, measured) in _ALSO, role
    if role and measured and si_unit(_USUAL[role]) != measured and not kept:
        role = role if role == "u" and of_unit in ("", "u") else of_unit
    if role:
        candidate.role = role
        other = role != as_named and not named.weak
        candidate.why.append("by its unit, against its name" if other else "by its name")
        candidate.weak = (named.weak or not named.of_what) and role != of_unit
    elif of_unit or measured not in ("", "1"):
        candidate.role = "" if of_unit == "u" else of_unit or "-"  # volts of a sensor, perhaps
        candidate.why.append(BY_UNIT)


def _without_unit(candidate: Candidate, planes: bool) -> str:
    """Return the name without the unit that it ends with or has in brackets; keep that unit."""
    label, name, unit = candidate.label, candidate.label, candidate.unit
    if not unit and (inside := _UNIT_IN_BRACKETS.fullmatch(label)):
        name, unit = inside[1] + inside[3], inside[2]
    elif not unit and (at_end := _UNIT_AT_END.fullmatch(label)) and at_end["name"]:
        name = at_end["name"]
        unit = at_end["unit"] or (at_end["capitals"] or at_end["camel"]).lower()
        bare, place = role_of(name), (at_end["sign"] or "").isspace()
        # x_A is in the plane A, and in no amperes.
        if (len(unit) == 1 and place and bare.role not in _OF_LETTERS.get(unit, "")) or (
            unit == "A" and planes and not place and bare.of_what
            and (bare.role == "y" or (bare.role == "r" and bare.weak))
        ):  # fmt: skip
            return label
    elif not unit:
        lower = label.lower()  # um may be a measured u
        is_unit = lower in _IN_WORDS or (re.fullmatch(_UNITS, lower) and not role_of(label).role)
        unit = lower if is_unit and len(lower) > 1 else ""
    if unit and not candidate.unit:
        candidate.why.append("unit from its name")
    unit = unit.translate(_CYRILLIC).replace("mµ", "µ").replace("_", "/")
    unit = re.sub(r"^[?\ufffd](?=[ms]$)", "µ", unit)  # a damaged micro sign
    candidate.unit = _IN_WORDS.get(unit.lower(), unit)
    return name


def _known_unit(candidate: Candidate) -> str:
    """Return the SI unit of a channel's unit; forget a unit that is not known."""
    if several := _SEVERAL.fullmatch(candidate.unit):
        candidate.unit, candidate.scale = several[3], f"{several[1]}.{several[2] or 0}"
    candidate.unit = _PEAKS.sub("", candidate.unit)
    if _DEGREES.fullmatch(candidate.unit):
        candidate.unit = ""
        return "K"
    lower = candidate.unit if re.search(r"\d", candidate.unit) else candidate.unit.lower()
    for unit in dict.fromkeys((candidate.unit, lower)):  # A0 is a pin, a0 a length
        try:
            measured = si_unit(unit) if unit else ""
        except ValueError:
            continue
        candidate.unit = unit
        return measured
    candidate.why.append(f'its unit "{candidate.unit}" is not known')
    candidate.unit = ""
    return ""


def forget_unit(candidate: Candidate) -> None:
    """Forget a unit that the role of a channel cannot have."""
    role, measured = candidate.role, si_unit(candidate.unit) if candidate.unit else ""
    usual = si_unit(_USUAL.get(role, candidate.unit))
    if measured and measured != usual and (role, measured) not in _ALSO:
        candidate.why.append(f'"{candidate.unit}" is none of its units')
        candidate.unit = ""


def _own_part(label: str) -> str:
    """Return the last part of a full name that says something: ``pos`` of ``pos.values``."""
    parts = [re.sub(r"\[\d+\]$|\"", "", part) for part in re.split(r"/|\.(?! |$)", label)]
    own_parts = [part for part in parts if not _HOLDERS.fullmatch(part.lower())] or parts
    of_what = role_of("".join(own_parts[-2:-1]))
    is_axis = _AXIS.fullmatch(own_parts[-1]) and of_what.role in ("i", "y", "v")
    if (is_axis or of_what.role == "r") and not of_what.weak:  # setpoint.position
        return " ".join(own_parts[-2:])
    return own_parts[-1]
