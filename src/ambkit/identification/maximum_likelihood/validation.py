"""Validation of a model on other records, beside baselines without magnet model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import RecordError
from ambkit.data.reading.faults import spike_free
from ambkit.data.record import Record
from ambkit.estimate.constant_velocity import ConstantVelocityFilter, tune
from ambkit.estimate.errors import LAGS, Whiteness, correlated, rms, whiteness
from ambkit.identification.maximum_likelihood.baselines import (
    AHEAD,
    FROM_THE_PAST,
    PREDICTORS,
    Baselines,
)
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.result.row import Row

HORIZONS = (1, 2, 5, 10, 20, 50)  #: Default horizons in samples.

ORDER = 30
"""Number of past samples that predict the control signal, see `cross_correlation`."""

AS_GOOD = 1.02  #: Ratio to a baseline's error that counts as no worse.
LEFT = 0.05  #: Predictable share of a residual's variance that is acceptable.
NIS = (0.8, 1.25)  #: Mean normalised innovation squared that is consistent.
WHITE = 0.9  #: Share of lags within the 95 % bounds from which residuals count as white.

Errors = Mapping[str, Mapping[int, float]]


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a model on a record."""

    name: str  #: Name of the record.
    samples: int  #: Number of counted measurements.
    #: RMS errors [m] of each of `PREDICTORS` by samples ahead. Those from the past only are missing
    #: for a short record, and for an axis among others; the initial model's without one.
    errors: Errors
    spread: Mapping[int, float]  #: Standard deviation of the predicted positions [m], by horizon.
    residual: Whiteness  #: Autocorrelation of the residuals at lags 1, 2, ... with its 95 % bound.
    #: Correlation of the residuals with the prewhitened control signal 1, 2, ... samples before,
    #: with its bound. With later control signals a loop correlates in any case.
    cross: Whiteness
    nis: float  #: Mean normalised innovation squared; 1 if the noise is right.
    #: Share of the residuals' variance predictable from their past and the control signal's.
    left: float
    floor: float  #: Rms measurement noise according to the model along this record [m].
    gain: float = math.nan  #: Log likelihood per sample over that of the initial model.
    #: Structure of the ARX model and of the joint process, by horizon.
    chosen: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    #: Structural defects of the model according to the records of its identification.
    suspect: str = ""

    def fit(self, kind: str = "error") -> dict[int, float]:
        """Return the fit of a predictor [%] by horizon; 100 is perfect, 0 a constant."""
        # 100 minus the RMS error over the position's standard deviation (NRMSE, Ljung 1999).
        return {
            k: 100 * (1 - error / self.spread[k]) if self.spread.get(k, 0.0) > 0 else math.nan
            for k, error in self.errors.get(kind, {}).items()
        }

    def better(self, kind: str, tolerance: float = AS_GOOD) -> bool:
        """Whether a baseline predicts better than the model with the same information."""
        own = self.errors.get("without_later_controls" if kind in FROM_THE_PAST else "error", {})
        other = self.errors.get(kind, {})
        return any(own[k] > tolerance * other[k] for k in AHEAD if k in own and k in other)

    @property
    def best(self) -> str | None:
        """Best predictor from the past only at the longest horizon, if there are several."""
        known = [k for k in PREDICTORS if k not in ("error", "of_start") and k in self.errors]
        if not set(FROM_THE_PAST) <= set(known):
            return None
        return min(known, key=lambda kind: self.errors[kind][AHEAD[-1]])

    @property
    def good(self) -> bool:
        """Whether the model passes all checks on this record."""
        return not self._objections

    @property
    def _objections(self) -> list[str]:
        more = "larger" if self.nis > 1 else "smaller"
        texts = {
            f"The structure of the model is suspect: {self.suspect}.": bool(self.suspect),
            "The model predicts no better than the last measurement held.":
                self.better("held", 1.0),
            "A filter without a magnet predicts better.": self.better("without_a_magnet"),
            f"The initial model was more likely, by {-self.gain:.3f} per sample: the identified "
            "parameters do not hold here.": self.gain < 0,
            "Much of the residuals is predictable: a better model would predict more.":
                not self.left < LEFT,
            f"The residuals are {more} than expected: mean NIS {self.nis:.2f}, should be 1.":
                not NIS[0] < self.nis < NIS[1],
        }  # fmt: skip
        return [text for text, holds in texts.items() if holds]

    @property
    def verdict(self) -> str:
        """Objections to the model, in sentences."""
        # A failed test of whiteness is no objection by itself: in a long record it reveals
        # insignificant effects. Nor is a black box that predicts better: it knows no structure.
        past = [PREDICTORS[kind][0] for kind in FROM_THE_PAST if self.better(kind)]
        remarks = {
            f"From the past alone, {' and '.join(past)} predicted better: with more parameters, "
            "they fit the spectrum of the disturbance force too. This is no objection to the "
            "structure of the model.": bool(past),
            "The residuals are not white: some motion is unexplained, or the noise is "
            "coloured.": self.residual.share_within < WHITE,
            "The residuals depend on the control signal: force law, delay or lag is incomplete.":
                self.cross.share_within < WHITE,
        }  # fmt: skip
        texts = [*self._objections, *(text for text, holds in remarks.items() if holds)]
        return " ".join(texts) or "The model passes all checks."

    def rows(self) -> list[Row]:
        """Return the figures as rows."""
        last, start = AHEAD[-1], self.fit("of_start")
        best = [] if self.best is None else [
            Row("best", f"best of the past {last}", PREDICTORS[self.best][0])
        ]  # fmt: skip
        return [
            Row("samples", "samples", self.samples, detail=True),
            Row("fit", f"fit, {last} samples ahead", self.fit()[last] / 100, "%"),
            *(Row("fit_of_start", "  initial model", start[k] / 100, "%")
              for k in start if k == last),
            *(Row(f"{kind}.{k}", f"{words} {k}", self.errors[kind][k], "m", 3)
              for k in AHEAD for kind, (words, _, _) in PREDICTORS.items()
              if kind in self.errors and kind != "of_start"),
            *best,
            *(Row(f"{kind}_model.{k}", f"{PREDICTORS[kind][0]} {k}, chosen", text, detail=True)
              for kind, by in self.chosen.items() for k, text in by.items()),
            Row("noise_floor", "noise floor", self.floor, "m", 3, detail=True),
            Row("nis", "NIS", self.nis, digits=3),
            Row("white_share", "white lags", self.residual.share_within, "%"),
            Row("cross_share", "lags independent of u", self.cross.share_within, "%"),
            Row("predictable_share", "predictable", self.left, "%"),
            *(Row("gain", "gain of log-likelihood per sample", self.gain)
              for _ in range(math.isfinite(self.gain))),
            Row("good", "good", self.good),
        ]  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return the errors over the horizon and the verdict as plain data for JSON."""
        errors = {kind: {str(k): e for k, e in by.items()} for kind, by in self.errors.items()}
        return {
            "record": self.name, "rms_error": errors, "good": self.good, "verdict": self.verdict,
        }  # fmt: skip


def validate(
    model: LoopModel,
    records: Record | Sequence[Record],
    *,
    start: LoopModel | None = None,
    horizons: Sequence[int] = HORIZONS,
    settling: float = 0.0,
    name: str = "",
    naive: ConstantVelocityFilter | None = None,
    baselines: Baselines | None = None,
) -> Validation:
    """Validate a model on a record or the parts of one; `naive` is tuned to it by default."""
    several = [
        spike_free(one)[0] for one in ([records] if isinstance(records, Record) else records)
    ]
    T = several[0].sampling_time
    first = max(1, round(settling / T))
    least, n = first + max(horizons) + 4 * LAGS, max(map(len, several))
    if n < least:
        raise RecordError(
            f"{name or 'the record'} has {n} samples; {least} are needed to validate a model"
        )
    naive = naive or tune([one["y"] for one in several], T)
    misses: dict[str, dict[int, list[Array]]] = {}
    residuals, masks, levels, gains = [], [], [], []
    for record in several:
        y = record["y"]
        e, S, used = model.innovations(record)
        used[:first] = False
        guesses = {} if baselines is None else baselines.predictions(model, record)
        guesses |= _guesses({"error": model, "of_start": start}, naive, record, horizons)
        if start is not None:
            e_start, S_start, used_start = start.innovations(record)
            gains.append(_per_sample(e, S, used) - _per_sample(e_start, S_start, used & used_start))
        for kind, by in guesses.items():
            for k, guess in by.items():
                misses.setdefault(kind, {}).setdefault(k, []).append((y[k:] - guess)[first:])
        residuals.append(np.where(used, e / np.sqrt(S), 0.0)[first:])
        masks.append(used[first:])
        levels.append(_noise(model, y)[used])
    used, u = np.concatenate(masks), np.concatenate([one["u"][first:] for one in several])
    if not used.any():
        raise RecordError(f"{name or 'the record'}: no measurement could be used")
    residual = np.concatenate(residuals)
    return Validation(
        name,
        int(used.sum()),
        {kind: {k: rms(np.concatenate(e)) for k, e in by.items()} for kind, by in misses.items()},
        {k: float(np.nanstd(np.concatenate([one["y"][first + k :] for one in several])))
         for k in horizons},
        residual=whiteness(residual[used]),
        cross=cross_correlation(residual, u),
        nis=float(np.mean(residual[used] ** 2)),
        left=predictable(residual[used], u[used]),
        floor=rms(np.concatenate(levels)),
        gain=gains[0] if gains else math.nan,
        chosen={} if baselines is None else {
            kind: {k: str(choice) for k, choice in by.items()}
            for kind, by in baselines.chosen.items()
        },
    )  # fmt: skip


def _guesses(
    models: Mapping[str, LoopModel | None], naive: ConstantVelocityFilter, record: Record,
    horizons: Sequence[int],
) -> dict[str, dict[int, Array]]:  # fmt: skip
    """Return the predictions of positions by predictor and horizon [m]."""
    y = record["y"]
    return {
        kind: {k: model.predict(record, k) for k in horizons}
        for kind, model in models.items() if model is not None
    } | {
        "held": {k: y[:-k] for k in horizons},
        "without_a_magnet": {k: naive.predict(y, k) for k in horizons},
    }  # fmt: skip


def cross_correlation(residual: Array, u: Array) -> Whiteness:
    """Correlate residuals with an input of the past, after Box and Jenkins (1976, ch. 11)."""
    # The input of a loop is so coloured that one chance correlation would appear at all lags. Its
    # predictable part is removed first: then the lags are independent, and the bound is that of
    # white noise. residual (n,); u (n,)
    e = residual - residual.mean()
    w = _prewhitened(u)
    return correlated(e[e.size - w.size :], w)


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


def _noise(model: LoopModel, y: Array) -> Array:
    """Return the standard deviation of the measurement noise at positions (n,) [m]."""
    sensor = model.isolated.sensor
    share = 1 + sensor.position_noise * (y - model.position_offset)
    return np.asarray(math.sqrt(sensor.noise_variance) * np.clip(share, 1 / 8, 8))


def _per_sample(e: Array, S: Array, used: Bools) -> float:
    return float(-0.5 * np.mean(np.log(S[used]) + e[used] ** 2 / S[used]))
