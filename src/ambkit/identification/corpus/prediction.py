"""How a log is predicted by a model of the others, beside baselines that know no magnet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.estimate.constant_velocity import ConstantVelocityFilter, tune
from ambkit.estimate.errors import rms, whiteness
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.validation import (
    AS_GOOD,
    is_consistent,
    is_explained,
    predictable,
)
from ambkit.machine.magnets import own_time
from ambkit.result.row import Row

ORDER = 30  #: Past samples of each signal.
AHEAD = (1, 10)  #: Samples ahead that are predicted.

SPARE = 2
"""Controls more than these that are expected: one between whose two a line goes, one of a delay
below zero."""


def regressors(record: Record, ahead: int) -> tuple[Array, Array]:
    """Return regressors (m, 2 ORDER) and the last positions (m,), of samples from ORDER - 1 on."""
    # Past positions less the last one, controls, and a constant.
    windows = np.lib.stride_tricks.sliding_window_view
    y, u = (windows(record[name], ORDER)[: len(record) - ORDER + 1 - ahead] for name in ("y", "u"))
    last = y[:, -1]
    return np.column_stack([y[:, :-1] - last[:, None], u, np.ones(len(last))]), last


def _products(rows: Array, targets: Array) -> Array:
    """Return what a record adds to normal equations, of the samples that miss nothing."""
    # rows (n, p); targets (n,), (n, q); returns (p, p + q)
    both = np.column_stack([rows, targets])
    finite_rows = np.isfinite(both).all(axis=1)
    if not finite_rows.all():
        both = both[finite_rows]
    return np.asarray(both[:, : rows.shape[1]].T @ both)


def _solved(normal: Array) -> Array:
    """Solve normal equations of regressors of very different sizes."""
    # normal (p, p + q); returns (p, q)
    p = len(normal)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    left, right = normal[:, :p] / np.outer(scale, scale), normal[:, p:] / scale[:, None]
    weights, *_ = np.linalg.lstsq(left, right, rcond=1e-12)
    return np.asarray(weights / scale[:, None])


@dataclass(frozen=True, eq=False)
class Baselines:
    """What predicts without knowing a magnet, fitted to some logs."""

    naive: ConstantVelocityFilter  #: Tuned by the likelihood.
    normal: Mapping[int, Array]  #: Samples ahead, and the normal equations of an ARX model.
    controls: Array  #: Normal equations of the controls that are to be expected.

    @classmethod
    def of(cls, records: Sequence[Record]) -> Baselines:
        """Fit them to the flights of one log."""
        normal = {
            k: np.sum([
                _products(rows, record["y"][ORDER - 1 + k :] - last)
                for record in records for rows, last in [regressors(record, k)]
            ], axis=0)
            for k in AHEAD
        }  # fmt: skip
        ahead = AHEAD[-1] + SPARE
        controls = [
            _products(
                np.column_stack(regressors(record, ahead)),
                np.lib.stride_tricks.sliding_window_view(record["u"][ORDER:], ahead),
            )
            for record in records
        ]
        naive = tune([record["y"] for record in records], records[0].sampling_time)
        return cls(naive, normal, np.sum(controls, axis=0))

    @classmethod
    def together(cls, several: Sequence[Baselines]) -> Baselines:
        """Return those of several logs: one ARX model, and what they tune to in the mean."""
        q, R = (
            math.exp(float(np.mean([math.log(getattr(one.naive, name)) for one in several])))
            for name in ("q", "R")
        )
        normal = {k: np.sum([one.normal[k] for one in several], axis=0) for k in AHEAD}
        controls = np.sum([one.controls for one in several], axis=0)
        return cls(ConstantVelocityFilter(several[0].naive.T, q, R), normal, controls)

    def arx(self, record: Record, ahead: int) -> Array:
        """Return predictions of ``y[k + ahead]`` from sample k on [m], NaN for the first ones."""
        rows, last = regressors(record, ahead)
        result = np.full(len(record) - ahead, np.nan)
        result[ORDER - 1 :] = last + rows @ _solved(self.normal[ahead])[:, 0]
        return result


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
        """Whether the model passes all checks on this log."""
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
              for k in AHEAD for key, (words, _, _) in KINDS.items()
              for value in [getattr(self, key)[k]]),
            Row("noise_floor", "noise floor", self.floor, "m", 3, detail=True),
            Row("nis", "NIS", self.nis, digits=3),
            Row("white_share", "white lags", self.white, "%"),
            Row("predictable_share", "predictable", self.left, "%"),
            Row("good", "good", self.good),
        ]  # fmt: skip


KINDS = {
    "error": ("error", "estimate", "model of the others"),
    "without_later_controls": ("past only", "series 3", "model, without later controls"),
    "arx": ("ARX", "series 1", "ARX"),
    "without_a_magnet": ("velocity", "series 2", "without a magnet"),
    "held": ("held", "constant", "last measurement held"),
}
"""Of each kind of prediction: name in a table, style and label in a picture."""


def predict(
    name: str, records: Sequence[Record], model: LoopModel, others: Baselines
) -> Prediction:
    """Predict a log by a model that has not seen it, beside what knows no magnet."""
    first = max(round(own_time(model.isolated) / records[0].sampling_time) * 4, ORDER)
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
        rows, u_part = np.column_stack(regressors(record, 0)), slice(ORDER - 1, 2 * ORDER - 1)
        # The last controls and those to be expected (m, ORDER + ahead) [V].
        windows = np.column_stack([rows[:, u_part], rows @ _solved(others.controls)])
        for k in AHEAD:
            target = y[k:]
            uncontrolled = np.full(target.size, np.nan)
            uncontrolled[ORDER - 1 :] = model.predict_with(record, k, windows, ORDER)[: -k or None]
            for kind, guess in (
                ("error", model.predict(record, k)), ("without_later_controls", uncontrolled),
                ("held", y[:-k]), ("without_a_magnet", others.naive.predict(y, k)),
                ("arx", others.arx(record, k)),
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
        white=whiteness(residual).share_within,
        left=predictable(residual, np.concatenate(controls)),
    )  # fmt: skip
