"""How well a filter fits a record: by its innovations, its predictions, and the truth if known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import RecordError
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.innovations import Whiteness, whiteness
from ambkit.judge.comparison import EVALUATED

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator

Array = NDArray[np.float64]

LAGS = 50
"""Lags of the whiteness test."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a record says about a filter that ran along it."""

    estimate: Estimate  #: What the filter estimated, all samples.
    #: Time at the start that does not count below [s]; the first sample never does.
    settling: float
    samples: int  #: Samples that count, and those of them whose measurement the filter took in.
    used: int
    innovation_mean: float  #: Of the measurements taken in [m].
    innovation_std: float
    #: Root mean square of what the filter expected its innovations to be, ``sqrt(S)`` [m].
    expected_std: float
    #: Mean normalised innovation squared; 1 where model and noise are right. Below 1 the filter
    #: expects more noise than there is, above 1 less. NaN where it expects nothing.
    nis: float
    #: Autocorrelation of the innovations, `LAGS` lags; None where fewer than four times as many
    #: measurements were taken in, or all innovations are equal.
    whiteness: Whiteness | None
    #: How many samples had which flag of :class:`ambkit.Status`; flags that did not occur are left
    #: out.
    status: Mapping[str, int]
    #: Steps ahead, and the RMS error of the filter's prediction of the measured position [m].
    prediction: Mapping[int, float]
    #: The same where the last measurement is held for the prediction [m].
    held: Mapping[int, float]
    #: (mapping of int to float) The same for the estimates that the rig logged [m], see
    #: `logged_predictions`.
    logged: Mapping[str, Mapping[int, float]]
    #: RMS errors of ``x`` [m], ``v`` [m/s], ``f_d`` [N] against the truth; empty without it.
    rmse: Mapping[str, float]
    disturbance_mean: float  #: Of the estimated disturbance force [N].
    disturbance_std: float

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI, ready for JSON; without the estimate."""
        white = self.whiteness
        return {
            "estimator": self.estimate.estimator,
            "settling": self.settling,
            "samples": self.samples,
            "used": self.used,
            "innovation_mean": self.innovation_mean,
            "innovation_std": self.innovation_std,
            "expected_std": self.expected_std,
            "nis": self.nis,
            "white_share": white.share_within if white else None,
            "white_bound": white.bound if white else None,
            "status": dict(self.status),
            "prediction": _by_text(self.prediction),
            "held": _by_text(self.held),
            "logged": {name: _by_text(errors) for name, errors in self.logged.items()},
            "rmse": dict(self.rmse),
            "disturbance_mean": self.disturbance_mean,
            "disturbance_std": self.disturbance_std,
        }


def evaluate(
    kalman: Estimator,
    record: Record,
    *,
    horizons: Sequence[int] = (1, 10),
    settling: float = 0.0,
) -> Evaluation:
    """Run a filter along a record and say how well the two fit."""
    _check(record, horizons, settling)
    estimate = kalman.run(record)
    # The filter starts from the first measurement, which is then no surprise to it.
    first = max(1, round(settling / record.sampling_time))
    taken = estimate.used[first:]
    if not taken.any():
        flags = _flags(estimate.status[first:])
        there = int(np.isfinite(record["y"][first:]).sum())
        if flags.get("missing", 0) > taken.size - there:  # the core has one flag for both
            absent = taken.size - there
            flags["far beyond the travel"] = flags.pop("missing") - absent
            flags |= {"missing": absent} if absent else {}
        raise RecordError(
            f"no measurement could be taken in: of {taken.size} samples "
            + ", ".join(f"{n} {flag}" for flag, n in flags.items())
        )
    innovation = estimate.innovation[first:][taken]
    variance = estimate.innovation_variance[first:][taken]
    f_d = estimate.f_d[first:]
    last = _last_measured(record["y"])
    return Evaluation(
        estimate=estimate,
        settling=settling,
        samples=taken.size,
        used=int(taken.sum()),
        innovation_mean=float(innovation.mean()),
        innovation_std=float(innovation.std()),
        expected_std=float(np.sqrt(variance.mean())),
        nis=_mean_nis(innovation, variance),
        whiteness=_white(innovation),
        status=_flags(estimate.status[first:]),
        prediction={
            ahead: _error(kalman.forecast(estimate, record, ahead), record, ahead, first)
            for ahead in horizons
        },
        held={ahead: _error(last[:-ahead], record, ahead, first) for ahead in horizons},
        logged=logged_predictions(record, horizons, first=first),
        rmse={
            name: _rms(estimate[name][first:] - record[name][first:])
            for name in EVALUATED
            if name in record.truth
        },
        disturbance_mean=float(f_d.mean()),
        disturbance_std=float(f_d.std()),
    )


def logged_predictions(
    record: Record, horizons: Sequence[int] = (1, 10), *, first: int = 0
) -> dict[str, dict[int, float]]:
    """Return how well a rig's own logged estimates predict the measured position."""
    # The rig's filter does not say how it would predict. Two ways are judged: its position is held,
    # and, where the velocity was logged too, it goes on with that.
    if "x_logged" not in record:
        return {}
    x, T = record["x_logged"], record.sampling_time
    ways = {"x_logged held": np.zeros_like(x)}
    if "v_logged" in record:
        ways["x_logged and v_logged"] = record["v_logged"]
    return {
        name: {
            ahead: _error((x + ahead * T * slope)[:-ahead], record, ahead, first)
            for ahead in horizons
        }
        for name, slope in ways.items()
    }


def _check(record: Record, horizons: Sequence[int], settling: float) -> None:
    wrong = [ahead for ahead in horizons if ahead < 1]
    if wrong:
        raise ValueError(f"a horizon must be 1 sample or more, is {wrong[0]}")
    if not (np.isfinite(settling) and settling >= 0):
        raise ValueError(f"settling must be 0 s or more, is {settling:g} s")
    needed = max(1, round(settling / record.sampling_time)) + max(horizons, default=0) + 1
    if len(record) < needed:
        raise RecordError(
            f"the record has {len(record)} samples, {needed} are needed to predict "
            f"{max(horizons, default=0)} samples ahead after {settling:g} s of settling"
        )


def _last_measured(y: Array) -> Array:
    """Return y with each missing sample in the place of the last one that was not."""
    at = np.where(np.isnan(y), 0, np.arange(y.size))
    return np.asarray(y[np.maximum.accumulate(at)])


def _error(predicted: Array, record: Record, ahead: int, first: int) -> float:
    """RMS error of predictions made from sample `first` on; missing measurements do not count."""
    return _rms((record["y"][ahead:] - predicted)[first:])


def _rms(error: Array) -> float:
    known = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def _mean_nis(innovation: Array, variance: Array) -> float:
    known = variance > 0  # a low-pass has no idea of it
    return float(np.mean(innovation[known] ** 2 / variance[known])) if known.any() else math.nan


def _white(innovation: Array) -> Whiteness | None:
    if innovation.size < 4 * LAGS or not np.ptp(innovation) > 0:
        return None
    return whiteness(innovation, LAGS)


def _flags(status: NDArray[np.uint16]) -> dict[str, int]:
    """Count the samples with each flag, by its name in lower case."""
    counts = {
        str(flag.name).lower(): int(np.count_nonzero(status & np.uint16(flag))) for flag in Status
    }
    return {name: count for name, count in counts.items() if count}


def _by_text(errors: Mapping[int, float]) -> dict[str, float]:
    return {str(ahead): error for ahead, error in errors.items()}
