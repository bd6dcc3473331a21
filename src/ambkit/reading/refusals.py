"""What keeps a log's samples from lying on one even grid: refused, with places and what helps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ambkit.errors import RecordError, shortened
from ambkit.files.log import Log
from ambkit.reading.clock import Clock, not_finite
from ambkit.units import engineering

if TYPE_CHECKING:
    from ambkit.channelmap import Mapped


def check_times(log: Log, mapped: Mapped, used: list[str]) -> None:
    """Refuse times that are no numbers, each with its line."""
    problems = []
    for name in used:
        times = mapped.clocks[name]
        if times.size < 2:
            problems.append(f"{log.name}: {name} must have at least 2 samples, has {times.size}")
        for at, value in not_finite(times):
            problems.append(f"{log.place(at)}: {name} is {value} at sample {at}")
    if not used:
        problems.append(f"{log.name}: the map names no signal but the time")
    if problems:
        raise RecordError(shortened(problems), log.name)


def segment_of(log: Log, clocks: Mapping[str, Clock], segment: int | None) -> tuple[slice, str]:
    """Return the part between jumps that the user wants, or say which there are."""
    if len(clocks) > 1:
        raise RecordError(f"{log.name}: a log with several clocks cannot be read in parts")
    (clock,) = clocks.values()
    parts = clock.segments
    if segment is not None and 1 <= segment <= len(parts):
        part = parts[segment - 1]
        return part, f"part {segment} of {len(parts)} between jumps of {clock.name} is read"
    t = clock.times
    if clock.too_coarse:
        raise RecordError(
            f"{log.name}: {clock.name} has too few digits: many samples share their time. Give "
            "sampling_time in the map instead"
        )
    listed = [
        f"{log.place(at)}: {clock.name} jumps from {engineering(t[at - 1], 's')} to "
        f"{engineering(t[at], 's')}"
        for at in clock.jumps.tolist()
    ]
    choices = ", ".join(
        f"{n}: {part.stop - part.start} samples from {engineering(t[part][0], 's')}"
        for n, part in enumerate(parts[:8], 1)
    )
    problem = f"{log.name}: choose a part with --segment (segment=): {choices or 'there is none'}"
    raise RecordError([*shortened(listed), problem], log.name)


def refuse_uneven(log: Log, mapped: Mapped, clocks: Mapping[str, Clock]) -> None:
    """Refuse clocks that give no even grid, and say what would."""
    if len(clocks) > 1:
        listed = []
        for clock in clocks.values():
            names = [name for name, own in mapped.clock_of.items() if own == clock.name]
            listed.append(f"{clock.name} ({', '.join(names)}: {clock.in_words()})")
        raise RecordError(
            f"{log.name}: the signals have {len(clocks)} clocks: {'; '.join(listed)}. --resample "
            "(resample=True) puts them on one"
        )
    (clock,) = clocks.values()
    helps = (
        "--resample (resample=True) puts them on an even grid; or, if the samples are even and the "
        "clock that stamped them is not, give sampling_time in the map instead of t"
    )
    problems = [_step_problem(log, clock, at) for at in clock.uneven.tolist()]
    if not clock.whole_gaps:
        problems += [_step_problem(log, clock, at) for at in clock.gaps.tolist()]
    if problems:
        raise RecordError([*shortened(problems), f"{log.name}: {helps}"], log.name)


def _step_problem(log: Log, clock: Clock, at: int) -> str:
    t = clock.times
    return (
        f"{log.place(at)}: from sample {at - 1} to {at} (t = {t[at]:g} s) {clock.name} goes on by "
        f"{engineering(float(t[at] - t[at - 1]), 's', digits=4)} instead of "
        f"{engineering(clock.step, 's', digits=4)}"
    )
