"""Errors of estimates against the truth, and consistency of their innovations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambkit.base import arrays
from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate

JUDGED = ("position", "velocity", "bending", "bending velocity", "disturbance force")
"""Roles of the states whose errors are reported."""


def rms_errors(
    estimate: Estimate, record: Record, first: int = 0, end: int | None = None
) -> dict[str, float]:
    """Return root mean square errors of states against a record's truth, each in its unit."""
    results = {}
    for state in estimate.states:
        truth = true_signal(record, state.name)
        if state.role in JUDGED and truth is not None:
            results[state.name] = rms((estimate[state.name] - truth)[first:end])
    return results


def true_signal(record: Record, state: str) -> Array | None:
    """Return the truth (n,) of a state in its unit; None if a record does not have it."""
    truth = record.truth
    return truth.get(f"q_{state}", truth.get(state))


def rms(error: Array) -> float:
    """Return the root mean square of the known values; NaN if there are none."""
    known = error[np.isfinite(error)]
    return arrays.rms(known) if known.size else float("nan")


@dataclass(frozen=True)
class Whiteness:
    """Autocorrelation of innovations, with the bound of white noise."""

    correlation: Array  #: (lags,) At lags 1, 2, ...
    bound: float  #: 95 % of a white sequence's correlations are within +-bound.

    @property
    def share_within(self) -> float:
        """Share of the lags within the bound; white: 0.95."""
        return float(np.mean(np.abs(self.correlation) <= self.bound))


LAGS = 50  #: Lags of the test of whiteness.


def whiteness(innovation: Array, lags: int = LAGS) -> Whiteness:
    """Autocorrelation test of an innovation sequence (Mehra 1970)."""
    e = innovation - innovation.mean()
    return correlated(e, e, lags)


def correlated(e: Array, w: Array, lags: int = LAGS) -> Whiteness:
    """Correlate a sequence (n,) with the past of a white one (n,), both of zero mean."""
    scale = math.sqrt(float(e @ e) * float(w @ w)) or math.inf  # zeros do not correlate
    correlation = np.array([float(e[lag:] @ w[:-lag]) / scale for lag in range(1, lags + 1)])
    return Whiteness(correlation, 1.96 / math.sqrt(len(e)))


def prediction_error(predicted: Array, record: Record, ahead: int, skip: int = 0) -> float:
    """Root mean square error of predictions against the measured position [m]."""
    # predicted (n - ahead,)
    error = record["y"][ahead:] - predicted
    return float(np.sqrt(np.nanmean(error[skip:] ** 2)))
