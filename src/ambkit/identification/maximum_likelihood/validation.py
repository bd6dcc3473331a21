"""Validation of a model on other records, with a verdict."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import RecordError
from ambkit.data.reading.faults import spike_free
from ambkit.data.record import Record
from ambkit.estimate.constant_velocity import tune
from ambkit.estimate.errors import LAGS, Whiteness, prediction_error, whiteness
from ambkit.identification.maximum_likelihood.baselines import FROM_THE_PAST
from ambkit.identification.maximum_likelihood.loop_model import LoopModel

HORIZONS = (1, 2, 5, 10, 20, 50)  #: Default horizons in samples.

ORDER = 30
"""Number of past samples that predict the control signal, see `cross_correlation`."""

AS_GOOD = 1.02  #: Ratio to a baseline's error that counts as no worse.
LEFT = 0.05  #: Predictable share of a residual's variance that is acceptable.
NIS = (0.8, 1.25)  #: Mean normalised innovation squared that is consistent.
WHITE = 0.9  #: Share of lags within the 95 % bounds from which residuals count as white.


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a model on a record."""

    name: str  #: Name of the record.
    samples: int  #: Number of counted measurements.
    #: Fit of the prediction [%] by samples ahead: 100 minus the RMS error over the position's
    #: standard deviation (NRMSE, Ljung 1999); 100 is perfect, 0 a constant.
    fit: Mapping[int, float]
    held: Mapping[int, float]  #: The same if the last measurement is held.
    error: Mapping[int, float]  #: RMS errors of the prediction [m].
    #: Fit of the initial model [%]; empty without one.
    of_start: Mapping[int, float]
    residual: Whiteness  #: Autocorrelation of the residuals at lags 1, 2, ... with its 95 % bound.
    #: Correlation of the residuals with the prewhitened control signal 1, 2, ... samples before,
    #: with its bound. With later control signals a loop correlates in any case.
    cross: Whiteness
    nis: float  #: Mean normalised innovation squared; 1 if the noise is right.
    gain: float  #: Log likelihood per sample over that of the initial model; NaN without one.
    #: RMS errors of a constant-velocity Kalman filter tuned to this record [m].
    without_a_magnet: Mapping[int, float]
    #: Share of the residuals' variance predictable from their past and the control signal's.
    left: float
    #: RMS errors of predictors from the past only, see `errors_from_the_past`; empty for a short
    #: record, and for an axis among others.
    from_the_past: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    #: Structural defects of the model according to the records of its identification.
    suspect: str = ""

    @property
    def farthest(self) -> int:
        """Horizon nearest to 10 samples, used by the verdict."""
        return min(self.fit, key=lambda ahead: abs(ahead - 10))

    @property
    def good(self) -> bool:
        """Whether the model passes all checks on this record."""
        # It predicts better than the last measurement and than a filter without magnet model, its
        # noise is consistent, hardly any of its residuals is predictable, the initial model was not
        # more likely, and its structure passes all tests. A failed test of whiteness does not count
        # by itself: in a long record it reveals insignificant effects.
        k = self.farthest
        return (
            self.fit[k] > self.held[k]
            and self.error[k] <= AS_GOOD * self.without_a_magnet[k]
            and is_consistent(self.nis)
            and is_explained(self.left)
            and not self.gain < 0
            and not self.better
            and not self.suspect
        )

    @property
    def better(self) -> list[str]:
        """Baselines with the same information that predict better at the longest horizon."""
        by = {FROM_THE_PAST[kind][0]: of[max(of)] for kind, of in self.from_the_past.items()}
        return [name for name, error in by.items() if by["model"] > AS_GOOD * error]

    @property
    def verdict(self) -> str:
        """Objections to the model, in sentences."""
        k, more = self.farthest, "larger" if self.nis > 1 else "smaller"
        objections = {
            f"The structure of the model is suspect: {self.suspect}.": bool(self.suspect),
            "The model predicts no better than the last measurement held.":
                self.fit[k] <= self.held[k],
            "A filter without a magnet predicts better.":
                self.error[k] > AS_GOOD * self.without_a_magnet[k],
            f"From the past alone, {' and '.join(self.better)} predicted better.":
                bool(self.better),
            f"The initial model was more likely, by {-self.gain:.3f} per sample: the identified "
            "parameters do not hold here.": self.gain < 0,
            "The residuals are not white: some motion is unexplained, or the noise is "
            "coloured.": self.residual.share_within < WHITE,
            "The residuals depend on the control signal: force law, delay or lag is incomplete.":
                self.cross.share_within < WHITE,
            "Much of the residuals is predictable: a better model would predict more.":
                not is_explained(self.left),
            f"The residuals are {more} than expected: mean NIS {self.nis:.2f}, should be 1.":
                not is_consistent(self.nis),
        }  # fmt: skip
        objection = " ".join(text for text, holds in objections.items() if holds)
        return objection or "The model passes all checks."

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data for JSON."""
        by_horizon = {
            "fit_percent": self.fit, "held_percent": self.held, "start_percent": self.of_start,
            **{f"rms_error_{kind}": by for kind, by in self.from_the_past.items()},
            "rms_error": self.error, "rms_error_without_a_magnet": self.without_a_magnet,
        }  # fmt: skip
        return {
            "record": self.name, "samples": self.samples,
            **{name: {str(k): v for k, v in by.items()} for name, by in by_horizon.items()},
            "white_share": self.residual.share_within, "cross_share": self.cross.share_within,
            "nis": self.nis, "gain_per_sample": self.gain, "predictable_share": self.left,
            "good": self.good, "verdict": self.verdict,
        }  # fmt: skip


def is_consistent(nis: float) -> bool:
    """Whether the noise agrees with the model."""
    return NIS[0] < nis < NIS[1]


def is_explained(share: float) -> bool:
    """Whether so little of the residuals is predictable that the model passes."""
    return share < LEFT


def validate(
    model: LoopModel,
    record: Record,
    *,
    start: LoopModel | None = None,
    horizons: Sequence[int] = HORIZONS,
    settling: float = 0.0,
    name: str = "",
) -> Validation:
    """Validate a model on a record."""
    farthest = max(horizons)
    first = max(1, round(settling / record.sampling_time))
    record, _ = spike_free(record)
    if len(record) < first + farthest + 4 * LAGS:
        raise RecordError(
            f"{name or 'the record'} has {len(record)} samples; {first + farthest + 4 * LAGS} are "
            "needed to validate a model"
        )
    e, S, used = model.innovations(record)
    used[:first] = False
    if not used.any():
        raise RecordError(f"{name or 'the record'}: no measurement could be used")
    y = record["y"]

    def errors(predicted: Callable[[int], Array]) -> dict[int, float]:
        return {k: prediction_error(predicted(k), record, k, first) for k in horizons}

    def fits(errors: Mapping[int, float]) -> dict[int, float]:
        own = {k: float(np.nanstd(y[first + k :])) for k in errors}
        return {k: 100 * (1 - errors[k] / own[k]) if own[k] > 0 else math.nan for k in errors}

    error = errors(lambda k: model.predict(record, k))
    gain, of_start = math.nan, dict[int, float]()
    if start is not None:
        of_start = fits(errors(lambda k: start.predict(record, k)))
        e_start, S_start, used_start = start.innovations(record)
        gain = _per_sample(e, S, used) - _per_sample(e_start, S_start, used & used_start)
    naive = tune(y, record.sampling_time)
    r = e[used] / np.sqrt(S[used])
    return Validation(
        name=name,
        samples=int(used.sum()),
        fit=fits(error),
        held=fits(errors(lambda k: y[:-k])),
        error=error,
        of_start=of_start,
        residual=whiteness(r),
        cross=cross_correlation(np.where(used, e / np.sqrt(S), 0.0)[first:], record["u"][first:]),
        nis=float(np.mean(r**2)),
        gain=gain,
        without_a_magnet=errors(lambda k: naive.predict(y, k)),
        left=predictable((e / np.sqrt(S))[used], record["u"][used]),
    )


def cross_correlation(residual: Array, u: Array) -> Whiteness:
    """Correlate residuals with an input of the past, after Box and Jenkins (1976, ch. 11)."""
    # The input of a loop is so coloured that one chance correlation would appear at all lags. Its
    # predictable part is removed first: then the lags are independent, and the bound is that of
    # white noise. residual (n,); u (n,)
    e = residual - residual.mean()
    w = _prewhitened(u)
    e = e[e.size - w.size :]
    scale = math.sqrt(float(e @ e) * float(w @ w))
    if not scale > 0:
        return Whiteness(np.zeros(LAGS), 1.96 / math.sqrt(e.size))
    correlation = np.array([float(e[lag:] @ w[:-lag]) / scale for lag in range(1, LAGS + 1)])
    return Whiteness(correlation, 1.96 / math.sqrt(e.size))


def predictable(residual: Array, u: Array) -> float:
    """Return the share of a residual's variance that is linearly predictable from the past."""
    # From `ORDER` past residuals and as many prewhitened control signals. A test of whiteness
    # rejects any departure in a long record; this states the possible gain of a better model. The
    # share that so many weights explain by chance is subtracted. residual (n,); u (n,)
    w = _prewhitened(u)
    e = (residual - residual.mean())[residual.size - w.size :]
    windows = np.lib.stride_tricks.sliding_window_view
    past = np.column_stack([windows(one, ORDER)[:-1] for one in (e, w)])
    target = e[ORDER:]
    solution, *_ = np.linalg.lstsq(past, target, rcond=1e-12)
    left = float(np.sum((target - past @ solution) ** 2)) / max(target.size - 2 * ORDER, 1)
    return float(max(0.0, 1 - left / np.mean(target**2)))


def _prewhitened(u: Array) -> Array:
    """Return the errors of a signal's linear prediction from its own past."""
    known = np.where(np.isfinite(u), u, np.nanmean(u))
    past = np.lib.stride_tricks.sliding_window_view(known - known.mean(), ORDER + 1)
    solution, *_ = np.linalg.lstsq(past[:, :-1], past[:, -1], rcond=1e-12)
    return np.asarray(past[:, -1] - past[:, :-1] @ solution)


def _per_sample(e: Array, S: Array, used: Bools) -> float:
    return float(-0.5 * np.mean(np.log(S[used]) + e[used] ** 2 / S[used]))
