"""A model held to records that it was not identified from, and a verdict in plain words."""

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

HORIZONS = (1, 2, 5, 10, 20, 50)  #: Steps ahead, where the user does not say.

ORDER = 30
"""Samples of its own past from which the control signal is predicted, see `cross_correlation`."""

AS_GOOD = 1.02  #: Times a baseline's error that still count as no worse.
LEFT = 0.05  #: Share of a residual's variance that may be predicted, and the model is still good.
NIS = (0.8, 1.25)  #: Mean normalised innovation squared of a noise that is what the model expects.
WHITE = 0.9  #: Share of lags within the 95 % bounds from which residuals pass for white.


@dataclass(frozen=True, eq=False)
class Validation:
    """How a model does on a record."""

    name: str  #: Of the record.
    samples: int  #: Measurements that count.
    #: Steps ahead, and the fit of the prediction [%]: 100 less the RMS error in parts of the
    #: position's own standard deviation (NRMSE, Ljung 1999); 100 is perfect, 0 a constant.
    fit: Mapping[int, float]
    held: Mapping[int, float]  #: The same where the last measurement is held.
    error: Mapping[int, float]  #: RMS errors of the prediction [m].
    #: The fit of the model that the identification began with [%]; empty without one.
    of_start: Mapping[int, float]
    residual: Whiteness  #: Autocorrelation of the residuals at lags 1, 2, ... with its 95 % bound.
    #: Correlation of the residuals with what was new in the control signal 1, 2, ... samples
    #: before, with its bound. With later control signals a loop makes it anyway.
    cross: Whiteness
    nis: float  #: Mean normalised innovation squared; 1 where the noise is right.
    gain: float  #: Log likelihood per sample over that of the start; NaN without one.
    #: RMS errors of a constant-velocity Kalman filter that is tuned to this very record [m].
    without_a_magnet: Mapping[int, float]
    #: Share of the residuals' variance that their past and the control signal's predict.
    left: float
    #: RMS errors [m] of what predicts from the past alone, see `errors_from_the_past`; empty of a
    #: short record, and of an axis among others.
    from_the_past: Mapping[str, Mapping[int, float]] = field(default_factory=dict)
    suspect: str = ""  #: What the model's structure lacks, by the records of its identification.

    @property
    def farthest(self) -> int:
        """Of the horizons the one nearest to 10 steps, which the verdict is about."""
        return min(self.fit, key=lambda ahead: abs(ahead - 10))

    @property
    def good(self) -> bool:
        """Whether the model passes all checks on this record."""
        # It predicts better than the last measurement and than a filter without a magnet, its
        # noise is what it expects, hardly anything of what it leaves could be predicted, the start
        # was not more likely, and no test of its structure fails. That residuals fail a test of
        # whiteness does not count by itself: in a long record the test finds what is of no
        # importance.
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
        """Baselines that predict better at the longest horizon from what the model knows too."""
        by = {FROM_THE_PAST[kind][0]: of[max(of)] for kind, of in self.from_the_past.items()}
        return [name for name, error in by.items() if by["model"] > AS_GOOD * error]

    @property
    def verdict(self) -> str:
        """What the figures say against the model, in sentences."""
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
        """Return the figures as plain data, ready for JSON."""
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
    """Whether the noise is what a model expects."""
    return NIS[0] < nis < NIS[1]


def is_explained(share: float) -> bool:
    """Whether so little of what a model leaves could be predicted that it is good all the same."""
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
    """Hold a model to a record."""
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
        raise RecordError(f"{name or 'the record'}: no measurement could be taken in")
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
    # The input of a loop has so much colour that one chance correlation would show at all lags. So
    # what of it could be predicted from its own past is taken off first: then the lags are
    # independent, and the bound is that of white noise.
    # residual (n,); u (n,)
    e = residual - residual.mean()
    w = _prewhitened(u)
    e = e[e.size - w.size :]
    scale = math.sqrt(float(e @ e) * float(w @ w))
    if not scale > 0:
        return Whiteness(np.zeros(LAGS), 1.96 / math.sqrt(e.size))
    correlation = np.array([float(e[lag:] @ w[:-lag]) / scale for lag in range(1, LAGS + 1)])
    return Whiteness(correlation, 1.96 / math.sqrt(e.size))


def predictable(residual: Array, u: Array) -> float:
    """Return the share of a residual's variance that a line through the past predicts."""
    # Through `ORDER` residuals before and as many of what was new in the control signal. A test of
    # whiteness finds any departure, however small, once a record is long; this says how much a
    # better model could gain. What so many weights explain of anything is taken off.
    # residual (n,); u (n,)
    w = _prewhitened(u)
    e = (residual - residual.mean())[residual.size - w.size :]
    windows = np.lib.stride_tricks.sliding_window_view
    past = np.column_stack([windows(one, ORDER)[:-1] for one in (e, w)])
    target = e[ORDER:]
    solution, *_ = np.linalg.lstsq(past, target, rcond=1e-12)
    left = float(np.sum((target - past @ solution) ** 2)) / max(target.size - 2 * ORDER, 1)
    return float(max(0.0, 1 - left / np.mean(target**2)))


def _prewhitened(u: Array) -> Array:
    """Return the errors of predicting a signal from its own past, by least squares."""
    known = np.where(np.isfinite(u), u, np.nanmean(u))
    past = np.lib.stride_tricks.sliding_window_view(known - known.mean(), ORDER + 1)
    solution, *_ = np.linalg.lstsq(past[:, :-1], past[:, -1], rcond=1e-12)
    return np.asarray(past[:, -1] - past[:, :-1] @ solution)


def _per_sample(e: Array, S: Array, used: Bools) -> float:
    return float(-0.5 * np.mean(np.log(S[used]) + e[used] ** 2 / S[used]))
