"""Online identification of the magnet constant by the filter that has it for a fifth state."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.estimate.augmented import AugmentedKalmanFilter
from ambkit.estimate.estimate import Estimate, Status
from ambkit.identification.online.result import CONFIDENCE, OnlineResult

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.machine import Bearing


@dataclass(frozen=True, eq=False)
class AugmentedResult(OnlineResult):
    """What the filter learned along a record, n samples; the rest as :class:`OnlineResult`."""

    error: Array  #: (n,) Standard deviation of k as the filter believes it [N m^2/A^2].
    load: Array  #: (n,) Estimated force on the rotor that was not known [N].
    estimate: Estimate  #: All that the filter said.

    @property
    def magnet_constant(self) -> float:
        """Where k ended, which holds all that was learned [N m^2/A^2]."""
        return float(self.k[-1])

    @property
    def settled(self) -> bool:
        """Whether k moved in the last quarter by no more than its own error, or hardly."""
        return super().settled or abs(self.drift) <= CONFIDENCE * self.standard_error

    @property
    def standard_error(self) -> float:
        """Standard deviation of k as the filter believes it at the end [N m^2/A^2]."""
        # NaN where k was never learned: what the filter began with is no finding.
        return math.nan if self.held.all() else float(self.error[-1])


class AugmentedIdentifier:
    """Magnet constant by :class:`ambkit.AugmentedKalmanFilter`, beside its four other states."""

    # It takes the load for one that wanders, and needs no word of it; so a load that is known is
    # only taken off what it found.

    def __init__(self, bearing: Bearing, *, start: float | None = None, **options: Any) -> None:
        if start is None:
            start = bearing.magnet.magnet_constant
        if not 0 < start < math.inf:
            raise ValueError(f"start must be greater than 0 N m^2/A^2 and finite, got {start!r}")
        self.bearing = bearing.replace(**bearing.magnet.with_constant(start))
        self.kalman = AugmentedKalmanFilter(self.bearing, **options)

    def run(self, record: Record, *, disturbance: ArrayLike | None = None) -> AugmentedResult:
        """Learn along a record."""
        # disturbance (n,) [N]
        start = self.bearing.magnet.magnet_constant
        estimate = self.kalman.run(record)
        assert estimate.scale is not None
        assert estimate.scale_variance is not None
        unlearned = Status.UNEXCITED | Status.MISSING | Status.FROZEN | Status.OUTLIER
        return AugmentedResult(
            t=record.t,
            k=start * estimate.scale,
            held=(estimate.status & np.uint16(unlearned | Status.BAD_VARIANCE)) != 0,
            error=start * np.sqrt(estimate.scale_variance),
            load=estimate.f_d - (0.0 if disturbance is None else np.asarray(disturbance)),
            estimate=estimate,
        )
