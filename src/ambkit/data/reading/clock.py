"""Clock of a log: rate, jitter, gaps, jumps."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ambkit.base.arrays import Array, Bools, Index
from ambkit.base.units import engineering
from ambkit.data.record import TIME_TOLERANCE

AROUND = 5  #: Samples on each side that distinguish a gap from a late time stamp.
ROUNDED = 5  #: Minimum number of steps that are longer by a digit for stamps to count as rounded.


@dataclass(frozen=True, eq=False)
class Clock:
    """Quality of the times of n samples."""

    name: str  #: Name of the signal with the times.
    times: Array  #: (n,) The times [s] as logged.
    step: float  #: Typical time between two samples [s], over the complete log: see `examine`.
    jitter: float  #: Standard deviation of the steps [s], without gaps and jumps.
    uneven: Index  #: Samples after a step that is off by more than 1 %, neither gap nor jump.
    gaps: Index  #: (g,) Samples before which others are missing.
    missing: Index  #: (g,) Number of missing samples of each gap.
    jumps: Index  #: Samples at which it goes back, repeats, or leaps by the log's length.

    @property
    def rate(self) -> float:
        """Sampling rate [Hz]."""
        return 1.0 / self.step

    @property
    def segments(self) -> list[slice]:
        """The parts between jumps, of at least two samples."""
        ends = [0, *self.jumps.tolist(), self.times.size]
        return [slice(a, b) for a, b in pairwise(ends) if b - a > 1]

    def part(self, where: slice) -> Clock:
        """Return the clock of some of the samples."""
        return examine(self.name, self.times[where])

    @property
    def whole_gaps(self) -> bool:
        """Whether each gap is a whole number of steps, so that missing samples have a place."""
        steps = np.diff(self.times)[self.gaps - 1] / self.step
        return bool((np.abs(steps / (self.missing + 1) - 1) <= TIME_TOLERANCE).all())

    @property
    def too_coarse(self) -> bool:
        """Whether times have so few digits that many samples share theirs."""
        still = np.count_nonzero(np.diff(self.times) == 0)
        return bool(still > 0.1 * self.times.size)

    def to_dict(self) -> dict[str, float]:
        """Return its figures as plain data."""
        return {
            "samples": self.times.size,
            "rate": self.rate,
            "jitter": self.jitter,
            "gaps": self.gaps.size,
            "missing": int(self.missing.sum()),
            "jumps": self.jumps.size,
            "uneven": self.uneven.size,
        }

    def describe(self) -> str:
        """Describe the quality of the clock in one line."""
        words = [f"{self.times.size} samples at {engineering(self.rate, 'Hz', digits=5)}"]
        if self.jitter > 1e-6 * self.step:
            words.append(f"jitter {engineering(self.jitter, 's', digits=2)} rms")
        for count, what in ((self.gaps.size, "gap"), (self.jumps.size, "jump")):
            if count:
                words.append(f"{count} {what}{'s' if count > 1 else ''}")
        return ", ".join(words)


def examine(name: str, times: Array) -> Clock:
    """Examine a clock."""
    # Its step is the elapsed time over the number of steps. Jitter and rounding of single stamps
    # have no effect; missing samples are counted, and jumps excluded. times (n,) [s]
    steps = np.diff(times)
    none = np.array([], dtype=np.intp)
    forward = steps if steps.min() > 0 else steps[steps > 0]
    if forward.size == 0:
        return Clock(name, times, np.inf, 0.0, none, none, none, np.arange(1, times.size))
    median = float(np.median(forward))
    usual = np.abs(steps - median) <= TIME_TOLERANCE * median
    if usual.all():  # the usual case, fast for a long log
        return Clock(name, times, float(steps.mean()), float(steps.std()), none, none, none, none)
    span = min(float(forward.sum()), times.size * median)
    jump = (steps <= 0) | ((steps > 10 * median) & (steps > span))
    counts = _rounded_counts(times, steps, jump)
    if counts is None:
        counts = _counts(times, steps, jump, median)
    step = float(steps[~jump].sum()) / int(counts[~jump].sum())
    gap = (counts > 1) & ~jump
    within = steps[~(jump | gap)]
    return Clock(
        name,
        times,
        step,
        float(within.std()) if within.size else 0.0,
        np.flatnonzero((np.abs(steps / step - 1) > TIME_TOLERANCE) & ~(jump | gap)) + 1,
        np.flatnonzero(gap) + 1,
        counts[gap] - 1,
        np.flatnonzero(jump) + 1,
    )


def _counts(times: Array, steps: Array, jump: Bools, step: float) -> Index:
    """Return the number of steps of each interval; `step` [s] is an initial guess."""
    counts = np.ones(steps.size, dtype=np.intp)
    for _ in range(8):
        before = counts
        counts = np.where(jump, 1, np.maximum(1, np.rint(steps / step))).astype(np.intp)
        _doubt(times, steps / step, counts, jump, step)
        if (counts == before).all():
            break
        step = float(steps[~jump].sum()) / int(counts[~jump].sum())
    return counts


def _doubt(times: Array, ratio: Array, counts: Index, jump: Bools, step: float) -> None:
    """Remove gaps that are late stamps: behind a true gap the samples stay late."""
    odd = jump | (counts > 1)
    vague = (counts > 1) & ~jump & (np.abs(ratio / counts - 1) > TIME_TOLERANCE)
    at = np.flatnonzero(vague) + 1  # samples behind the gaps
    at = at[(at >= AROUND) & (at <= times.size - AROUND)]
    passed = np.concatenate([[0], np.cumsum(odd)])
    isolated = passed[at + AROUND - 1] - passed[at - AROUND] == 1
    at = at[isolated]
    near = np.arange(AROUND)
    before = np.median(times[at[:, None] - 1 - near] + step * near, axis=1)
    after = np.median(times[at[:, None] + near] - step * near, axis=1)
    counts[at - 1] = np.maximum(1, np.rint((after - before) / step))


def _rounded_counts(times: Array, steps: Array, jump: Bools) -> Index | None:
    """Count the steps of a clock with rounded stamps; None if it has enough digits."""
    # Rounded to q, a step T is logged as the multiple of q below or above it: 1.3 ms as 1 ms and 2
    # ms. No sample is missing if all stamps are within q of an even row.
    sound = np.where(jump, np.nan, steps)
    ladder = np.rint(1e3 * sound / np.nanmedian(sound))
    seen, often = np.unique(ladder[~jump], return_counts=True)
    if seen.size < 2 or np.sort(often)[-2] < ROUNDED:
        return None
    least, most = np.sort(seen[np.argsort(often)[-2:]])
    short, long = ladder == least, ladder == most
    usual = short | long
    low, digit = float(steps[short].mean()), float(steps[long].mean() - steps[short].mean())
    if np.mean(usual[~jump]) < 0.9 or abs(low / digit - round(low / digit)) > 0.01:
        return None
    if abs(low / digit - 1) < 0.01 and np.unique(np.diff(np.flatnonzero(long))).size == 1:
        return None  # at even distances: rather every tenth sample is missing
    ends = [0, *(np.flatnonzero(~usual) + 1).tolist(), times.size]
    pieces = [times[a:b] - times[a:b].mean() for a, b in pairwise(ends)]
    rows = [np.arange(piece.size) - 0.5 * (piece.size - 1) for piece in pieces]
    products = sum(float(row @ piece) for row, piece in zip(rows, pieces, strict=True))
    step = products / sum(float(row @ row) for row in rows)  # of straight lines, least squares
    off = max(float(np.ptp(item - step * row)) for row, item in zip(rows, pieces, strict=True))
    if off > 1.1 * digit:
        return None
    counts: Index = np.where(usual | jump, 1, np.maximum(1, np.rint(steps / step))).astype(np.intp)
    return counts


def instant(time: float, step: float) -> str:
    """Format a time [s] with enough digits to distinguish samples a step [s] apart."""
    if not (0 < step < np.inf) or time == 0.0 or not np.isfinite(time):
        return engineering(time, "s")
    digits = max(4, int(np.log10(max(1.0, abs(time) / step))) + 2)
    return engineering(time, "s", digits=digits) if abs(time) < 1e4 else f"{time:.{digits}g} s"


HELD = ("u",)  #: Signals that the controller holds between samples.


def insert_missing(clock: Clock) -> tuple[Array, Index]:
    """Insert the missing samples of a clock without jumps."""
    # times (n,) [s]
    if clock.gaps.size == 0:
        return clock.times, np.arange(clock.times.size)
    skipped = np.zeros(clock.times.size, dtype=np.intp)
    skipped[clock.gaps] = clock.missing
    place = np.arange(clock.times.size) + np.cumsum(skipped)
    times = np.interp(np.arange(place[-1] + 1), place, clock.times)
    times[place] = clock.times
    return times, place


def spread(values: Array, place: Index, size: int) -> Array:
    """Put samples (n,) into their places of a longer row; NaN elsewhere."""
    if size == values.size:
        return values
    row = np.full(size, np.nan)
    row[place] = values
    return row


def even_grid(clock: Clock, step: float) -> Array:
    """Return times every `step` [s] from the clock's first sample to its last."""
    first, last = clock.times[0], clock.times[-1]
    count = math.floor((last - first) / step + 1e-6) + 1
    times: Array = first + step * np.arange(count)
    return times


def resample(values: Array, clock: Clock, times: Array, *, held: bool) -> Array:
    """Resample a signal."""
    # Interpolated linearly, or the last sample if it is `held`. There is no low-pass: the result is
    # that of a sampler with the new rate. values (n,); times (m,) [s]; returns (m,)
    own = clock.times
    slack = 1e-6 * clock.step  # tolerance for rounded times at both ends
    left = np.clip(np.searchsorted(own, times + slack, side="right") - 1, 0, own.size - 2)
    width = own[left + 1] - own[left]
    part = (times - own[left]) / width
    part[np.abs(part) < 1e-6] = 0.0
    part[np.abs(part - 1) < 1e-6] = 1.0
    before, after = values[left], values[left + 1]
    if held:
        result = np.where(part >= 1.0, after, before)
        outside = (part < 0) | (part >= 2)
    else:
        result = (1 - part) * before + part * after
        result = np.where(part == 0.0, before, np.where(part == 1.0, after, result))
        outside = (part < 0) | (part > 1)
    gap = np.zeros(own.size, dtype=bool)
    gap[clock.gaps] = True
    within_gap = gap[left + 1] & (part > 0) & (part < 1)
    result[outside | within_gap] = np.nan
    return result


def fraction_weights(fraction: float, *, held: bool) -> dict[int, float]:
    """Return the weights of the neighbours for a signal between two samples."""
    # A sampled signal is interpolated by the cubic through four samples (Lagrange); a held one is
    # averaged over the sample, as by the plant.
    f = fraction
    if f == 0.0:
        return {0: 1.0}
    if held:
        return {0: 1 - f, 1: f}
    return {
        -1: -f * (f - 1) * (f - 2) / 6,
        0: (f + 1) * (f - 1) * (f - 2) / 2,
        1: -(f + 1) * f * (f - 2) / 2,
        2: (f + 1) * f * (f - 1) / 6,
    }


def shifted(values: Array, samples: float, *, held: bool) -> Array:
    """Remove a delay from a signal: the value at k + `samples` moves to k."""
    # values (n,); returns (n,)
    integer_part, fraction = split(samples)
    result: Array = np.zeros(values.size)
    for neighbour, weight in fraction_weights(fraction, held=held).items():
        result += weight * _moved(values, integer_part + neighbour)
    return result


def split(samples: float) -> tuple[int, float]:
    """Split a delay into whole samples and the rest, from 0 to 1."""
    integer_part = round(samples)
    if abs(samples - integer_part) < 1e-6:
        return integer_part, 0.0
    integer_part = math.floor(samples)
    return integer_part, samples - integer_part


def _moved(values: Array, count: int) -> Array:
    """Return the signal `count` samples earlier, NaN at the end."""
    row = np.full(values.size, np.nan)
    if abs(count) < values.size:
        row[max(0, -count) : values.size - max(0, count)] = values[
            max(0, count) : values.size + min(0, count)
        ]
    return row


def describe_shift(name: str, delay: float, step: float) -> str:
    """Describe the removal of a delay from a signal."""
    sample_count, fraction = split(delay / step)
    held = name in HELD
    samples = "1 sample" if sample_count == 1 else f"{sample_count} samples"
    text = f"{name} was logged {engineering(delay, 's')} late: shifted by {samples}"
    if fraction:
        power = sum(weight**2 for weight in fraction_weights(fraction, held=held).values())
        how = "averaged, as it is held" if held else "a cubic through four samples"
        text += (
            f" and {fraction:.3g} of one ({how}; white noise keeps {100 * power:.0f} % of its "
            "variance)"
        )
    return f"{text}; the ends are missing"


_OF = r"(?:(?:de|di|d.) ?)?(?:[ée]chantillonnage|muestreo|amostragem|campionamento|pr[óo]bkowania)"
_HERTZ = (
    r"f[_ ]?s|f_?(?:sample|abtast)|rate|(?:sampl\w*|scan|abtast)[ _]?(?:rate|freq\w*)|"
    rf"(?:fr\w+|cz\w+|taxa) {_OF}|采样(?:率|频率)|サンプリング周波数"
)
_STEP = (
    r"d[_ ]?t|t[_ ]?s|(?:sampl\w*|abtast|delta)[ _]?(?:[tx]|time|int|period|zeit)\w*|"
    rf"(?:p\w+|te?m\w+|okres) {_OF}|采样(?:周期|时间)|サンプリング周期"
)
_STATED = re.compile(
    rf"(?i)\b(?:(?P<rate>{_HERTZ})|{_STEP})(?![^\W_])(?:[ _[(]*(?P<before>k?hz|[mµu]?s)\b)?"
    r"[^\w\n.+-]{1,4}(?P<value>\d*\.?\d+(?:e[+-]?\d+)?)"
    r"(?!\d|/\w)[\]) ,]*(?P<unit>[km]?(?:hz|s/s)|[mkµu]?s\b)?"
)
"""A sampling rate, or time, in a line above the numbers."""


def stated_step(head: str) -> Iterator[str]:
    """Write the sampling time that the head of a log states, or what to fill in."""
    stated = _STATED.search(head)
    if stated is None or not float(stated["value"]) > 0:
        yield "# No channel looks like a time: fill in the sampling time."
        yield '# sampling_time = "... ms"'
        return
    value, unit = float(stated["value"]), (stated["unit"] or stated["before"] or "s").lower()
    if stated["rate"]:
        value, unit = 1 / (value * {"k": 1e3, "m": 1e6}.get(unit[0], 1.0)), "s"
    yield f'# No channel looks like a time; by "{stated[0].strip()}" above the numbers:'
    yield f'sampling_time = "{value:.9g} {unit}"'
