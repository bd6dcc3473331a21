"""The share of good machines with its interval, and when a campaign has enough of them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

from ambkit.campaigns.plan import Plan
from ambkit.campaigns.store import Folder


class Share(NamedTuple):
    """A share of runs, and its confidence interval."""

    passed: int  #: How many of them.
    of: int  #: Of how many.
    low: float  #: Lower end [1].
    high: float  #: Upper end [1].

    def __str__(self) -> str:
        if not self.of:
            return "–"
        return f"{100 * self.value:.2f} % ({100 * self.low:.2f} to {100 * self.high:.2f} %)"

    @property
    def value(self) -> float:
        """The share itself [1]; NaN of none."""
        return self.passed / self.of if self.of else math.nan

    @property
    def width(self) -> float:
        """Of the interval [1]."""
        return self.high - self.low


def clopper_pearson(count: int, of: int, confidence: float = 0.95) -> Share:
    """Return a share with the interval of Clopper and Pearson (1934)."""
    # It holds the true share at least as often as the confidence says, however few the runs. After
    # Sobol points or a Latin hypercube it is wider than need be: these cover more evenly than
    # chance.
    from scipy.stats import beta

    if of == 0:
        return Share(0, 0, 0.0, 1.0)
    tail = (1 - confidence) / 2
    low = float(beta.ppf(tail, count, of - count + 1)) if count else 0.0
    high = float(beta.ppf(1 - tail, count + 1, of - count)) if count < of else 1.0
    return Share(count, of, low, high)


GROWTH = 1.25  #: A study that may stop is looked at whenever it has grown by this.


def looks(parts: int, size: int, least: int) -> list[int]:
    """Return after how many parts a study that may stop is looked at, the last one its end."""
    # They depend on the study alone, so that where it stops depends on neither order nor cluster.
    result, at = [], max(1, -(-least // size))
    while at < parts:
        result.append(at)
        at = max(at + 1, math.ceil(GROWTH * at))
    return [*result, parts]


class Counted:
    """The parts of a folder, counted."""

    def __init__(self, place: Folder) -> None:
        self.plan = place.plan
        self.passed: dict[int, int] = {}
        for part in sorted(place.done()):
            if part < place.plan.parts:
                self.add(part, place.column(part, "passed"))

    def add(self, part: int, passed: Any) -> None:
        """Count a part by its column (n,) of those that passed."""
        self.passed[part] = int(passed.sum())

    @property
    def runs(self) -> int:
        """Finished, all parts together."""
        return sum(stop - first for first, stop in map(self.plan.span, self.passed))

    def share(self, parts: Iterable[int]) -> Share:
        """Return the share of good machines in some parts."""
        spans = [(part, self.plan.span(part)) for part in parts]
        of = sum(stop - first for _, (first, stop) in spans)
        count = sum(self.passed[part] for part, _ in spans)
        return clopper_pearson(count, of, self.plan.study.confidence)

    def enough(self, end: int) -> bool:
        """Whether the parts before one give as narrow an interval as the study wants."""
        stop = self.plan.study.stop
        return stop is not None and self.share(range(end)).width <= stop.width

    @property
    def end(self) -> int | None:
        """The part before which the study ended; None where it has not."""
        for end in looks_of(self.plan):
            if not all(part in self.passed for part in range(end)):
                return None
            if end == self.plan.parts or self.enough(end):
                return end
        return None

    def counting(self) -> tuple[int, ...]:
        """Return the parts that count: up to the end, or of an unfinished campaign all."""
        end = self.end
        return tuple(sorted(self.passed)) if end is None else tuple(range(end))


def looks_of(plan: Plan) -> list[int]:
    """Return after how many parts a study is looked at, the last one its end."""
    stop = plan.study.stop
    return [plan.parts] if stop is None else looks(plan.parts, plan.study.part, stop.least)
