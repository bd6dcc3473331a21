"""The clock of a log: its rate, its jitter, where samples are missing, where it jumps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ambkit.record import TIME_TOLERANCE
from ambkit.units import engineering

Array = NDArray[np.float64]

MISSED = 1.5
"""A step longer than this many usual ones is a gap, no jitter."""


@dataclass(frozen=True, eq=False)
class Clock:
    """What the times of n samples are worth.

    Attributes
    ----------
    name : str
        The signal with the times.
    times : ndarray (n,)
        The times [s] as logged.
    step : float
        Usual time between two samples [s]: the mean of those within 1 % of the median.
    jitter : float
        Standard deviation of the steps [s], gaps and jumps left out.
    uneven : ndarray of int
        Samples before which the step is off by more than 1 %, and is neither gap nor jump.
    gaps : ndarray of int (g,)
        Samples before which others are missing.
    missing : ndarray of int (g,)
        How many, of each gap.
    jumps : ndarray of int
        Samples before which the clock goes back, stands still, or leaps by more than the log is
        long.
    """

    name: str
    times: Array
    step: float
    jitter: float
    uneven: NDArray[np.intp]
    gaps: NDArray[np.intp]
    missing: NDArray[np.intp]
    jumps: NDArray[np.intp]

    @property
    def rate(self) -> float:
        """Samples a second [Hz]."""
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
        """Whether times are printed with so few digits that many samples share theirs."""
        still = np.count_nonzero(np.diff(self.times) == 0)
        return bool(still > 0.1 * self.times.size)

    def in_words(self) -> str:
        """Say how good the clock is, in a line."""
        words = [f"{self.times.size} samples at {engineering(self.rate, 'Hz', digits=5)}"]
        if self.jitter > 1e-6 * self.step:
            words.append(f"jitter {engineering(self.jitter, 's', digits=2)} rms")
        for count, what in ((self.gaps.size, "gap"), (self.jumps.size, "jump")):
            if count:
                words.append(f"{count} {what}{'s' if count > 1 else ''}")
        return ", ".join(words)


def examine(name: str, times: Array) -> Clock:
    """Find out what a clock is worth.

    Parameters
    ----------
    name : str
        The signal with the times.
    times : ndarray (n,)
        The times [s], finite, n >= 2.
    """
    steps = np.diff(times)
    none = np.array([], dtype=np.intp)
    forward = steps if steps.min() > 0 else steps[steps > 0]
    if forward.size == 0:
        return Clock(name, times, np.inf, 0.0, none, none, none, np.arange(1, times.size))
    median = float(np.median(forward))
    usual = np.abs(steps - median) <= TIME_TOLERANCE * median
    if usual.all():  # the usual case, and a long log is done with
        return Clock(name, times, float(steps.mean()), float(steps.std()), none, none, none, none)
    step = float(np.mean(steps[usual])) if usual.any() else median
    ratio = steps / step
    span = min(float(forward.sum()), times.size * step)
    jump = (steps <= 0) | ((ratio > 10) & (steps > span))
    gap = (ratio >= MISSED) & ~jump
    within = steps[~(jump | gap)]
    return Clock(
        name,
        times,
        step,
        float(within.std()) if within.size else 0.0,
        np.flatnonzero((np.abs(ratio - 1) > TIME_TOLERANCE) & ~(jump | gap)) + 1,
        np.flatnonzero(gap) + 1,
        np.rint(ratio[gap]).astype(np.intp) - 1,
        np.flatnonzero(jump) + 1,
    )


def not_finite(times: Array) -> Iterator[tuple[int, float]]:
    """Yield the samples without a time, and what stands there."""
    for at in np.flatnonzero(~np.isfinite(times)):
        yield int(at), float(times[at])
