"""What all that learn a magnet constant sample by sample say about a record."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ambkit.base.arrays import Array, Bools
from ambkit.result.row import Row

CONSTANT = "N m^2/A^2"  #: Unit of a magnet constant.
CONFIDENCE = 1.96  #: Standard errors to either side within which 95 % of normal estimates lie.

DRIFTING = 0.02
"""Part of itself by which a magnet constant moves in the last quarter if it has not settled."""


@dataclass(frozen=True, eq=False)
class OnlineResult:
    """How a magnet constant was learned along a record, n samples."""

    t: Array  #: (n,) Time [s].
    k: Array  #: (n,) Identified magnet constant [N m^2/A^2].
    #: (n,) Where k was held for want of excitation, or because a sample was bad.
    held: Bools

    @property
    def magnet_constant(self) -> float:
        """Mean of k over the last quarter of the record [N m^2/A^2]."""
        return float(self.k[last_quarter(self.k)].mean())

    @property
    def spread(self) -> float:
        """Standard deviation of k over the last quarter of the record [N m^2/A^2]."""
        return float(self.k[last_quarter(self.k)].std())

    @property
    def drift(self) -> float:
        """Change of k over the last quarter of the record [N m^2/A^2]."""
        late = self.k[last_quarter(self.k)]
        return float(late[-1] - late[0])

    @property
    def settled(self) -> bool:
        """Whether k hardly moved any more in the last quarter of the record."""
        return abs(self.drift) <= DRIFTING * abs(self.magnet_constant)

    @property
    def standard_error(self) -> float:
        """Standard error of `magnet_constant` [N m^2/A^2]; NaN where nothing is known of it."""
        raise NotImplementedError

    def rows(self) -> list[Row]:
        """Return what was learned, and how sure it is."""
        k, error = self.magnet_constant, self.standard_error
        return [
            Row("magnet_constant", "magnet constant, found", k, CONSTANT),
            Row("standard_error", "  standard error", error, CONSTANT, 2),
            Row("half_width", "  95 % interval, ±", CONFIDENCE * error / k, "%"),
            Row("spread", "  standard deviation, last quarter", self.spread, CONSTANT, 2,
                detail=True),
            Row("drift", "  drift over the last quarter", self.drift, CONSTANT, 2),
            Row("held_share", "held for want of excitation", float(self.held.mean()), "%"),
        ]  # fmt: skip


def last_quarter(values: Array) -> slice:
    """Return where the last quarter of values lies, one at least."""
    return slice(len(values) - max(1, len(values) // 4), None)


def mean_error(values: Array, memory: float) -> float:
    """Standard error of the mean of what an exponential memory gives out."""
    # For a first-order process of correlation time `memory`, over a stretch of `a` times that, the
    # mean has the share ``v = 2/a (1 - (1 - exp(-a))/a)`` of the process's variance, and the
    # scatter about the mean the rest (Priestley 1981, ch. 5).
    # values (n,)
    if values.size < 2:
        return math.nan
    a = values.size / memory
    share = 2 / a * (1 + math.expm1(-a) / a)
    return float(values.std()) * math.sqrt(share / (1 - share))
