"""Rejection of logs whose samples fit no even grid, with places and advice."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ambkit.base.errors import RecordError, shortened
from ambkit.base.units import engineering
from ambkit.data.channel_map import MappedSignals
from ambkit.data.files.log import Log
from ambkit.data.reading.clock import Clock, instant


class RejectedLog(RecordError):
    """A log without a record; the readable part is available for inspection."""

    def __init__(
        self, error: RecordError, name: str, mapped: MappedSignals, damaged: tuple[int, ...] = ()
    ) -> None:
        super().__init__(error.problems, error.title)
        self.name, self.mapped, self.damaged = name, mapped, damaged


def check_times(log: Log, mapped: MappedSignals, used: list[str]) -> None:
    """Reject times that are not numbers, each with its line."""
    problems = []
    for name in used:
        times = mapped.clocks[name]
        if times.size < 2:
            problems.append(
                f"{log.name}: {name} must have at least 2 samples, has {times.size or 'none'}"
            )
        for at in np.flatnonzero(~np.isfinite(times)).tolist():
            problems.append(f"{log.place(at)}: {name} is {times[at]} at sample {at}")
    if not used:
        problems.append(f"{log.name}: the map names no signal but the time")
    if problems:
        raise RecordError(shortened(problems), log.name)


def segments_of(
    log: Log, clocks: Mapping[str, Clock], segment: int | None
) -> tuple[dict[str, slice], str]:
    """Return the selected segment between jumps of each clock; or raise with the list."""
    main = clocks.get("t") or next(iter(clocks.values()))
    for clock in clocks.values():
        if clock.too_coarse:
            raise RecordError(
                f"{log.name}: {clock.name} has too few digits: many samples share their time. Give "
                "sampling_time in the map instead"
            )
        if not _jump_together(main, clock):
            raise RecordError(
                f"{log.name}: {main.name} has {_jumps(main)}, {clock.name} has {_jumps(clock)}, "
                "and not at the same times: which of their samples belong together is not known"
            )
    parts = {name: clock.segments for name, clock in clocks.items()}
    count = min(map(len, parts.values()))
    names = " and ".join(clocks)
    if segment is not None and 1 <= segment <= count:
        chosen = {name: own[segment - 1] for name, own in parts.items()}
        return chosen, f"part {segment} of {count} between jumps of {names} is read"
    t = main.times
    listed = [
        f"{log.place(at)}: {names} jump{'s' if len(clocks) == 1 else ''} from "
        f"{instant(t[at - 1], main.step)} to {instant(t[at], main.step)}"
        for at in main.jumps.tolist()
    ]
    choices = ", ".join(
        f"{n}: {part.stop - part.start} samples from {instant(t[part][0], main.step)}"
        for n, part in enumerate(parts[main.name][:8], 1)
    )
    problem = f"{log.name}: choose a part with --segment (segment=): {choices or 'there is none'}"
    raise RecordError([*shortened(listed), problem], log.name)


def _jump_together(main: Clock, other: Clock) -> bool:
    """Return whether two clocks have the same jumps, so that their segments correspond."""
    if main.jumps.size != other.jumps.size:
        return False
    slack = 1.5 * max(main.step, other.step)
    return all(
        bool((abs(main.times[main.jumps - back] - other.times[other.jumps - back]) <= slack).all())
        for back in (0, 1)
    )


def _jumps(clock: Clock) -> str:
    count = clock.jumps.size
    return f"{count or 'no'} jump{'' if count == 1 else 's'}"


def refuse_uneven(log: Log, mapped: MappedSignals, clocks: Mapping[str, Clock]) -> None:
    """Reject clocks without an even grid, with advice."""
    if len(clocks) > 1:
        listed = []
        for clock in clocks.values():
            names = [name for name, own in mapped.clock_of.items() if own == clock.name]
            listed.append(f"{clock.name} ({', '.join(names)}: {clock.describe()})")
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
        f"{log.place(at)}: from sample {at - 1} to {at} (t = {instant(t[at], clock.step)}) "
        f"{clock.name} goes on by "
        f"{engineering(float(t[at] - t[at - 1]), 's', digits=4)} instead of "
        f"{engineering(clock.step, 's', digits=4)}"
    )
