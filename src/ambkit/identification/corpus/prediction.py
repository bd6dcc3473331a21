"""Prediction of a log by a model of the others, and by baselines without magnet model."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.constant_velocity import ConstantVelocityFilter
from ambkit.estimate.errors import rms, whiteness
from ambkit.identification.maximum_likelihood.baselines import AHEAD, FROM_THE_PAST, Baselines
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.validation import (
    AS_GOOD,
    is_consistent,
    is_explained,
    predictable,
)
from ambkit.machine.magnets import own_time
from ambkit.result.row import Row


@dataclass(frozen=True)
class Prediction:
    """Prediction of a log by a model of the others."""

    name: str  #: Name of the log.
    samples: int  #: Number of evaluated measurements.
    #: RMS errors by samples ahead: of the model, with the true later controls and with those
    #: expected from the past; of the last measurement, held; of the constant-velocity filter, the
    #: ARX model and the joint process of all signals, which are fitted to the other logs too.
    error: Mapping[int, float]
    without_later_controls: Mapping[int, float]
    held: Mapping[int, float]
    without_a_magnet: Mapping[int, float]
    arx: Mapping[int, float]
    subspace: Mapping[int, float]
    chosen: Mapping[str, Mapping[int, str]]  #: Structure of the ARX model and the process.
    floor: float  #: Rms measurement noise according to the model along this log [m].
    nis: float  #: Mean normalised innovation squared; 1 if the noise is right.
    #: Share of 50 lags with residual correlations within the bounds of white noise.
    white: float
    #: Share of the residuals' variance that is predictable from their past and the control's.
    left: float

    @property
    def good(self) -> bool:
        """Whether the model passes all checks on this log."""
        # No baseline predicts better, the noise agrees with the model, and hardly any of the
        # residuals is predictable. ARX model and process use no later controls, so they are
        # compared with the model without these.
        known = (
            (self.error, self.held),
            (self.error, self.without_a_magnet),
            (self.without_later_controls, self.arx),
            (self.without_later_controls, self.subspace),
        )
        beaten = all(own[k] <= AS_GOOD * other[k] for k in AHEAD for own, other in known)
        return beaten and is_consistent(self.nis) and is_explained(self.left)

    @property
    def best(self) -> str:
        """Best predictor from the past only at the longest horizon."""
        return min(PAST_ONLY, key=lambda kind: getattr(self, kind)[AHEAD[-1]])

    def rows(self) -> list[Row]:
        """Return the figures as rows."""
        return [
            Row("samples", "samples", self.samples, detail=True),
            *(Row(f"{key}.{k}", f"{words} {k}", value, "m", 3)
              for k in AHEAD for key, (words, _, _) in KINDS.items()
              for value in [getattr(self, key)[k]]),
            Row("best", f"best of the past {AHEAD[-1]}", PAST_ONLY[self.best]),
            *(Row(f"{kind}_model.{k}", f"{KINDS[kind][0]} {k}, chosen", text, detail=True)
              for kind, by in self.chosen.items() for k, text in by.items()),
            Row("noise_floor", "noise floor", self.floor, "m", 3, detail=True),
            Row("nis", "NIS", self.nis, digits=3),
            Row("white_share", "white lags", self.white, "%"),
            Row("predictable_share", "predictable", self.left, "%"),
            Row("good", "good", self.good),
        ]  # fmt: skip


KINDS = {
    "error": ("error", "estimate", "model of the others"),
    "without_later_controls": ("past only", "series 3", "model, without later controls"),
    "arx": ("ARX", "another", "ARX"),
    "subspace": ("subspace", "series 4", "subspace model"),
    "without_a_magnet": ("velocity", "series 2", "without a magnet"),
    "held": ("held", "constant", "last measurement held"),
}
"""Name, style and label of each kind of prediction."""

PAST_ONLY = {
    **{kind: name for kind, (name, _) in FROM_THE_PAST.items()},
    "without_a_magnet": "velocity", "held": "held",
}  # fmt: skip
"""Predictors from the past only, and their names in a table."""


def in_the_mean(several: Sequence[ConstantVelocityFilter]) -> ConstantVelocityFilter:
    """Return the mean of filters tuned to several logs."""
    q, R = (math.exp(fmean(math.log(getattr(one, name)) for one in several)) for name in ("q", "R"))
    return ConstantVelocityFilter(several[0].T, q, R)


def predict(
    name: str,
    records: Sequence[Record],
    model: LoopModel,
    others: Baselines,
    naive: ConstantVelocityFilter,
) -> Prediction:
    """Predict a log by a model of the others, and by baselines without magnet model."""
    lags = others.layout.lags
    first = max(round(own_time(model.isolated) / records[0].sampling_time) * 4, lags)
    misses: dict[str, dict[int, list[Array]]] = {kind: {k: [] for k in AHEAD} for kind in KINDS}
    residuals, squares, variances, controls = [], [], [], []
    for record in records:
        y = record["y"]
        e, S, used = model.innovations(record)
        used[:first] = False
        residuals.append((e / np.sqrt(S))[used])
        controls.append(record["u"][used])
        squares.append((e**2 / S)[used])
        share = 1 + model.isolated.sensor.position_noise * (y - model.position_offset)
        variances.append(model.isolated.sensor.noise_variance * np.clip(share, 1 / 8, 8)[used] ** 2)
        guesses = others.predictions(model, record) | {
            "error": {k: model.predict(record, k) for k in AHEAD},
            "held": {k: y[:-k] for k in AHEAD},
            "without_a_magnet": {k: naive.predict(y, k) for k in AHEAD},
        }
        for kind, by in guesses.items():
            for k, guess in by.items():
                misses[kind][k].append((y[k:] - guess)[first:])
    errors = {
        kind: {k: rms(np.concatenate(parts)) for k, parts in by.items()}
        for kind, by in misses.items()
    }
    residual = np.concatenate(residuals)
    return Prediction(
        name, residual.size, **errors,
        chosen={kind: {k: str(choice) for k, choice in by.items()}
                for kind, by in others.chosen.items()},
        floor=rms(np.sqrt(np.concatenate(variances))),
        nis=float(np.mean(np.concatenate(squares))),
        white=whiteness(residual).share_within,
        left=predictable(residual, np.concatenate(controls)),
    )  # fmt: skip
