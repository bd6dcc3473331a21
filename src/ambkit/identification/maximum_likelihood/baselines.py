"""Predictors without magnet model, fitted with equal effort: by cross-validation.

An ARX model for each horizon (Ljung 1999, ch. 4.2; its gains may be linear in the position), and a
state-space model of all signals (canonical variates of the past: Larimore 1990, "Canonical variate
analysis in identification, filtering, and adaptive control"). Both use the past only. The number of
lags and states, the control's duty and scheduling are chosen for the best prediction of parts of
the records that were not fitted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, interpolated
from ambkit.data.record import Record
from ambkit.estimate.errors import rms
from ambkit.identification.maximum_likelihood.loop_model import LoopModel

AHEAD = (1, 10)  #: Prediction horizons in samples.
LAGS = (30, 60, 90)  #: Candidate numbers of past samples of each signal.
STATES = (4, 6, 8, 12, 16, 24, 32)  #: Candidate numbers of states of the joint process.

PREDICTORS = {
    "error": ("model", "estimate", "model"),
    "of_start": ("initial model", "start", "initial model"),
    "without_later_controls": ("past only", "series 3", "model, without later controls"),
    "arx": ("ARX", "another", "ARX"),
    "subspace": ("subspace", "series 4", "subspace model"),
    "without_a_magnet": ("velocity", "series 2", "without a magnet"),
    "held": ("held", "constant", "last measurement held"),
}
"""Name, style in a figure and label of each predictor."""

FROM_THE_PAST = ("without_later_controls", "arx", "subspace")
"""Predictors with the controls expected from the past."""

SPARE = 2
"""Controls beyond the longest horizon: one for interpolation, one for a negative delay."""

FUTURE = AHEAD[-1] + SPARE  #: Future samples of each signal.
RIDGE = 1e-11  #: Ridge of the normal equations, whose diagonal is 1.
CHUNK = 4096  #: Samples whose regressors are stored at once.


@dataclass(frozen=True)
class Choice:
    """Structure of a predictor."""

    lags: int
    signals: tuple[str, ...]
    #: Whether it uses absolute signals: otherwise changes only, independent of offsets.
    levels: bool = True
    scheduled: bool = False  #: Whether its gains are linear in the position.
    states: int = 0  #: Number of states of a joint process; 0 for an ARX model.

    def __str__(self) -> str:
        changes = "" if self.levels else " of the changes"
        with_duty = ", with duty" * ("control" in self.signals)
        if self.states:
            return f"{self.states} states of {self.lags} lags{changes}{with_duty}"
        return f"{self.lags} lags{changes}{with_duty}{', linear in position' * self.scheduled}"


@dataclass(frozen=True)
class Layout:
    """Columns of the products: past, past times the position, future."""

    signals: tuple[str, ...]  #: y, u, and the duty where all records have it.
    lags: int  #: Maximum number of past samples.

    @property
    def past(self) -> int:
        """Columns of the past, with a constant."""
        return len(self.signals) * self.lags + 1

    def regressors(self, choice: Choice) -> list[int]:
        """Return the regressor columns of a model."""
        own = [
            s * self.lags + lag
            for s, name in enumerate(self.signals) if name in choice.signals
            for lag in range(self.lags - choice.lags, self.lags - (not choice.levels))
        ]  # fmt: skip
        scheduled = [self.past + k for k in own] if choice.scheduled else []
        return own + scheduled + [self.past - 1] * choice.levels

    def targets(self, name: str, ahead: Sequence[int]) -> list[int]:
        """Return the columns of a signal some samples ahead."""
        first = 2 * self.past + self.signals.index(name) * FUTURE - 1
        return [first + k for k in ahead]

    def columns(self, record: Record) -> Iterator[tuple[int, Array]]:
        """Yield the columns of a record (m, p) in chunks, with the sample of the first row."""
        # Samples are relative to the last one; a missing sample repeats the one before.
        after = np.full(FUTURE, np.nan)
        held = [np.append(_held(record[name]), after) for name in self.signals]
        width = self.lags + FUTURE
        windows = [np.lib.stride_tricks.sliding_window_view(one, width) for one in held]
        for begin in range(0, len(record) - self.lags + 1, CHUNK):
            parts = [one[begin : begin + CHUNK] for one in windows]
            last = [part[:, self.lags - 1 : self.lags].copy() for part in parts]
            parts = [part - now for part, now in zip(parts, last, strict=True)]
            for part, now in zip(parts, last, strict=True):
                part[:, self.lags - 1 : self.lags] = now
            past = np.hstack([*(part[:, : self.lags] for part in parts), np.ones_like(last[0])])
            future = [part[:, self.lags :] for part in parts]
            yield begin + self.lags - 1, np.hstack([past, past * last[0], *future])

    def products(self, record: Record) -> Array:
        """Return the sums of products (p, p) of all columns over the measured samples."""
        size = 2 * self.past + FUTURE * len(self.signals)
        total = np.zeros((size, size))
        measured = np.append(np.isfinite(record["y"]), np.zeros(FUTURE, bool))
        for first, rows in self.columns(record):
            at = first + np.arange(len(rows))
            known = np.all([measured[at + k] for k in (0, *AHEAD)], axis=0)
            kept = rows[known & np.isfinite(rows).all(axis=1)]
            total += kept.T @ kept
        return total


def _held(values: Array) -> Array:
    """Return samples (n,) with missing ones replaced by the last."""
    known = np.isfinite(values)
    if known.all() or not known.any():
        return interpolated(values)
    at = np.maximum.accumulate(np.where(known, np.arange(values.size), np.argmax(known)))
    return np.asarray(values[at])


def _solved(normal: Array, rows: Sequence[int], targets: Sequence[int]) -> Array:
    """Solve normal equations of regressors of very different sizes (rows, targets)."""
    from scipy.linalg import solve

    left, right = normal[np.ix_(rows, rows)], normal[np.ix_(rows, targets)]
    scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
    left = left / np.outer(scale, scale) + RIDGE * np.eye(len(rows))
    return np.asarray(solve(left, right / scale[:, None], assume_a="sym") / scale[:, None])


def _variates(layout: Layout, normal: Array, choice: Choice, states: int) -> Array:
    """Return the most predictive canonical variates of the past (rows, states)."""
    from scipy.linalg import solve_triangular

    rows = [k for k in layout.regressors(choice) if k != layout.past - 1]
    constant = layout.past - 1
    future = [k for name in choice.signals for k in layout.targets(name, range(1, FUTURE + 1))]
    count = normal[constant, constant]
    mean = normal[constant] / count
    covariance = normal / count - np.outer(mean, mean)
    roots, scales = [], []
    for own in (rows, future):
        part = covariance[np.ix_(own, own)]
        scales.append(np.sqrt(np.maximum(np.diag(part), 1e-300)))
        part = part / np.outer(scales[-1], scales[-1])
        roots.append(np.linalg.cholesky(part + 1e-9 * np.eye(len(own))))
    cross = covariance[np.ix_(future, rows)] / np.outer(scales[1], scales[0])
    cross = solve_triangular(roots[1], cross, lower=True)
    cross = solve_triangular(roots[0], cross.T, lower=True).T
    _, _, right = np.linalg.svd(cross, full_matrices=False)
    variates = solve_triangular(roots[0], right[:states].T, lower=True, trans="T")
    return np.asarray(variates / scales[0][:, None])


def _fitted(layout: Layout, normal: Array, choice: Choice, targets: Sequence[int]) -> Array:
    """Return the weights of a model's regressors (rows, targets)."""
    rows = layout.regressors(choice)
    if not choice.states:
        return _solved(normal, rows, targets)
    return _of_states(
        layout, normal, choice, targets, _variates(layout, normal, choice, choice.states)
    )


def _of_states(
    layout: Layout, normal: Array, choice: Choice, targets: Sequence[int], variates: Array
) -> Array:
    """Return the weights (rows, targets) of a model with a state space of the past."""
    from scipy.linalg import block_diag

    rows = layout.regressors(choice)
    basis = block_diag(variates, *[[1.0]] * choice.levels)
    left = basis.T @ normal[np.ix_(rows, rows)] @ basis
    right = basis.T @ normal[np.ix_(rows, targets)]
    return np.asarray(basis @ np.linalg.lstsq(left, right, rcond=1e-12)[0])


@dataclass(frozen=True, eq=False)
class Baselines:
    """Predictors without magnet model, fitted to parts of some records."""

    layout: Layout
    parts: Sequence[Array]  #: Products of each part.

    @classmethod
    def of(cls, records: Sequence[Sequence[Record]]) -> list[Baselines]:
        """Return those of each log, given its records."""
        every = [record for log in records for record in log]
        shortest = min(map(len, every))
        lags = max((lags for lags in LAGS if 4 * lags <= shortest), default=LAGS[0])
        duty = ("control",) * all("control" in record for record in every)
        layout = Layout(("y", "u", *duty), lags)
        return [
            cls(layout, [np.sum([layout.products(record) for record in log], axis=0)])
            for log in records
        ]

    @classmethod
    def joint(cls, several: Sequence[Baselines]) -> Baselines:
        """Return those of several logs."""
        return cls(several[0].layout, [part for one in several for part in one.parts])

    @cached_property
    def normal(self) -> Array:
        """Sums of products over all parts."""
        return np.asarray(np.sum(self.parts, axis=0))

    @cached_property
    def chosen(self) -> dict[str, Mapping[int, Choice]]:
        """Structure of each kind at each horizon."""
        return {"arx": self._arx(), "subspace": self._subspace()}

    def _arx(self) -> dict[int, Choice]:
        return self._best([
            Choice(lags, self.layout.signals[:count], levels, scheduled)
            for lags in LAGS if lags <= self.layout.lags
            for count in range(2, len(self.layout.signals) + 1)
            for levels in (False, True)
            for scheduled in (False, True)
        ])  # fmt: skip

    def _subspace(self) -> dict[int, Choice]:
        return self._best([
            Choice(self.layout.lags, self.layout.signals[:count], levels, states=states)
            for count in range(2, len(self.layout.signals) + 1)
            for levels in (False, True)
            for states in STATES
        ])  # fmt: skip

    def _best(self, choices: Sequence[Choice]) -> dict[int, Choice]:
        """Return for each horizon the structure with the best cross-validation."""
        targets = self.layout.targets("y", AHEAD)
        cost = np.zeros((len(choices), len(AHEAD)))
        for part in self.parts:
            rest = self.normal - part if len(self.parts) > 1 else part
            known: dict[tuple[Any, ...], Array] = {}
            for k, choice in enumerate(choices):
                if choice.states:
                    key = choice.signals, choice.levels
                    if key not in known:
                        known[key] = _variates(self.layout, rest, choice, STATES[-1])
                    variates = known[key][:, : choice.states]
                    weights = _of_states(self.layout, rest, choice, targets, variates)
                else:
                    weights = _fitted(self.layout, rest, choice, targets)
                cost[k] += _misses(part, self.layout.regressors(choice), targets, weights)
        return {ahead: choices[int(np.argmin(cost[:, k]))] for k, ahead in enumerate(AHEAD)}

    def predictions(self, model: LoopModel, record: Record) -> dict[str, dict[int, Array]]:
        """Return each prediction of ``y[k + ahead]`` from sample k and its past [m]."""
        # NaN at first; by kind and horizon.
        return {"without_later_controls": self._with_expected_controls(model, record)} | {
            kind: {k: self._predicted(record, of[k], "y", [k])[:-k, 0] for k in AHEAD}
            for kind, of in self.chosen.items()
        }  # fmt: skip

    def _with_expected_controls(self, model: LoopModel, record: Record) -> dict[int, Array]:
        """Return a model's predictions with the controls expected from the past [m]."""
        lags, choice = self.layout.lags, Choice(self.layout.lags, self.layout.signals)
        expected = self._predicted(record, choice, "u", range(1, FUTURE + 1))[lags - 1 :]
        past = np.lib.stride_tricks.sliding_window_view(_held(record["u"]), lags)
        controls = np.column_stack([past, expected])
        result = {k: np.full(len(record) - k, np.nan) for k in AHEAD}
        for k, values in result.items():
            values[lags - 1 :] = model.predict_with(record, k, controls, lags)[:-k]
        return result

    def _predicted(self, record: Record, choice: Choice, name: str, ahead: Sequence[int]) -> Array:
        """Return a signal some samples ahead (n, ahead)."""
        rows, targets = self.layout.regressors(choice), self.layout.targets(name, ahead)
        weights = _fitted(self.layout, self.normal, choice, targets)
        result = np.full((len(record), len(targets)), np.nan)
        for first, columns in self.layout.columns(record):
            result[first : first + len(columns)] = columns[:, rows] @ weights
        return result + _held(record[name])[:, None]


def _misses(normal: Array, rows: Sequence[int], targets: Sequence[int], weights: Array) -> Array:
    """Return the residual sums of squares (targets,) of weights (rows, targets) in a part."""
    own = normal[np.ix_(rows, rows)]
    squares = np.diag(normal)[list(targets)]
    both = normal[np.ix_(rows, targets)]
    return np.asarray(
        squares - 2 * np.sum(weights * both, axis=0) + np.sum(weights * (own @ weights), axis=0)
    )


PARTS = 5  #: Parts of records for cross-validation.


def errors_from_the_past(
    model: LoopModel, fitted_to: Sequence[Record], record: Record, settling: int
) -> dict[str, dict[int, float]]:
    """Return RMS errors [m] of predictions from the past of a record, by kind and horizon."""
    # For a fit to the record itself, by cross-validation over its parts. Empty for a short record.
    seen = [(one, part) for one in fitted_to for part in _parts(one)]
    if min(len(part) for _, part in [*seen, (record, record)]) < 4 * LAGS[0] + settling:
        return {}
    fitted = Baselines.of([[part] for _, part in seen])
    pairs = [(part, fitted[:k] + fitted[k + 1 :])
             for k, (one, part) in enumerate(seen) if one is record]  # fmt: skip
    misses: dict[str, dict[int, list[Array]]] = {}
    for part, others in pairs or [(record, fitted)]:
        first = max(settling, others[0].layout.lags)
        for kind, by in Baselines.joint(others).predictions(model, part).items():
            for k, guess in by.items():
                of_kind = misses.setdefault(kind, {k: [] for k in AHEAD})
                of_kind[k].append((part["y"][k:] - guess)[first:])
    return {
        kind: {k: rms(np.concatenate(errors)) for k, errors in by.items()}
        for kind, by in misses.items()
    }


def _parts(record: Record) -> list[Record]:
    """Divide a record into parts of equal length."""
    edges = np.linspace(0, len(record), PARTS + 1).astype(int)
    return [
        replace(record, t=record.t[a:b], signals={n: record[n][a:b] for n in record})
        for a, b in pairwise(edges.tolist())
    ]
