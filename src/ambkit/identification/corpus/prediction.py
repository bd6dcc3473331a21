"""How a log is predicted by a model of the others, beside baselines that know no magnet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.innovations import whiteness
from ambkit.identification.corpus.baselines import AHEAD, ORDER, Baselines, fit_arx, fit_controls
from ambkit.identification.maximum_likelihood.likelihood import settling_time
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.validation import (
    AS_GOOD,
    is_consistent,
    is_explained,
    predictable,
)
from ambkit.result.row import Row

LAGS = 50  #: Of the correlation of the residuals.


@dataclass(frozen=True)
class Prediction:
    """How a log is predicted by a model of the others."""

    name: str  #: Of the log.
    samples: int  #: Measurements that count.
    #: RMS errors [m] by samples ahead: of the model, with the controls since and with those that
    #: the past lets expect; of the last measurement, held; of the constant-velocity filter and of
    #: the ARX model, which are fitted to the other logs as well.
    error: Mapping[int, float]
    without_later_controls: Mapping[int, float]
    held: Mapping[int, float]
    without_a_magnet: Mapping[int, float]
    arx: Mapping[int, float]
    floor: float  #: Noise of the measurement itself, as the model has it along this log, rms [m].
    nis: float  #: Mean normalised innovation squared; 1 where the noise is right.
    #: Share of 50 lags at which the residuals correlate no more than white ones would.
    white: float
    left: float  #: Share of the residuals' variance that their own past and the control's predict.

    @property
    def good(self) -> bool:
        """Whether nothing knows more of this log than the model."""
        # No baseline predicts it better, its noise is what the model expects, and hardly anything
        # of what is left could be predicted. The ARX model knows no later control, so it is held
        # against the model without these.
        known = (
            (self.error, self.held),
            (self.error, self.without_a_magnet),
            (self.without_later_controls, self.arx),
        )
        beaten = all(own[k] <= AS_GOOD * other[k] for k in AHEAD for own, other in known)
        return beaten and is_consistent(self.nis) and is_explained(self.left)

    def rows(self) -> list[Row]:
        """Return the figures as rows."""
        return [
            Row("samples", "samples", self.samples, detail=True),
            *(Row(f"{key}.{k}", f"{words} {k}", value, "m", 3)
              for k in AHEAD for key, words in KINDS.items()
              for value in [getattr(self, key)[k]]),
            Row("noise_floor", "noise", self.floor, "m", 3, detail=True),
            Row("nis", "NIS", self.nis, digits=3),
            Row("white_share", "white", self.white, "%"),
            Row("predictable_share", "left", self.left, "%"),
            Row("good", "good", self.good),
        ]  # fmt: skip


KINDS = {
    "error": "error",
    "without_later_controls": "alone",
    "arx": "ARX",
    "without_a_magnet": "velocity",
    "held": "held",
}
"""What the errors of a prediction are called in a table."""


def predict(
    name: str, records: Sequence[Record], model: LoopModel, others: Baselines
) -> Prediction:
    """Predict a log by a model that has not seen it, beside what knows no magnet."""
    naive = others.naive
    first = max(round(settling_time(model.bearing) / records[0].sampling_time) * 4, ORDER)
    misses: dict[str, dict[int, list[Array]]] = {kind: {k: [] for k in AHEAD} for kind in KINDS}
    residuals, squares, variances, controls = [], [], [], []
    linear = {k: fit_arx(others.normal[k], k) for k in AHEAD}
    expected = fit_controls(others.controls)
    for record in records:
        y = record["y"]
        e, S, used = model.innovations(record)
        used[:first] = False
        residuals.append((e / np.sqrt(S))[used])
        controls.append(record["u"][used])
        squares.append((e**2 / S)[used])
        share = 1 + model.bearing.sensor.position_noise * (y - model.position_offset)
        variances.append(model.bearing.sensor.noise_variance * np.clip(share, 1 / 8, 8)[used] ** 2)
        windows = expected.windows(record)
        for k in AHEAD:
            target = y[k:]
            uncontrolled = np.full(target.size, np.nan)
            uncontrolled[ORDER - 1 :] = model.predict_with(record, k, windows, ORDER)[: -k or None]
            for kind, guess in (
                ("error", model.predict(record, k)), ("without_later_controls", uncontrolled),
                ("held", y[:-k]), ("without_a_magnet", naive.predict(y, k)),
                ("arx", linear[k].predict(record)),
            ):  # fmt: skip
                misses[kind][k].append((target - guess)[first:])
    errors = {
        kind: {k: rms(np.concatenate(parts)) for k, parts in by.items()}
        for kind, by in misses.items()
    }
    residual = np.concatenate(residuals)
    return Prediction(
        name, residual.size, **errors,
        floor=rms(np.sqrt(np.concatenate(variances))),
        nis=float(np.mean(np.concatenate(squares))),
        white=whiteness(residual, LAGS).share_within,
        left=predictable(residual, np.concatenate(controls)),
    )  # fmt: skip


def rms(values: Array) -> float:
    """Return the root mean square of what is not missing."""
    return math.sqrt(float(np.nanmean(values**2)))
