"""Tuning each estimator with the same effort: so many evaluations, no more and no fewer tricks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.judge.comparison.contenders import Contender
from ambkit.judge.comparison.criteria import rms

if TYPE_CHECKING:
    from ambkit.judge.comparison.cases import Trial

Array = NDArray[np.float64]

SIGNALS = ("x", "v", "f_d")
WORST = 10.0
"""What a run counts that is lost; the untuned linear filter's count 1."""


@dataclass(frozen=True)
class Tuning:
    """What tuning found.

    Attributes
    ----------
    values : dict of str to float
        Of the tunables.
    objective, default : float
        Mean over x, v and f_d of the RMSE on the training runs, each relative to the untuned linear
        filter's; with the values found, and with the defaults.
    evaluations : int
        How many were made.
    """

    values: Mapping[str, float]
    objective: float
    default: float
    evaluations: int


def errors(build: Callable[[], object], training: Sequence[Trial], first: int) -> Array:
    """Return the RMSE of x, v, f_d on each training run, (runs, 3); infinite where it is lost."""
    found = np.empty((len(training), len(SIGNALS)))
    for row, trial in zip(found, training, strict=True):
        estimate = build().run(trial.record)  # type: ignore[attr-defined]
        row[:] = [rms((estimate[name] - trial.record[name])[first:]) for name in SIGNALS]
        if not np.isfinite(row[0]):
            row[:] = math.inf
    return found


def tune(
    contender: Contender,
    training: Sequence[Trial],
    reference: Array,
    budget: int,
    first: int,
    seed: int = 0,
) -> Tuning:
    """Find values of an estimator's tunables by a fixed number of evaluations.

    The first evaluation is that of the defaults; up to half of them are scrambled Sobol points over
    the whole range; the rest go to a simplex from the best of these (Nelder and Mead 1965).

    Parameters
    ----------
    contender : Contender
        What is tuned.
    training : sequence of Trial
        Runs that it is not judged by later.
    reference : ndarray (3,)
        Mean RMSE of the untuned linear filter on the same runs.
    budget : int
        Number of evaluations.
    first : int
        First sample that counts.
    seed : int
        Of the points.
    """
    tunable = contender.tunable
    done: list[tuple[float, Array]] = []

    def values(point: Array) -> dict[str, float]:
        shares = np.clip(point, 0, 1).tolist()
        return {
            each.name: each.low * (each.high / each.low) ** share
            for each, share in zip(tunable, shares, strict=True)
        }

    def cost(point: Array) -> float:
        chosen = values(point) if done else contender.defaults
        found = errors(lambda: contender.build(**chosen), training, first) / reference
        with np.errstate(invalid="ignore"):
            # A signal that it does not estimate at all is not in its mean.
            kept = [float(np.minimum(c, WORST).mean()) for c in found.T if not np.isnan(c).any()]
        result = float(np.mean(kept)) if kept else WORST
        done.append((result, np.array(point)))
        return result

    start = np.array([math.log(t.default / t.low) / math.log(t.high / t.low) for t in tunable])
    default = cost(start)
    if tunable and budget > 1:
        from scipy.optimize import minimize
        from scipy.stats import qmc

        count = max(1, budget // 2 - 1)
        sobol = qmc.Sobol(len(tunable), scramble=True, rng=np.random.default_rng([seed, 4]))
        for point in sobol.random_base2(math.ceil(math.log2(count)))[:count]:
            if len(done) < budget:
                cost(point)
        best = min(done, key=lambda pair: pair[0])[1]
        corners = np.vstack([best, *(best + _towards_middle(best, n) for n in range(best.size))])
        if budget > len(done):
            minimize(cost, best, method="Nelder-Mead", bounds=[(0.0, 1.0)] * best.size,
                     options={"maxfev": budget - len(done), "initial_simplex": corners,
                              "xatol": 1e-4, "fatol": 1e-6})  # fmt: skip
    # The first of equals is the default.
    place = int(np.argmin([each[0] for each in done]))
    chosen = contender.defaults if place == 0 else values(done[place][1])
    return Tuning(chosen, done[place][0], default, len(done))


def _towards_middle(point: Array, axis: int) -> Array:
    move = np.zeros(point.size)
    move[axis] = 0.15 if point[axis] < 0.5 else -0.15
    return move
