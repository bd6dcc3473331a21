"""Pooling of several logs with random effects.

Logs scatter by more than their errors. Therefore ``theta_l ~ N(mu, C_l + T)`` with T diagonal, by
restricted likelihood (DerSimonian and Laird 1986 for the model, Harville 1977 for the likelihood);
the error of mu includes the scatter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.identification.maximum_likelihood.parameters import OFFSETS, PARAMETERS, Parameter
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood

LEAST_SCATTER = 1e-4  #: Scatter between logs, in the coordinates, below which they count as equal.
CHANCE = 0.01  #: Probability that any log of a homogeneous corpus is reported.
FEWEST = 3  #: Minimum number of logs for a scatter.

COORDINATE = {"delay": 1e-3, "position_noise": 100.0}
"""Scale of a parameter that is no logarithm [SI]: all coordinates are of order 1."""


@dataclass(frozen=True, eq=False)
class Pooled:
    """Pooled parameters of several logs."""

    parameters: list[Parameter]  #: The p parameters.
    #: (p,) Means over logs, SI, with standard errors: of the logarithm for a positive one.
    values: Array
    errors: Array
    #: (p,) Standard deviation between logs beyond their own errors, in the same units.
    scatter: Array
    by_log: Array  #: (logs, p) Values of each log; NaN if a log holds the parameter.
    log_errors: Array

    def __getitem__(self, name: str) -> float:
        """Return a value [SI]."""
        return float(self.values[[p.name for p in self.parameters].index(name)])


def pool(results: Sequence[MaximumLikelihood]) -> Pooled:
    """Pool the results of several logs."""
    # Offsets are individual: each log has its own, within the prior, and the resulting error in all
    # other parameters.
    seen = {p.name for one in results for p in one.parameters} - set(OFFSETS)
    names = [name for name in PARAMETERS if name in seen]
    parameters = [PARAMETERS[name] for name in names]
    positive = np.array([p.positive for p in parameters])
    size = np.array([1.0 if p.positive else COORDINATE.get(p.name, 1.0) for p in parameters])
    parts, log_errors = (np.full((len(results), len(names)), np.nan) for _ in range(2))
    fits = []
    for row, one in enumerate(results):
        own = [k for k, p in enumerate(one.parameters) if p.name in seen]
        at = [names.index(one.parameters[k].name) for k in own]
        parts[row, at], log_errors[row, at] = one.values[own], one.errors[own]
        theta, values = np.zeros(len(names)), one.values[own]
        logarithmic = positive[at]
        theta[at] = np.where(
            logarithmic, np.log(np.where(logarithmic, values, 1)), values / size[at]
        )
        information = np.zeros((len(names), len(names)))
        covariance = one.covariance[np.ix_(own, own)] / np.outer(size[at], size[at])
        information[np.ix_(at, at)] = np.linalg.inv(covariance)
        fits.append((information, theta))
    scatter = _between(fits)
    mean, covariance = _mean(fits, scatter)
    return Pooled(
        parameters, np.where(positive, np.exp(np.where(positive, mean, 0)), mean * size),
        size * np.sqrt(np.diag(covariance)),
        np.where(scatter > 2 * LEAST_SCATTER, size * scatter, 0.0), parts, log_errors,
    )  # fmt: skip


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of a log from the others."""

    parameter: Parameter
    difference: float  #: Difference, of the logarithm for a positive parameter, otherwise SI.
    ratio: float  #: Over the expected standard deviation of the difference.
    limit: float  #: Exceeded by one in 1/`CHANCE` homogeneous corpora.

    @property
    def far(self) -> bool:
        """Whether the log is of another rig, or of another state of it."""
        return abs(self.ratio) > self.limit


def deviation(one: MaximumLikelihood, others: Pooled, logs: int) -> Deviation | None:
    """Return the largest deviation of a log, if there are enough logs to estimate their scatter."""
    # The expected difference includes the log's own error, that of the others' mean, and their
    # scatter, which is itself an estimate: Student's t, with degrees of freedom after Satterthwaite
    # (1946).
    from scipy.stats import t

    if logs - 1 < FEWEST:
        return None
    most: Deviation | None = None
    shared = [p for p in others.parameters if p in one.parameters]
    for p in shared:
        at, k = one.parameters.index(p), others.parameters.index(p)
        value, mean = float(one.values[at]), float(others.values[k])
        known = float(one.errors[at]) ** 2 + float(others.errors[k]) ** 2
        scatter = float(others.scatter[k]) ** 2
        # An estimate of zero does not distinguish a scatter as large as the errors from none.
        unsure = max(scatter, known)
        freedom = (logs - 2) * ((known + unsure) / unsure) ** 2
        difference = math.log(value / mean) if p.positive else value - mean
        limit = float(t.isf(CHANCE / (2 * logs * len(shared)), freedom))
        ratio = difference / math.sqrt(known + scatter)
        if most is None or abs(ratio) / limit > abs(most.ratio) / most.limit:
            most = Deviation(p, difference, ratio, limit)
    return most


def _weight(J: Array, scatter: Array) -> Array:
    """Return (J^-1 + T)^-1; J may be singular if a log does not determine all parameters."""
    return np.asarray(np.linalg.solve(np.eye(J.shape[0]) + J * scatter**2, J), float)


def _mean(fits: Sequence[tuple[Array, Array]], scatter: Array) -> tuple[Array, Array]:
    weights = [_weight(J, scatter) for J, _ in fits]
    covariance = np.asarray(np.linalg.inv(sum(weights)), float)
    total = sum(W @ theta for W, (_, theta) in zip(weights, fits, strict=True))
    return covariance @ total, covariance


def _between(fits: Sequence[tuple[Array, Array]]) -> Array:
    """Return the scatter between logs of maximum restricted likelihood, in the coordinates (p,)."""
    from scipy.optimize import minimize

    size = fits[0][1].size
    if len(fits) < FEWEST:
        return np.full(size, LEAST_SCATTER)

    def cost(logs: Array) -> float:
        scatter = np.exp(logs)
        mean, covariance = _mean(fits, scatter)
        total = -np.linalg.slogdet(covariance)[1]
        for J, theta in fits:
            off = theta - mean
            total += np.linalg.slogdet(np.eye(size) + J * scatter**2)[1]
            total += off @ _weight(J, scatter) @ off
        return float(total)

    limits = [(np.log(LEAST_SCATTER), np.log(10.0))] * size
    results = [
        minimize(cost, np.full(size, np.log(begin)), method="L-BFGS-B", bounds=limits)
        for begin in (0.05, 0.3)
    ]
    return np.exp(min(results, key=lambda one: one.fun).x)
