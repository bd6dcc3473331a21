"""How a log is predicted by a model of the others, beside baselines that know no magnet."""

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
    """How a log is predicted by a model of the others."""

    name: str  #: Of the log.
    samples: int  #: Measurements that count.
    #: RMS errors [m] by samples ahead: of the model, with the controls since and with those that
    #: the past lets expect; of the last measurement, held; of the constant-velocity filter, the ARX
    #: model and the joint process of all signals, which are fitted to the other logs as well.
    error: Mapping[int, float]
    without_later_controls: Mapping[int, float]
    held: Mapping[int, float]
    without_a_magnet: Mapping[int, float]
    arx: Mapping[int, float]
    subspace: Mapping[int, float]
    chosen: Mapping[str, Mapping[int, str]]  #: What the ARX model and the process are made of.
    floor: float  #: Noise of the measurement itself, as the model has it along this log, rms [m].
    nis: float  #: Mean normalised innovation squared; 1 where the noise is right.
    #: Share of 50 lags at which the residuals correlate no more than white ones would.
    white: float
    left: float  #: Share of the residuals' variance that their own past and the control's predict.

    @property
    def good(self) -> bool:
        """Whether the model passes all checks on this log."""
        # No baseline predicts it better, its noise is what the model expects, and hardly anything
        # of what is left could be predicted. ARX model and process know no later control, so they
        # are held against the model without these.
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
        """Which of those that know the past only predicts best at the longest horizon."""
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
"""Of each kind of prediction: name in a table, style and label in a picture."""

PAST_ONLY = {
    **{kind: name for kind, (name, _) in FROM_THE_PAST.items()},
    "without_a_magnet": "velocity", "held": "held",
}  # fmt: skip
"""Who predicts from the past alone, and what a table calls it."""


def in_the_mean(several: Sequence[ConstantVelocityFilter]) -> ConstantVelocityFilter:
    """Return the filter between those that several logs are tuned to."""
    q, R = (math.exp(fmean(math.log(getattr(one, name)) for one in several)) for name in ("q", "R"))
    return ConstantVelocityFilter(several[0].T, q, R)


def predict(
    name: str,
    records: Sequence[Record],
    model: LoopModel,
    others: Baselines,
    naive: ConstantVelocityFilter,
) -> Prediction:
    """Predict a log by a model that has not seen it, beside what knows no magnet."""
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
