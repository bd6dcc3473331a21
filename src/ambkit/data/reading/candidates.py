"""What each channel of a log may be: by names and units where it has them, else by statistics.

What a magnetic bearing's log holds is known: a time that rises evenly; a position; its velocity,
which is the position's difference; a reference, which follows the position without its noise; a
current or control signal, which mirrors the position, since the plant is unstable. So even an array
without one name can be told apart. A guess stays a guess: each role comes with its reasons.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import RecordError
from ambkit.data.files import timestamps
from ambkit.data.files.log import Log
from ambkit.data.reading.faults import noise
from ambkit.data.signals import si_unit

Array = NDArray[np.float64]

COMPARED = 60
"""Channels without a name that are compared, each with each."""

ALIKE = 6
"""Decimal places of a correlation that tell one pair of channels from another."""

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
_TEXT = "times as text"
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
    estimated : bool
        Whether it is an estimate of the rig's own.
    damage : RecordError, optional
        Why times as text cannot be read.
    """

    label: str
    where: dict[str, str | int]
    values: Array
    unit: str = ""
    clock: str = ""
    role: str = ""
    why: list[str] = field(default_factory=list)
    estimated: bool = False
    damage: RecordError | None = None


def candidates(log: Log) -> tuple[str, list[Candidate]]:
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
    plain = [
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
    return "", [*plain, *_stamps(log, key)]


def _stamps(log: Log, key: str) -> Iterator[Candidate]:
    """Yield the columns that are times as text; with their format where it cannot be told."""
    for name, cells in log.texts.items():
        try:
            moments = timestamps.read(cells, "", name, log.place, lenient=True)
        except RecordError as error:
            nothing = np.full(len(cells), np.nan)
            why = [_TEXT, error.problems[0]]
            yield Candidate(name, {key: name}, nothing, "s", role="-", why=why, damage=error)
            continue
        where: dict[str, str | int] = {key: name}
        why = [_TEXT, *moments.remarks[1:]]
        if not moments.certain:
            where["format"] = moments.layout
            why.append("which is the day and which the month is a mere guess")
        yield Candidate(name, where, moments.seconds, "s", role="t", why=why)


def find_roles(found: list[Candidate]) -> None:
    """Give each candidate the role that its name, its unit or its samples speak for."""
    for candidate in found:
        candidate.values = np.where(np.isfinite(candidate.values), candidate.values, np.nan)
        _by_name(candidate)
    _find_time(found)
    _by_statistics(found)


def _by_name(candidate: Candidate) -> None:
    """Read role and unit from the name."""
    if candidate.role or not isinstance(next(iter(candidate.where.values())), str):
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
        rising = _rises(candidate.values)
        if candidate.role == "t" and not rising:
            text = candidate.why[0] == _TEXT
            candidate.role = "-" if text else ""  # no position either
            candidate.why.append(f"{'' if text else 'named like a time, but '}does not rise")
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
        if not candidate.role and np.ptp(seen(candidate.values)) == 0:
            candidate.why.append(f"is {candidate.values[0]:g} all the time")
            candidate.role = "-"
    open_ = [candidate for candidate in found if not candidate.role]
    y = next((c for c in found if c.role == "y" and not c.estimated), None)
    if y is None:
        y = _position(open_[:COMPARED])
        if y is not None and len(open_) > COMPARED:
            y.why.append(f"only the first {COMPARED} of {len(open_)} such channels were compared")
    if y is None:
        return
    ours = [c for c in open_ if c is not y and c.values.shape == y.values.shape]
    size = _size(y)
    for candidate in ours:
        _beside(candidate, y, size)
    if not any(c.role in ("u", "i") and not c.estimated for c in found):
        _current(ours, y)


def _position(open_: list[Candidate]) -> Candidate | None:
    """Find the channel whose difference another one is; else the noisiest for its size."""
    pairs = [
        (abs(correlation(np.diff(a.values), b.values[1:])), a, b)
        for a in open_
        for b in open_
        if a is not b and a.values.shape == b.values.shape
    ]
    if pairs:
        # A rig's estimates often come in pairs that fit as well: of equals the first, whatever the
        # order in which a sum was rounded.
        best, y, v = max(pairs, key=lambda pair: round(pair[0], ALIKE))
        if best > 0.7:
            y.role, v.role = "y", "v"
            y.why.append(f"{v.label} is its difference (correlation {best:.2f})")
            v.why.append(f"difference of {y.label} (correlation {best:.2f})")
            return y
    moving = [c for c in open_ if np.ptp(seen(c.values)) > 0]
    sizes = {id(c): _size(c) for c in moving}
    followed = [
        y for y in moving if any(_is_reference(r, y, sizes[id(y)]) for r in moving if r is not y)
    ]
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


def _size(y: Candidate) -> tuple[float, float]:
    """Return how much a channel moves, and its noise."""
    there = y.values[np.isfinite(y.values)]
    return max(float(there.std()) if there.size else 0.0, 1e-300), noise(y.values)


def _is_reference(candidate: Candidate, y: Candidate, size: tuple[float, float]) -> bool:
    """Whether a channel goes with the position, at its size (`_size`), without its noise."""
    if candidate.values.shape != y.values.shape:
        return False
    if (
        not 0.5 < np.nanstd(candidate.values) / size[0] < 2
        or correlation(candidate.values, y.values) < 0.9
    ):
        return False
    few = np.unique(seen(candidate.values)).size < 0.01 * seen(candidate.values).size
    return few or noise(candidate.values) < 0.1 * size[1]


def _beside(candidate: Candidate, y: Candidate, size: tuple[float, float]) -> None:
    """See whether a channel is a reference, or an estimate of the position."""
    if candidate.role:
        return
    likeness = correlation(candidate.values, y.values)
    if likeness < 0.9:
        return
    if _is_reference(candidate, y, size):
        candidate.role = "r"
        candidate.why.append(f"follows {y.label} without its noise (correlation {likeness:.3f})")
    elif np.nanmedian(np.abs(candidate.values - y.values)) < 3 * size[1]:
        candidate.role, candidate.estimated = "y", True
        candidate.why.append(f"lies within the noise of {y.label}: an estimate or a copy of it")


def _current(ours: list[Candidate], y: Candidate) -> None:
    """Find the channel that mirrors the position best: at rest i = -(k_s / k_i) x."""
    free = [c for c in ours if not c.role]
    if not free:
        return
    rated = [(abs(correlation(slow(c.values), slow(y.values))), n, c) for n, c in enumerate(free)]
    best, _, chosen = max(rated, key=lambda each: (round(each[0], 2), -each[1]))
    if best > 0.3:
        chosen.role = "i"
        chosen.why.append(f"goes with {y.label} as a coil current does (correlation {best:.2f})")


def seen(values: Array) -> Array:
    """Return the finite samples (n,), at most `LOOKED_AT` of them; a zero if there is none."""
    there = values[np.isfinite(values)][:LOOKED_AT]
    return there if there.size else np.zeros(1)


def slow(values: Array) -> Array:
    """Return means of 20 samples each, which are hardly noise any more."""
    size = values.size // 20 * 20
    return values[:size].reshape(-1, 20).mean(axis=1) if size >= 400 else values


def correlation(a: Array, b: Array) -> float:
    """Correlation without the first tenth, where a rig is often still starting; 0 if undefined."""
    first = a.size // 10
    a, b = a[first : first + LOOKED_AT], b[first : first + LOOKED_AT]
    there = np.isfinite(a) & np.isfinite(b)
    if np.count_nonzero(there) < 3:
        return 0.0
    a, b = a[there] - a[there].mean(), b[there] - b[there].mean()
    scale = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / scale if scale > 0 else 0.0
