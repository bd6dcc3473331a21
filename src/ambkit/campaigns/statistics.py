"""How sure a share is: the interval of Clopper and Pearson, and when it is narrow enough."""

from __future__ import annotations

import math
from typing import NamedTuple


class Share(NamedTuple):
    """A share of runs, and its confidence interval."""

    passed: int
    """How many of them."""
    of: int
    """Of how many."""
    low: float
    """Lower end [1]."""
    high: float
    """Upper end [1]."""

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


GROWTH = 1.25
"""A study that may stop is looked at whenever it has grown by this."""


def looks(parts: int, size: int, least: int) -> list[int]:
    """Return after how many parts a study that may stop is looked at, the last one its end."""
    # They depend on the study alone, so that where it stops depends on neither order nor cluster.
    result, at = [], max(1, -(-least // size))
    while at < parts:
        result.append(at)
        at = max(at + 1, math.ceil(GROWTH * at))
    return [*result, parts]
