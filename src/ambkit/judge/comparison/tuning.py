"""Tuning each estimator with the same effort: so many evaluations, no more and no fewer tricks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.batch import run_many
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison.candidates import Candidate, Range
from ambkit.judge.comparison.criteria import errors_along, rms

if TYPE_CHECKING:
    from ambkit.judge.comparison.cases import Trial

Array = NDArray[np.float64]

SIGNALS = ("x", "v", "f_d")
WORST = 10.0
"""What a run counts that is lost; the untuned linear filter's count 1."""


@dataclass(frozen=True)
class Tuning:
    """What tuning found."""

    values: Mapping[str, float]  #: Of the tunables.
    #: Mean over x, v and f_d of the RMSE on the training runs, each relative to the untuned linear
    #: filter's; with the values found, and with the defaults.
    objective: float
    default: float
    evaluations: int  #: How many were made.


def errors(build: Callable[[], Any], training: Sequence[Trial], first: int) -> Array:
    """Return the RMSE of x, v, f_d on each training run, (runs, 3); infinite where it is lost."""
    records = [trial.record for trial in training]
    estimator = build()
    if (
        isinstance(estimator, Estimator) and estimator.view.single and records
    ):  # which begins afresh in each run
        y, u, *truth = (np.array([r[name] for r in records]) for name in ("y", "u", *SIGNALS))
        many = run_many(
            estimator, y, u, truth=np.stack(truth, axis=-1), skip=first, history=(), threads=1
        )
        result = np.asarray(many.rmse, float)
    else:  # of several axes, or the user's own in Python
        result = np.empty((len(records), len(SIGNALS)))
        view = View(estimator.bearing)
        for row, record in zip(result, records, strict=True):
            made = estimator if isinstance(estimator, Estimator) else build()
            wrong = errors_along(made.run(record), record, view)
            row[:] = [rms(wrong[name][:, first:]) for name in SIGNALS]
    result[~np.isfinite(result[:, 0])] = math.inf
    return result


def tune(
    candidate: Candidate,
    training: Sequence[Trial],
    reference: Array,
    budget: int,
    first: int,
    seed: int = 0,
) -> Tuning:
    """Find values of an estimator's tunables by a fixed number of evaluations."""
    # The first evaluation is that of the defaults; up to half of them are scrambled Sobol points
    # over the whole range; the rest go to a simplex from the best of these (Nelder and Mead 1965).
    # reference (3,)

    def cost(values: Mapping[str, float]) -> float:
        result = errors(lambda: candidate.build(**values), training, first) / reference
        with np.errstate(invalid="ignore"):
            # A signal that it does not estimate at all is not in its mean.
            finite_costs = [
                float(np.minimum(c, WORST).mean()) for c in result.T if not np.isnan(c).any()
            ]
        return float(np.mean(finite_costs)) if finite_costs else WORST

    done = search(candidate.tunable, cost, budget, seed)
    best = done.best
    return Tuning(best.values, best.cost, done.tried[0].cost, len(done.tried))


class Tried(NamedTuple):
    """Values of the tunables, and what they cost."""

    values: Mapping[str, float]
    cost: float


class Search(NamedTuple):
    """All that was tried, in its order; the defaults first."""

    tried: Sequence[Tried]

    @property
    def best(self) -> Tried:
        """What costs least; the first of equals, and so the defaults where nothing is better."""
        return min(self.tried, key=lambda item: item.cost)


def search(
    tunable: Sequence[Range],
    cost: Callable[[Mapping[str, float]], float],
    budget: int,
    seed: int = 0,
    done: Callable[[], None] = lambda: None,
) -> Search:
    """Look for the values that cost least, by a fixed number of evaluations."""
    # See `tune`, which says how.
    trials: list[Tried] = []

    def at(point: Array) -> float:
        values = {
            item.name: item.low * (item.high / item.low) ** share if trials else item.default
            for item, share in zip(tunable, np.clip(point, 0, 1).tolist(), strict=True)
        }
        trials.append(Tried(values, cost(values)))
        done()
        return trials[-1].cost

    points = [np.array([math.log(t.default / t.low) / math.log(t.high / t.low) for t in tunable])]
    at(points[0])
    if not tunable or budget <= 1:
        return Search(trials)
    from scipy.optimize import minimize
    from scipy.stats import qmc

    count = max(1, budget // 2 - 1)
    sobol = qmc.Sobol(len(tunable), scramble=True, rng=np.random.default_rng([seed, 4]))
    for point in sobol.random_base2(math.ceil(math.log2(count)))[:count]:
        if len(trials) < budget:
            points.append(point)
            at(point)
    best = points[int(np.argmin([trial.cost for trial in trials]))]
    corners = np.vstack([best, *(best + _towards_middle(best, n) for n in range(best.size))])
    if budget > len(trials):
        minimize(at, best, method="Nelder-Mead", bounds=[(0.0, 1.0)] * best.size,
                 options={"maxfev": budget - len(trials), "initial_simplex": corners,
                          "xatol": 1e-4, "fatol": 1e-6})  # fmt: skip
    return Search(trials)


def _towards_middle(point: Array, axis: int) -> Array:
    move = np.zeros(point.size)
    move[axis] = 0.15 if point[axis] < 0.5 else -0.15
    return move
