"""What innovations and predictions say of a filter, without the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array

if TYPE_CHECKING:
    from ambkit.data.record import Record


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of innovations, and what white ones would stay within."""

    correlation: Array  #: (lags,) At lags 1, 2, ...
    bound: float  #: 95 % of a white sequence's correlations are within +-bound.

    @property
    def share_within(self) -> float:
        """Share of the lags that are within the bound; white: 0.95."""
        return float(np.mean(np.abs(self.correlation) <= self.bound))


def whiteness(innovation: Array, lags: int = 50) -> Whiteness:
    """Autocorrelation test of an innovation sequence (Mehra 1970)."""
    e = innovation - innovation.mean()
    power = float(e @ e)
    correlation = np.array([float(e[lag:] @ e[:-lag]) / power for lag in range(1, lags + 1)])
    return Whiteness(correlation, 1.96 / np.sqrt(len(e)))


def prediction_error(predicted: Array, record: Record, ahead: int, skip: int = 0) -> float:
    """Root mean square error of predictions against the measured position [m]."""
    # predicted (n - ahead,)
    error = record["y"][ahead:] - predicted
    return float(np.sqrt(np.nanmean(error[skip:] ** 2)))
