"""How many machines of the parts that are there are good, and whether that is enough of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ambkit.campaigns.plan import Plan
from ambkit.campaigns.statistics import Share, clopper_pearson, looks
from ambkit.campaigns.store import Folder


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
