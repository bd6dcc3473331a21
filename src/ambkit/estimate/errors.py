"""Errors of an estimate against a record's truth."""

from __future__ import annotations

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate

JUDGED = ("position", "velocity", "bending", "bending velocity", "disturbance force")
"""Roles of the states whose errors are told."""


def errors_along(
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
    """Return the truth (n,) of a state in its unit; None where a record does not know it."""
    truth = record.truth
    return truth.get(f"q_{state}", truth.get(state))


def rms(error: Array) -> float:
    """Return the root mean square of what is known; NaN where nothing is."""
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
