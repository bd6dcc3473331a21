"""Defects of a channel: missing, saturated, frozen and coarse samples, spikes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Index, stretches
from ambkit.base.units import engineering
from ambkit.data.reading.clock import Clock, instant
from ambkit.data.reading.spikes import is_valid, spikes, without
from ambkit.data.record import Record
from ambkit.result.row import Row, put

KINDS = (
    *("gap", "jump", "jitter", "missing", "infinite"),
    *("constant", "spike", "saturated", "frozen", "quantised"),
)
"""Kinds of defects, the clock's first."""

MASKABLE = ("saturated", "frozen", "spike")  #: Kinds that can be treated as missing.
STILL = 10  #: Minimum number of equal samples of a frozen sensor, as in the core's filters.
CLIPPED = 3  #: Number of equal samples at the maximum or minimum that counts as saturation.
BY_CHANCE = 1e-6  #: Probability that a sound record contains a frozen stretch.

LOOKED_AT = 200_000  # samples for the resolution
BLOCK = 200  # samples in which different values are counted


@dataclass(frozen=True)
class Fault:
    """A defect over some time."""

    kind: str  #: One of `KINDS`.
    signal: str  #: Channel, or clock.
    start: float  #: Start and end [s], by the record's clock: delays are compensated.
    stop: float
    samples: int  #: Number of samples.
    text: str  #: Description.
    action: str = "kept"  #: Action taken.


def account(faults: Iterable[Fault], step: float) -> list[str]:
    """Summarise defects and actions in sentences, grouped by kind."""
    groups: dict[tuple[str, str, str], list[Fault]] = {}
    for fault in faults:
        groups.setdefault((fault.signal, fault.kind, fault.action), []).append(fault)
    lines = []
    for (signal, kind, action), group in groups.items():
        first = group[0]
        start = instant(first.start, step)
        count = f"{first.samples} sample{'s' if first.samples != 1 else ''}"
        if kind in ("constant", "quantised", "jitter"):
            lines.append(f"{signal}: {first.text}; {action}")
        elif len(group) == 1:
            stop = f" to {instant(first.stop, step)}" if first.stop > first.start else ""
            span = f"{count} {'from' if stop else 'at'} {start}{stop}"
            lines.append(f"{signal}: {span}: {first.text}; {action}")
        else:
            samples = sum(fault.samples for fault in group)
            lines.append(
                f"{signal}: {kind} in {len(group)} stretches, {samples} samples, the first at "
                f"{start}; {action}"
            )
    return lines


@dataclass(frozen=True)
class Channel:
    """Summary of a channel, in SI."""

    name: str  #: Signal and its unit.
    unit: str
    samples: int  #: Number of samples, and of missing ones.
    missing: int
    least: float  #: Over the available samples.
    greatest: float
    mean: float
    noise: float  #: Standard deviation of noise on a slow signal, by second differences.
    resolution: float  #: Smallest step between values; 0 if there is no visible one.
    clock: str  #: Name of its clock.
    delay: float = 0.0  #: Logging delay [s]; the record has it compensated.

    def rows(self) -> list[Row]:
        """Return it as rows."""
        return put([
            Row("least", "minimum", self.least, self.unit),
            Row("maximum", "maximum", self.greatest, self.unit),
            Row("mean", "mean", self.mean, self.unit),
            Row("noise", "noise rms", self.noise, self.unit, 3),
            Row("resolution", "resolution", self.resolution or None, self.unit, 3),
            Row("missing", "missing", self.missing or None),
        ], section=("channels",))  # fmt: skip


def measure(name: str, unit: str, values: Array, clock: str = "t") -> Channel:
    """Summarise a channel (n,)."""
    there = values[np.isfinite(values)]
    missing = values.size - there.size
    if there.size == 0:
        nan = math.nan
        return Channel(name, unit, values.size, missing, nan, nan, nan, nan, 0.0, clock)
    ends = float(there.min()), float(there.max()), float(there.mean())
    return Channel(name, unit, values.size, missing, *ends, noise(values), resolution(there), clock)


def noise(values: Array) -> float:
    """Return the standard deviation of white noise on a slow signal (n,)."""
    # Second differences of white noise have six times its variance; the median is robust against
    # steps and spikes. If most of them are zero, as for a coarse signal, their mean square is used;
    # if nearly all are, as for a reference of steps, there is no noise.
    bend = np.diff(values[:LOOKED_AT], 2)
    bend = np.abs(bend[np.isfinite(bend)])
    if bend.size == 0:
        return math.nan
    if np.count_nonzero(bend) < 0.05 * bend.size:
        return 0.0
    spread = 1.4826 * float(np.median(bend)) or float(np.sqrt(np.mean(bend**2)))
    return spread / math.sqrt(6)


def resolution(values: Array) -> float:
    """Return the smallest step between the values of a signal (n,); 0 if there is none."""
    # A signal has steps if its values repeat, or are multiples of one step.
    seen = np.unique(_some(values))
    if seen.size < 2:
        return 0.0
    steps = np.diff(seen)
    with np.errstate(over="ignore"):  # a step between the extremes of float64 is infinite
        steps = steps[steps > 1e-9 * (seen[-1] - seen[0])]  # rounding of one value
    if steps.size == 0:
        return 0.0
    least = float(steps.min())
    off = np.abs(steps / least - np.rint(steps / least))
    if np.mean(off < 0.02) > 0.99:
        return least
    few = seen.size < 0.2 * min(values.size, LOOKED_AT)
    return float(np.median(steps)) if few and values.size >= 100 else 0.0


def _some(values: Array) -> Array:
    """Return at most `LOOKED_AT` samples, in four stretches."""
    if values.size <= LOOKED_AT:
        return values
    size = LOOKED_AT // 4
    starts = np.linspace(0, values.size - size, 4).astype(int)
    return np.concatenate([values[start : start + size] for start in starts])


def clock_faults(clock: Clock) -> list[Fault]:
    """Convert defects of a clock; the action is not known yet."""
    t, result = clock.times, []
    for at, count in zip(clock.gaps.tolist(), clock.missing.tolist(), strict=True):
        text = f"{count} sample{'s' if count > 1 else ''} missing"
        result.append(Fault("gap", clock.name, float(t[at - 1]), float(t[at]), count, text))
    for at in clock.jumps.tolist():
        text = f"from {instant(t[at - 1], clock.step)} to {instant(t[at], clock.step)}"
        result.append(Fault("jump", clock.name, float(t[at - 1]), float(t[at]), 1, text))
    if clock.uneven.size:
        text = (
            f"{clock.uneven.size} steps are off by more than 1 %, "
            f"{engineering(clock.jitter, 's', digits=2)} rms"
        )
        ends = float(t[0]), float(t[-1])
        result.append(Fault("jitter", clock.name, *ends, clock.uneven.size, text))
    return result


def find(name: str, logged: Array, times: Array, unit: str) -> Iterator[Fault]:
    """Find the defects of a channel."""
    # A run of equal samples counts as frozen, or as saturated at the maximum or minimum, if chance
    # does not explain it: a coarse signal repeats itself, and the frequency of repeats is measured
    # on the channel itself. A channel that hardly ever changes, such as a reference, is not
    # suspected. Spikes are reported for measured signals, see `ambkit.data.reading.spikes`, and
    # excluded from the other tests. logged (n,); times (n,) [s]
    for kind, absent in (("missing", np.isnan(logged)), ("infinite", np.isinf(logged))):
        if absent.any():
            text = "not logged" if kind == "missing" else "infinite values"
            for start, end in stretches(absent):
                first, last = float(times[start]), float(times[end - 1])
                yield Fault(kind, name, first, last, end - start, text)
    values = np.where(np.isinf(logged), np.nan, logged)
    place = np.flatnonzero(np.isfinite(values))
    there = values[place]
    if there.size == 0 or name == "r":  # a reference has no sensor
        return
    if name != "u":
        result = spikes(there, noise(there), resolution(there))
        for start, length in zip(*(item.tolist() for item in result), strict=True):
            yield _spike(name, there, times[place], unit, start, length)
        there = without(there, *result)
        values = values.copy()
        values[place] = there
    least, max_value = float(there.min()), float(there.max())
    if least == max_value:
        text = f"the same in all {there.size} samples: {engineering(least, unit)}"
        yield Fault("constant", name, float(times[0]), float(times[-1]), there.size, text)
        return
    coarse = list(_coarse(name, there, times, unit))
    yield from coarse
    for fault in _still(name, values, times, unit, (least, max_value)):
        # A coarse sensor near the middle of a step repeats for long without being frozen.
        inside = any(item.start <= fault.start <= item.stop for item in coarse)
        if not inside or fault.samples > BLOCK:
            yield fault


def _spike(name: str, there: Array, times: Array, unit: str, start: int, length: int) -> Fault:
    part = there[start : start + length]
    peak = float(part[np.argmax(np.abs(part - np.median(there)))])
    near = [*there[max(0, start - 5) : start], *there[start + length : start + length + 5]]
    usual = engineering(float(np.median(near)), unit, digits=3)
    text = f"{engineering(peak, unit, digits=4)} amid {usual}"
    ends = float(times[start]), float(times[start + length - 1])
    return Fault("spike", name, *ends, length, text)


def _runs(values: NDArray[np.generic]) -> tuple[Index, Index]:
    """Return start and length of each run of equal values; NaN equals nothing."""
    ends = np.flatnonzero(values[1:] != values[:-1]) + 1
    starts = np.concatenate([[0], ends])
    return starts, np.diff(np.concatenate([starts, [values.size]]))


def _coarse(name: str, there: Array, times: Array, unit: str) -> Iterator[Fault]:
    step, rough = resolution(there), noise(there)
    if rough == 0.0:  # it changes now and then: a coarse sensor passes through many steps
        changes = np.diff(there)
        changes = np.abs(changes[changes != 0])
        by_one = float(np.mean(changes < 1.5 * step)) if changes.size else 0.0
        if by_one < 0.9 or np.unique(_some(there)).size < 5:
            return
    if step > 1.5 * rough:
        yield Fault(
            "quantised", name, float(times[0]), float(times[-1]), there.size, _in_steps(step, unit)
        )
    else:
        yield from _coarse_stretches(name, there, times, unit)


def _in_steps(step: float, unit: str) -> str:
    step_text = engineering(step, unit, digits=3)
    return f"in steps of {step_text}, more than its noise: smaller motion is lost"


def _coarse_stretches(name: str, there: Array, times: Array, unit: str) -> Iterator[Fault]:
    """Find blocks with a tenth of the usual number of different values, in spite of motion."""
    count = there.size // BLOCK
    if count < 4 or there.size != times.size:  # with missing samples the blocks have no place
        return
    blocks = np.sort(there[: count * BLOCK].reshape(count, BLOCK), axis=1)
    different = 1 + np.count_nonzero(np.diff(blocks, axis=1), axis=1)
    moves = different > 2
    coarse = moves & (different < 0.1 * np.median(different))
    for start, end in stretches(coarse):
        part = slice(start * BLOCK, end * BLOCK)
        step = resolution(there[part])
        # A long run of one value explains few values: frozen, or saturated.
        still = _runs(there[part])[1].max() > 0.3 * min(there[part].size, BLOCK)
        if step > 1.5 * noise(there[part]) and not still:
            ends = float(times[part][0]), float(times[part][-1])
            yield Fault("quantised", name, *ends, (end - start) * BLOCK, _in_steps(step, unit))


def _still(
    name: str, values: Array, times: Array, unit: str, limits: tuple[float, float]
) -> Iterator[Fault]:
    starts, lengths = _runs(values)
    repeats = _usual_repeats(values)
    if repeats > 0.98:
        # It hardly ever changes. If it is mostly at one end, that is a sensor at its limit.
        at_end = max(float(np.mean(values == limit)) for limit in limits)
        if at_end < 0.5 or np.unique(_some(values)).size < 5:
            return
        repeats = 0.5
    long = np.flatnonzero(lengths > max(CLIPPED - 1, _longest_by_chance(repeats, values.size)))
    for run in long.tolist():
        start, length = int(starts[run]), int(lengths[run])
        near = _repeats_around(lengths, run)
        if length <= _longest_by_chance(near, values.size):
            continue
        value = float(values[start])
        span = float(times[start]), float(times[start + length - 1])
        if value in limits:
            end = "greatest" if value == limits[1] else "least"
            text = f"at its {end} value, {engineering(value, unit, digits=4)}"
            yield Fault("saturated", name, *span, length, text)
        elif length >= STILL:
            text = f"stands still at {engineering(value, unit, digits=4)}"
            yield Fault("frozen", name, *span, length, text)


def _longest_by_chance(repeats: float, samples: int) -> float:
    """Return the longest plausible run of equal samples, if so many repeat the previous one."""
    return math.log(BY_CHANCE / samples) / math.log(repeats) if repeats > 0 else 0.0


def _repeats_around(lengths: Index, run: int) -> float:
    """Return how often a sample repeats the previous one, in the 50 runs on each side."""
    # A signal may be coarser here than elsewhere. The longest tenth of the runs is excluded, so
    # that a sensor that sometimes hangs does not hide it; nor are rates above 0.8 trusted, so that
    # a control signal between its limits is seen.
    around = np.concatenate([lengths[max(0, run - 50) : run], lengths[run + 1 : run + 51]])
    if around.size < 10:
        return 0.0
    trimmed = np.sort(around)[: -(-around.size * 9 // 10)]
    return min(0.8, 1.0 - 1.0 / float(trimmed.mean()))


def _usual_repeats(values: Array) -> float:
    """Return how often a sample equals the previous one, as the median over 101 stretches."""
    # The median, so that a long frozen stretch does not raise it.
    equal = values[1:] == values[:-1]
    parts = np.array_split(equal, min(101, max(1, equal.size // 20)))
    return float(np.median([part.mean() for part in parts]))


def spike_free(record: Record) -> tuple[Record, int]:
    """Return a record with the spikes of its positions missing, and their number."""
    cleaned, count = {name: record[name] for name in record}, 0
    for name in (name for name in record if name == "y" or name.startswith("y_")):
        at = np.flatnonzero(np.isfinite(record[name]))
        there = record[name][at]
        fine = is_valid(there.size, *spikes(there, noise(there), resolution(there)))
        cleaned[name] = record[name].copy()
        cleaned[name][at[~fine]] = np.nan
        count += int(np.count_nonzero(~fine))
    if count == 0:
        return record, 0
    return Record(record.t, cleaned, record.units, record.meta), count


def without_spikes(records: Sequence[Record]) -> tuple[list[Record], str]:
    """Return records without the spikes of their positions, and a remark, if there were any."""
    pairs = [spike_free(record) for record in records]
    total, remark = sum(count for _, count in pairs), ""
    if total == 1:
        remark = "1 isolated outlier of the position is omitted"
    elif total > 1:
        remark = f"{total} isolated outliers of the position are omitted"
    return [cleaned for cleaned, _ in pairs], remark
