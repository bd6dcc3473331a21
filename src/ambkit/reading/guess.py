"""A channel map proposed for a log: by names and units where it has them, else by statistics.

What a magnetic bearing's log holds is known: a time that rises evenly; a position; its velocity,
which is the position's difference; a reference, which follows the position without its noise; a
current or control signal, which mirrors the position, since the plant is unstable. So even an array
without one name can be told apart. A guess stays a guess: each line says why.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambkit.errors import RecordError
from ambkit.files.log import Log, read_log
from ambkit.reading.clock import examine
from ambkit.reading.faults import noise
from ambkit.signals import si_unit

Array = NDArray[np.float64]

LOOKED_AT = 50_000
"""Samples that the statistics are made of."""

_WORDS = {
    "t": r"t|time|zeit|temps|timestamps?|seconds?|sec|clock|uhr",
    "r": r"r|w|ref|reference|soll\w*|set_?point|sp|desired|target|command_pos\w*",
    "v": r"v|vel|velocity|speed|geschw\w*|xdot|dx",
    "i": r"i|cur|current|strom|amps?|iu|coil|spulenstrom",
    "u": r"u|control|ctrl|cmd|command|duty|pwm|stell\w*|output|volt\w*|spannung",
    "y": r"y|x|z|pos|position|weg|dist|distance|displ\w*|gap|abstand|lage|sensor|auslenkung",
}
_ESTIMATED = re.compile(r"est\w*|hat|obs\w*|kf|ekf|filt\w*|model\w*|logged")
_UNIT_IN_NAME = re.compile(r"(.*?)[ _]*(?:/ ?|_in_|_)(µm|um|mm|m|ms|us|s|A|mA|V|mV|mps)$")
_ROLES = {"s": "t", "m": "y", "m/s": "v", "A": "i", "V": "u"}
_NAMES = {"i": "current", "v": "velocity"}  # not v: that is the truth of a simulation
_USUAL = {"t": "s", "r": "m", "y": "m", "v": "m/s", "i": "A", "u": "V"}


@dataclass
class Candidate:
    """One channel of a log, and what speaks for what it is.

    Attributes
    ----------
    label : str
        What the log calls it, for the comments.
    where : dict
        Keys of the channel map that find it.
    values : ndarray (n,)
        Its samples.
    unit : str
        What the log says of its unit; empty where it does not.
    clock : str
        Name of the array with its times, where the file says so.
    role : str
        ``t``, ``y``, ``u``, ``i``, ``v``, ``r`` or, not known, empty.
    why : list of str
        What speaks for that.
    """

    label: str
    where: dict[str, str | int]
    values: Array
    unit: str = ""
    clock: str = ""
    role: str = ""
    why: list[str] = field(default_factory=list)
    estimated: bool = False


def guess(path: str | os.PathLike[str], told: Callable[[str], object] = lambda _: None) -> str:
    """Propose a channel map for a log.

    Parameters
    ----------
    path : path
        The log, of any format.
    told : callable
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
    log = read_log(path, None, told, lenient=True)
    told("comparing the channels")
    array, found = _candidates(log)
    if not found:
        raise RecordError(f"{path}: holds no channels: {log.contents}")
    for candidate in found:
        candidate.values = np.where(np.isfinite(candidate.values), candidate.values, np.nan)
        _by_name(candidate)
    _find_time(found)
    _by_statistics(found)
    return "\n".join(_toml(Path(path).name, log, array, found)) + "\n"


def _candidates(log: Log) -> tuple[str, list[Candidate]]:
    """Return the name of the array that holds all channels, if one does, and the channels."""
    matrices = {k: v for k, v in log.arrays.items() if v.ndim == 2 and min(v.shape) > 1}
    vectors = {k: v.ravel() for k, v in log.arrays.items() if k not in matrices}
    longest = max((v.size for v in vectors.values()), default=0)
    if matrices:
        name, matrix = max(matrices.items(), key=lambda item: max(item[1].shape))
        if max(matrix.shape) >= longest:
            key = "row" if matrix.shape[1] >= matrix.shape[0] else "column"
            rows = matrix if key == "row" else matrix.T
            return name, [Candidate(f"{key} {n}", {key: n}, row) for n, row in enumerate(rows)]
    key = "column" if log.order or log.clocks else "array"
    return "", [
        Candidate(
            f"column {name}" if name.isdigit() else name,
            {key: name},
            values,
            log.units.get(name, ""),
            log.clocks.get(name, ""),
        )
        for name, values in vectors.items()
        if values.size > 1 and (log.clocks or values.size == longest)
    ]


def _by_name(candidate: Candidate) -> None:
    """Read role and unit from the name."""
    if not isinstance(next(iter(candidate.where.values())), str):
        return
    label = re.split(r"[/.]", candidate.label)[-1]
    in_name = _UNIT_IN_NAME.fullmatch(label)
    if in_name and in_name[1] and not candidate.unit:
        label, candidate.unit = in_name[1], in_name[2].replace("mps", "m/s")
        candidate.why.append("unit from its name")
    words = [w for w in re.split(r"[^a-zäöüß]+", re.sub(r"\d+", " ", label.lower())) if w]
    candidate.estimated = any(_ESTIMATED.fullmatch(word) for word in words)
    named = [role for role, pattern in _WORDS.items() if _any(pattern, words)]
    role = named[0] if named else ""
    try:
        measured = si_unit(candidate.unit) if candidate.unit else ""
    except ValueError:
        candidate.why.append(f'its unit "{candidate.unit}" is not known')
        candidate.unit = measured = ""
    of_unit = _ROLES.get(measured, "")
    if role and measured and si_unit(_USUAL[role]) != measured:
        role = of_unit if of_unit not in ("", "u") or role not in ("u", "r") else role
        role = of_unit if not role or (role != "u" and si_unit(_USUAL[role]) != measured) else role
    if role:
        candidate.role = role
        candidate.why.append("by its name")
    elif of_unit:
        candidate.role = of_unit
        candidate.why.append("by its unit")


def _any(pattern: str, words: list[str]) -> bool:
    return any(re.fullmatch(pattern, word) for word in words)


def _find_time(found: list[Candidate]) -> None:
    """Keep as time what rises; without a name, the first that rises evenly."""
    for candidate in found:
        rises = _rises(candidate.values)
        if candidate.role == "t" and not rises:
            candidate.role = ""
            candidate.why.append("named like a time, but does not rise")
    if any(candidate.role == "t" for candidate in found):
        return
    for candidate in found:
        if not candidate.role and _rises(candidate.values, evenly=True):
            candidate.role = "t"
            candidate.why.append("rises evenly")
            return


def _rises(values: Array, *, evenly: bool = False) -> bool:
    steps = np.diff(values[np.isfinite(values)])
    if steps.size == 0 or np.mean(steps > 0) < 0.9:
        return False
    return not evenly or bool(
        np.mean(np.abs(steps - np.median(steps)) < 0.2 * np.median(steps)) > 0.9
    )


def _by_statistics(found: list[Candidate]) -> None:
    """Tell apart what has no name yet."""
    for candidate in found:
        if not candidate.role and np.ptp(_seen(candidate.values)) == 0:
            candidate.why.append(f"is {candidate.values[0]:g} all the time")
            candidate.role = "-"
    open_ = [candidate for candidate in found if not candidate.role]
    y = next((c for c in found if c.role == "y" and not c.estimated), None)
    if y is None:
        y = _position(open_)
    if y is None:
        return
    ours = [c for c in open_ if c is not y and c.values.shape == y.values.shape]
    for candidate in ours:
        _beside(candidate, y)
    if not any(c.role in ("u", "i") and not c.estimated for c in found):
        _current(ours, y)


def _position(open_: list[Candidate]) -> Candidate | None:
    """Find the channel whose difference another one is; else the noisiest for its size."""
    pairs = [
        (abs(_correlation(np.diff(a.values), b.values[1:])), a, b)
        for a in open_
        for b in open_
        if a is not b and a.values.shape == b.values.shape
    ]
    if pairs:
        best, y, v = max(pairs, key=lambda pair: pair[0])
        if best > 0.7:
            y.role, v.role = "y", "v"
            y.why.append(f"{v.label} is its difference (correlation {best:.2f})")
            v.why.append(f"difference of {y.label} (correlation {best:.2f})")
            return y
    moving = [c for c in open_ if np.ptp(_seen(c.values)) > 0]
    followed = [y for y in moving if any(_is_reference(r, y) for r in moving if r is not y)]
    rough = [c for c in moving if noise(c.values) > 1e-4 * float(np.nanstd(c.values))]
    for choice, why in (
        (followed, "follows another channel that has no noise: a position and its reference"),
        (rough, "the first channel with noise that moves: a mere guess"),
    ):
        if choice:
            choice[0].role = "y"
            choice[0].why.append(why)
            return choice[0]
    return None


def _is_reference(candidate: Candidate, y: Candidate) -> bool:
    """Whether a channel goes with the position, at its size, without its noise."""
    if candidate.values.shape != y.values.shape:
        return False
    size = np.nanstd(candidate.values) / max(float(np.nanstd(y.values)), 1e-300)
    if not 0.5 < size < 2 or _correlation(candidate.values, y.values) < 0.9:
        return False
    few = np.unique(_seen(candidate.values)).size < 0.01 * _seen(candidate.values).size
    return few or noise(candidate.values) < 0.1 * noise(y.values)


def _beside(candidate: Candidate, y: Candidate) -> None:
    """See whether a channel is a reference, or an estimate of the position."""
    if candidate.role:
        return
    likeness = _correlation(candidate.values, y.values)
    close = np.nanmedian(np.abs(candidate.values - y.values))
    if _is_reference(candidate, y):
        candidate.role = "r"
        candidate.why.append(f"follows {y.label} without its noise (correlation {likeness:.3f})")
    elif likeness > 0.9 and close < 3 * noise(y.values):
        candidate.role, candidate.estimated = "y", True
        candidate.why.append(f"lies within the noise of {y.label}: an estimate or a copy of it")


def _current(ours: list[Candidate], y: Candidate) -> None:
    """Find the channel that mirrors the position best: at rest i = -(k_s / k_i) x."""
    free = [c for c in ours if not c.role]
    if not free:
        return
    rated = [
        (abs(_correlation(_slow(c.values), _slow(y.values))), n, c) for n, c in enumerate(free)
    ]
    best, _, chosen = max(rated, key=lambda each: (round(each[0], 2), -each[1]))
    if best > 0.3:
        chosen.role = "i"
        chosen.why.append(f"goes with {y.label} as a coil current does (correlation {best:.2f})")


def _seen(values: Array) -> Array:
    there = values[np.isfinite(values)][:LOOKED_AT]
    return there if there.size else np.zeros(1)


def _slow(values: Array) -> Array:
    """Return means of 20 samples each, which are hardly noise any more."""
    size = values.size // 20 * 20
    return values[:size].reshape(-1, 20).mean(axis=1) if size >= 400 else values


def _correlation(a: Array, b: Array) -> float:
    """Correlation without the first tenth, where a rig is often still starting; 0 if undefined."""
    first = a.size // 10
    a, b = a[first : first + LOOKED_AT], b[first : first + LOOKED_AT]
    there = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(there) < 3:
        return 0.0
    a, b = a[there] - a[there].mean(), b[there] - b[there].mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0


# Writing it down


def _toml(name: str, log: Log, array: str, found: list[Candidate]) -> Iterator[str]:
    yield f"# Proposed by 'ambkit read --guess' for {name}. Look at each line before you trust it."
    yield "# Of each number in the log: value = sign * scale * number * unit + offset."
    for remark in log.remarks:
        yield f"# {remark[:1].upper()}{remark[1:]}."
    if array:
        yield f"array = {_quoted(array)}"
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
            yield f"column = {_quoted(own)}"
            yield 'unit = "s"'
            yield ""
        yield f"[signals.{role}]"
        yield from _where(candidate)
        yield from _meaning(role, candidate, y, u)
        if own and own != clock:
            yield f"time = {_quoted(clocks[own])}"
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
        low, high = _seen(candidate.values).min(), _seen(candidate.values).max()
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
        yield from ("[signals.t]", f"column = {_quoted(clock)}", 'unit = "s"')
        return
    unit, why = candidate.unit, ""
    if not unit:
        step = float(np.median(np.diff(_seen(candidate.values))))
        unit = "s" if step < 0.1 else "ms" if step < 50 else "µs"
        why = "  # guessed from its steps"
    seconds = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}.get(unit, 1.0)
    yield f"# {candidate.label}: {', '.join(candidate.why)}; {_rate(candidate.values * seconds)}."
    yield "[signals.t]"
    yield from _where(candidate)
    yield f"unit = {_quoted(unit)}{why}"


def _rate(times: Array) -> str:
    there = times[np.isfinite(times)]
    return examine("t", there).in_words() if there.size > 1 else "one sample"


def _comment(candidate: Candidate) -> Iterator[str]:
    seen = _seen(candidate.values)
    unit = f" {candidate.unit}" if candidate.unit else ""
    about = f"{seen.min():.4g} to {seen.max():.4g}{unit}, noise {noise(candidate.values):.2g}{unit}"
    yield f"# {candidate.label}: {', '.join(candidate.why) or 'by elimination'}; {about}."


def _where(candidate: Candidate) -> Iterator[str]:
    for key, value in candidate.where.items():
        yield f"{key} = {value if isinstance(value, int) else _quoted(value)}"


def _meaning(
    role: str, candidate: Candidate, y: Candidate | None, u: Candidate | None
) -> Iterator[str]:
    """Write unit, scale, sign and, as a hint, the offset of a channel."""
    unit, said = candidate.unit, ""
    if not unit:
        unit = _likely_unit(candidate)
        said = "  # guessed from its size"
    yield f"unit = {_quoted(unit)}{said}"
    of_current = role == "u" and si_unit(unit) == "A"
    if of_current:
        yield 'scale = "1 V/A"  # the current stands for the control signal: amplifier gain 1 A/V'
    elif role == "u" and si_unit(unit) == "1":
        yield 'scale = "1 V"  # volts at full duty'
    turned = y is not None and u is not None and y.values.shape == u.values.shape
    slope = _correlation(_slow(u.values), _slow(y.values)) if turned and y and u else 0.0
    if slope > 0.3 and role in ("y", "r", "x_logged", "velocity", "v_logged"):
        yield "sign = -1  # u grows with it; of an unstable plant it must fall (or turn u)"
    middle = float(np.median(_seen(candidate.values)))
    if role in ("y", "r", "x_logged") and y is not None:
        middle = float(np.median(_seen(y.values)))
        away = middle if slope > 0.3 else -middle
        yield f'# offset = "{away:.4g} {unit}"  # if x = 0 is at its median'
    elif of_current:
        yield f'# offset = "{-middle:.4g} V"  # if its median is the bias current'
    if role in ("y", "u"):
        yield '# delay = "0 ms"  # how late the logger wrote it'


def _likely_unit(candidate: Candidate) -> str:
    size = float(np.percentile(np.abs(_seen(candidate.values)), 90))
    match candidate.role:
        case "y" | "r":
            return "m" if size < 0.05 else "mm" if size < 50 else "µm"
        case "v":
            return "m/s" if size < 5 else "mm/s"
        case "i":
            return "A" if size < 100 else "mA"
        case "u":
            return "1" if size <= 1.0 and _seen(candidate.values).min() >= 0 else "V"
    return "1"


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
