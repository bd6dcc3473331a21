"""A channel map proposed for a log, with a comment on each line that says why."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import RecordError
from ambkit.base.escaping import one_line, toml_string
from ambkit.base.units import factor
from ambkit.data.files.formats import read_log
from ambkit.data.files.log import FIRST, Log
from ambkit.data.reading.candidates import (
    Candidate,
    candidates,
    correlation,
    find_roles,
    seen,
    slow,
)
from ambkit.data.reading.clock import examine
from ambkit.data.reading.faults import noise
from ambkit.data.signals import si_unit

Array = NDArray[np.float64]

_OF_Y = {
    "r": "which it is the reference of",
    "x_logged": "which it is an estimate of",
    "velocity": "whose rate it is",
    "v_logged": "whose rate it is",
}
"""Signals that have the direction of y, and why."""

_NAMES = {"i": "current", "v": "velocity"}  # not v: that is the truth of a simulation


def guess(path: str | os.PathLike[str], progress: Callable[[str], object] = lambda _: None) -> str:
    """Propose a channel map for a log.

    Parameters
    ----------
    path : path
        The log, of any format.
    progress : callable
        Called with what is being done.

    Returns
    -------
    str
        TOML with comments, to be edited.

    Raises
    ------
    RecordError
        The file is damaged, or holds nothing that may be a log.
    AmbkitError
        The file cannot be read.
    """
    log = read_log(path, None, progress, lenient=True)
    progress("comparing the channels")
    array, found = candidates(log)
    if not found:
        most = max((array.size for array in log.arrays.values()), default=0)
        what = (
            f"only {most} sample{'s' * (most != 1)} of"
            if log.arrays and most < 2
            else "no channels:"
        )
        raise RecordError(f"{path}: holds {what} {log.contents}")
    find_roles(found)
    damage = next((candidate.damage for candidate in found if candidate.damage), None)
    if damage and not any(candidate.role == "t" for candidate in found):
        raise damage
    return "\n".join(map(one_line, _toml(Path(path).name, log, array, found))) + "\n"


def _toml(name: str, log: Log, array: str, found: list[Candidate]) -> Iterator[str]:
    yield f"# Proposed by 'ambkit read --guess' for {name}. Look at each line before you trust it."
    yield "# Of each number in the log: value = sign * scale * number * unit + offset."
    for remark in log.remarks:
        yield f"# {remark[:1].upper()}{remark[1:]}."
    if array:
        yield f"array = {toml_string(array)}"
    chosen = _chosen(found)
    y, u = chosen.get("y"), chosen.get("u")
    clock = _clock_name(log, chosen)
    if clock is None:
        yield ""
        yield "# No channel rises like a time: fill in how far apart the samples are."
        yield '# sampling_time = "... ms"'
    yield from _time(log, clock, chosen.get("t"))
    clocks = {clock: "t"}
    for role, candidate in chosen.items():
        if role == "t":
            continue
        own = candidate.clock
        yield ""
        yield from _comment(candidate)
        if own and own != clock and own not in clocks:
            clocks[own] = f"t_{role}"
            yield "# It has a clock of its own: 'ambkit read --resample' puts all on one grid."
            yield f"[signals.{clocks[own]}]"
            yield f"column = {toml_string(own)}"
            yield 'unit = "s"'
            yield ""
        yield f"[signals.{role}]"
        yield from _where(candidate)
        yield from _meaning(role, candidate, y, u)
        if own and own != clock:
            yield f"time = {toml_string(clocks[own])}"
    if y is None:
        yield "# Nothing looks like a position; a filter needs y."
    if u is None:
        yield "# Nothing looks like a control signal; a filter needs u."
    taken = [id(candidate) for candidate in chosen.values()]
    rest = [c for c in found if id(c) not in taken and c.label not in clocks]
    if rest:
        yield ""
        yield "# Not used:"
    for candidate in rest:
        low, high = seen(candidate.values).min(), seen(candidate.values).max()
        unit = f" {candidate.unit}" if candidate.unit else ""
        why = f"; {', '.join(candidate.why)}" if candidate.why else ""
        yield f"# {candidate.label}: {low:.4g} to {high:.4g}{unit}{why}"


def _chosen(found: list[Candidate]) -> dict[str, Candidate]:
    """Give each signal of a record its channel; the estimates of the rig are logged signals."""
    chosen: dict[str, Candidate] = {}
    for role in ("t", "y", "u", "i", "r", "v"):
        for candidate in found:
            if candidate.role == role and not candidate.estimated:
                chosen.setdefault(role, candidate)
    if "u" not in chosen and "i" in chosen:
        chosen["u"] = chosen.pop("i")
    elif "i" in chosen and chosen["i"].estimated:
        del chosen["i"]
    for role in ("y", "v"):
        logged = [c for c in found if c.role == role and c.estimated]
        if logged:
            chosen[f"{'x' if role == 'y' else role}_logged"] = logged[0]
    order = ("t", "y", "u", "r", "i", "v", "x_logged", "v_logged")
    return {_NAMES.get(role, role): chosen[role] for role in order if role in chosen}


def _clock_name(log: Log, chosen: dict[str, Candidate]) -> str | None:
    """Return what holds the times: a clock that the file names, or the channel found."""
    first = next((c for role, c in chosen.items() if role != "t" and c.clock), None)
    if first is not None:
        return first.clock
    return chosen["t"].label if "t" in chosen else None


def _time(log: Log, clock: str | None, candidate: Candidate | None) -> Iterator[str]:
    if clock is None:
        return
    yield ""
    if candidate is None or clock in log.clocks.values():
        yield f"# The clock of the channel group: {_rate(log.arrays[clock])}."
        yield from ("[signals.t]", f"column = {toml_string(clock)}", 'unit = "s"')
        return
    unit, why = candidate.unit, ""
    if not unit:
        unit = _unit_of_time(log, candidate)
        why = "  # guessed from its size and steps"
    seconds = factor(unit, "s") if si_unit(unit) == "s" else 1.0
    yield f"# {candidate.label}: {', '.join(candidate.why)}; {_rate(candidate.values * seconds)}."
    yield "[signals.t]"
    yield from _where(candidate)
    yield f"unit = {toml_string(unit)}{why}"


def _unit_of_time(log: Log, candidate: Candidate) -> str:
    """Guess in what a time counts: since 1970, by its size; otherwise by its steps."""
    times = seen(candidate.values)
    told = filter(None, (FIRST.match(remark) for remark in log.remarks))
    first = next((float(m[2]) for m in told if m[1] == candidate.label), float(times[0]))
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("µs", 1e6), ("ns", 1e9)):
        if 5e8 < first / scale < 4.2e9:  # from 1985 to 2103
            return unit
    step = float(np.median(np.diff(times))) if times.size > 1 else 0.0
    return "s" if step < 0.1 else "ms" if step < 50 else "µs" if step < 2e4 else "ns"


def _rate(times: Array) -> str:
    there = times[np.isfinite(times)]
    return examine("t", there).in_words() if there.size > 1 else "one sample"


def _comment(candidate: Candidate) -> Iterator[str]:
    there = seen(candidate.values)
    unit = f" {candidate.unit}" if candidate.unit else ""
    about = (
        f"{there.min():.4g} to {there.max():.4g}{unit}, noise {noise(candidate.values):.2g}{unit}"
    )
    yield f"# {candidate.label}: {', '.join(candidate.why) or 'by elimination'}; {about}."


def _where(candidate: Candidate) -> Iterator[str]:
    for key, value in candidate.where.items():
        yield f"{key} = {value if isinstance(value, int) else toml_string(value)}"


def _meaning(
    role: str, candidate: Candidate, y: Candidate | None, u: Candidate | None
) -> Iterator[str]:
    """Write unit, scale, sign and, as a hint, the offset of a channel."""
    unit, said = candidate.unit, ""
    if not unit:
        unit = _likely_unit(candidate)
        said = "  # guessed from its size"
    yield f"unit = {toml_string(unit)}{said}"
    of_current = role == "u" and si_unit(unit) == "A"
    if of_current:
        yield 'scale = "1 V/A"  # the current stands for the control signal: amplifier gain 1 A/V'
    elif role == "u" and si_unit(unit) == "1":
        yield 'scale = "1 V"  # volts at full duty'
    turned = _turned(y, u)
    falls = role in _OF_Y and y is not None and _likeness(role, candidate, y) < -0.3
    if role in ("y", *_OF_Y) and y is not None and turned != falls:
        yield f"sign = -1  # {_why_turned(role, y, falls=falls)}"
    elif falls and y is not None:
        yield f"# sign = 1, for it falls where {y.label} grows, which is turned"
    middle = float(np.median(seen(candidate.values)))
    if role in ("y", "r", "x_logged") and y is not None:
        middle = middle if falls else float(np.median(seen(y.values)))
        away = middle if turned != falls else -middle
        yield f'# offset = "{away:.4g} {unit}"  # if x = 0 is at its median'
    elif of_current:
        yield f'# offset = "{-middle:.4g} V"  # if its median is the bias current'
    if role in ("y", "u"):
        yield '# delay = "0 ms"  # how late the logger wrote it'


def _turned(y: Candidate | None, u: Candidate | None) -> bool:
    """Whether y and u grow together, as they do not with the signs of an unstable plant."""
    if y is None or u is None or y.values.shape != u.values.shape:
        return False
    return correlation(slow(u.values), slow(y.values)) > 0.3


def _likeness(role: str, candidate: Candidate, y: Candidate) -> float:
    """Correlation of a reference or an estimate with y, of a velocity with the rate of y."""
    if candidate.values.shape != y.values.shape or y.values.size < 3:
        return 0.0
    place = slow(y.values)
    return correlation(
        slow(candidate.values), np.gradient(place) if role.startswith("v") else place
    )


def _why_turned(role: str, y: Candidate, *, falls: bool) -> str:
    if falls:
        return f"it falls where {y.label} grows"
    if role == "y":
        return "u grows with it; of an unstable plant it must fall (or turn u)"
    return f"as {y.label}, {_OF_Y[role]}"


def _likely_unit(candidate: Candidate) -> str:
    size = float(np.percentile(np.abs(seen(candidate.values)), 90))
    match candidate.role:
        case "y" | "r":
            return "m" if size < 0.05 else "mm" if size < 50 else "µm"
        case "v":
            return "m/s" if size < 5 else "mm/s"
        case "i":
            return "A" if size < 100 else "mA"
        case "u":
            return "1" if size <= 1.0 and seen(candidate.values).min() >= 0 else "V"
    return "1"
