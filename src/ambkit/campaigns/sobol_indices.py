"""Sobol indices by SALib."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError, library
from ambkit.campaigns.distributions import (
    ChoiceMarginal,
    Normal,
    NormalMarginal,
    Truncated,
    Uniform,
    UniformMarginal,
)
from ambkit.campaigns.study_tables import UNITS

if TYPE_CHECKING:
    from ambkit.campaigns.distributions import Varied
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.results import Machines


def problem_of(plan: Plan) -> dict[str, Any]:
    """Return the varied quantities for SALib: names, bounds and distributions, in SI."""
    # A choice is its index, uniform from 0 to the number of its values.
    bounds: list[list[float]] = []
    dists: list[str] = []
    for of in plan.marginals:
        if isinstance(of, UniformMarginal):
            bounds.append([of.low, of.high])
            dists.append("unif")
        elif isinstance(of, ChoiceMarginal):
            bounds.append([0.0, float(len(of.values))])
            dists.append("unif")
        elif isinstance(of, NormalMarginal) and np.isfinite([of.low, of.high]).all():
            bounds.append([of.low, of.high, of.mean, of.std])
            dists.append("truncnorm")
        elif isinstance(of, NormalMarginal):
            bounds.append([of.mean, of.std])
            dists.append("norm")
    names = list(plan.names)
    return {"num_vars": len(names), "names": names, "bounds": bounds, "dists": dists}


def vary_from(problem: Mapping[str, Any]) -> tuple[Varied, ...]:
    """Return varied quantities from SALib's problem dictionary: names are keys, values in SI."""
    names, bounds = problem.get("names"), problem.get("bounds")
    if not isinstance(names, list | tuple) or bounds is None or len(names) != len(bounds):
        raise AmbkitError("a problem of SALib has as many bounds as names")
    dists = problem.get("dists") or ["unif"] * len(names)
    if len(dists) != len(names):
        raise AmbkitError(f"a problem of SALib has as many dists as names, {len(names)}")
    results: list[Varied] = []
    for name, ends, dist in zip(names, bounds, dists, strict=True):
        values = [float(end) for end in ends]
        match dist, values:
            case "unif", [low, high]:
                results.append(Uniform(what=name, low=low, high=high))
            case "norm", [mean, std]:
                results.append(Normal(what=name, mean=mean, std=std))
            case "truncnorm", [low, high, mean, std]:
                results.append(Truncated(what=name, low=low, high=high, mean=mean, std=std))
            case _:
                raise AmbkitError(
                    f"{name}: a study has no distribution {dist!r} with {len(values)} numbers; it "
                    "has unif, norm, truncnorm"
                )
    return tuple(results)


ENOUGH = 20_000  #: Maximum number of evaluated runs for points that were not sampled for indices.
LEAST = 64  #: Minimum number of these; for points sampled for indices, of groups.
RESAMPLES = 100  #: Bootstrap samples for the confidence intervals.


class Indices(NamedTuple):
    """Shares of quantities in a figure's variance over the machines (Sobol 1993)."""

    figure: str  #: Name of the figure.
    method: str  #: Method.
    names: tuple[str, ...]  #: Keys of the varied quantities.
    first: Array  #: (k,) First-order index, and half of its confidence interval [1].
    first_confidence: Array
    #: (k,) Total index; only for ``sampling = "saltelli"``.
    total: Array | None
    total_confidence: Array | None
    used: int  #: Evaluated runs, and those without a finite figure.
    left_out: int

    @property
    def order(self) -> NDArray[np.int_]:
        """Order of the names, largest share first."""
        return np.argsort(-(self.first if self.total is None else self.total), kind="stable")


def indices(campaign: Machines, figure: str) -> Indices:
    """Return the share of each quantity in a figure's variance."""
    # For Saltelli's points by his estimators, first order and total. For others first order only:
    # by RBD-FAST (Tarantola, Gatelli, Mara 2006), for choices by the variance of the means. The
    # noise of the runs is in no quantity's share then.
    rbd_fast, sobol = (
        library(f"SALib.analyze.{name}", "indices", "campaign") for name in ("rbd_fast", "sobol")
    )
    if figure not in UNITS or figure not in campaign.columns:
        raise AmbkitError(f"there is no figure {figure} to explain")
    plan = campaign.plan
    if not plan.names:
        raise AmbkitError(f"{plan.study.name}: nothing varies")
    problem, Y = problem_of(plan), campaign.column(figure)
    if plan.study.sampling == "saltelli":
        size = len(plan.names) + 2
        groups = Y.reshape(-1, size)
        finite_groups = groups[np.isfinite(groups).all(axis=1)]
        _enough(figure, finite_groups.ravel(), len(finite_groups))
        result = sobol.analyze(
            problem, finite_groups.ravel(), calc_second_order=False, num_resamples=RESAMPLES,
            conf_level=plan.study.confidence, seed=0,
        )  # fmt: skip
        return Indices(
            figure, "Sobol indices", plan.names, np.asarray(result["S1"]),
            np.asarray(result["S1_conf"]), np.asarray(result["ST"]), np.asarray(result["ST_conf"]),
            finite_groups.size, Y.size - finite_groups.size,
        )  # fmt: skip
    Y = Y[:ENOUGH]
    finite = np.isfinite(Y)
    _enough(figure, Y[finite], int(finite.sum()))
    X = _columns(campaign)[: len(Y)][finite]
    result = rbd_fast.analyze(
        problem, X, Y[finite], num_resamples=RESAMPLES, conf_level=plan.study.confidence, seed=0
    )
    first, half = np.array(result["S1"], float), np.array(result["S1_conf"], float)
    for place, of in enumerate(plan.marginals):
        if isinstance(of, ChoiceMarginal):
            first[place], half[place] = _of_choice(X[:, place], Y[finite], plan.study.confidence)
    return Indices(
        figure, "first-order indices", plan.names, first, half, None, None, int(finite.sum()),
        int((~finite).sum()),
    )  # fmt: skip


def _enough(figure: str, values: Array, count: int) -> None:
    if count < LEAST:
        raise AmbkitError(f"{figure}: too few machines have a finite one, {count} of {LEAST}")
    if not np.ptp(values) > 0:
        raise AmbkitError(f"{figure}: is the same for all machines")


def _columns(campaign: Machines) -> Array:
    """Return the varied quantities (n, k), for choices the index."""
    parts = [campaign.plan.points(*campaign.plan.span(part)) for part in campaign.parts]
    return np.concatenate(parts)


def _of_choice(level: Array, Y: Array, confidence: float) -> tuple[float, float]:
    """Return the share of the variance between levels, corrected for chance."""
    from scipy.special import ndtri

    def share(at: Any) -> float:
        names, where, counts = np.unique(level[at], return_inverse=True, return_counts=True)
        y = Y[at]
        means = np.bincount(where, y) / counts
        between = float(np.sum(counts * (means - y.mean()) ** 2))
        total = float(np.sum((y - y.mean()) ** 2))
        chance = (len(names) - 1) * (total - between) / max(y.size - len(names), 1)
        return max(0.0, (between - chance) / total) if total > 0 else 0.0

    rng = np.random.default_rng(0)
    again = [share(rng.integers(0, Y.size, Y.size)) for _ in range(RESAMPLES)]
    return share(slice(None)), float(ndtri(0.5 + confidence / 2) * np.std(again))
