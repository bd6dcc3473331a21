"""Times side by side: everyone once, then again from the start; ratios within a round."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from time import thread_time_ns

from benchmarks.entries import Entry


@dataclass(frozen=True)
class Times:
    """Processor time of one entry [ns a sample], one a round."""

    entry: Entry
    rounds: tuple[float, ...]

    @property
    def typical(self) -> float:
        """Median [ns a sample]."""
        return median(self.rounds)

    def ratios(self, yardstick: Times) -> list[float]:
        """How many times the yardstick it took, round by round."""
        return [own / other for own, other in zip(self.rounds, yardstick.rounds, strict=True)]


def interleaved(
    entries: Sequence[Entry], rounds: int, clock: Callable[[], int] = thread_time_ns
) -> list[Times]:
    """Time all entries in turn, `rounds` times (A B C A B C ...).

    What slows the machine down for a while slows down neighbours alike, so ratios within a round
    hold where times do not; and while others have the processor, the clock of this thread stands
    still. Those who compute in several threads need the clock of the whole process; divided by the
    cores it is what the wall shows where nobody else computes. Each entry runs once untimed right
    before it is timed, so that none pays for the caches and the heap as its neighbour left them;
    numba compiles then.
    """
    times: list[list[float]] = [[] for _ in entries]
    gc.disable()
    try:
        for done in range(rounds):
            _say(f"round {done + 1} of {rounds}")
            for entry, own in zip(entries, times, strict=True):
                entry.run()
                start = clock()
                entry.run()  # results are let go of at once: that is timed, too
                own.append((clock() - start) / entry.samples / entry.cores)
            gc.collect()
    finally:
        gc.enable()
        _say("")
    return [Times(entry, tuple(own)) for entry, own in zip(entries, times, strict=True)]


def _say(text: str) -> None:
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
