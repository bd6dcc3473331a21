"""Study of the default filters by truth, beside the raw sensor and a naive filter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any

import numpy as np

from ambkit.base.arrays import rms
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.estimate.constant_velocity import usual_acceleration
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.estimate.named import factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS, default_name
from ambkit.judge.comparison.cases import CASES, Case, Trial, iterate_trials
from ambkit.judge.comparison.comparison import raw_error
from ambkit.judge.comparison.conditions import Spread
from ambkit.judge.comparison.criteria import nees
from ambkit.judge.comparison.tuning import errors
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time

SETTLING = 12  #: Excluded initial time, in time constants of the slowest axis.
CONSISTENCY_RUNS = 20
"""Of the NEES at least: a run is a few time constants long, and its share of samples within the
bound scatters by up to 6 %."""
DECADES = 4.0  #: Range of the tuning in decades, on both sides of the default.
CONSISTENT = (0.90, 0.98)  #: Share of samples within the 95 % bound of the NEES.
WORSE = 1.02  #: Error over that of a baseline from which a filter is the worse one.


@dataclass(frozen=True)
class DefaultScore:
    """How filters do on a machine whose disturbance force is the random walk that they assume."""

    raw: float  #: Error of the raw sensor's position [m], rms over runs, samples and axes.
    naive: float  #: That of the constant-velocity filter, tuned by truth on other runs [m].
    errors: Mapping[str, float]  #: Of each kind with its defaults [m]; infinite where it is lost.
    tuned: Mapping[str, float]  #: Of each kind tuned as the naive filter is [m].
    #: Share of samples within the 95 % bound of the NEES, NaN without covariance. A kind that
    #: assumes an uncertain magnet constant is judged on plants drawn with the same variance.
    nees: Mapping[str, float]
    nees_error: Mapping[str, float]  #: Standard error of that share, by its scatter over runs.

    def row(self) -> str:
        """Return the figures of the first kind that was tuned, in a line."""
        kind = next(iter(self.tuned))
        return (
            f"{kind}: NEES {100 * self.nees[kind]:.0f} % within its 95 % bound, position error "
            f"{self.errors[kind] / self.raw:.2f} of the raw sensor's; tuned, its error is "
            f"{self.tuned[kind] / self.naive:.2f} of that of a tuned constant-velocity filter"
        )

    def objections(self) -> Iterator[str]:
        """Yield in which respect the first kind that was tuned fails, with the remedy."""
        kind, (low, high) = next(iter(self.tuned)), CONSISTENT
        share, margin = self.nees[kind], 2 * self.nees_error[kind]
        stated = (
            f"{100 * share:.0f} ± {100 * margin:.0f} % of its NEES are within the 95 % bound, "
            f"consistent from {100 * low:.0f} to {100 * high:.0f} %"
        )
        if share + margin < low:
            yield (
                f"the covariance of the default filter {kind} is too small: {stated}. Use its "
                "estimates without their standard deviations; 'ambkit compare' ranks other kinds"
            )
        if share - margin > high:
            yield (
                f"the covariance of the default filter {kind} is too large: {stated}. Take its "
                "standard deviations as upper limits"
            )
        raw, naive = self.errors[kind] / self.raw, self.tuned[kind] / self.naive
        if not raw <= WORSE:
            remedy = (
                "'ambkit tune' finds the process noise on a log"
                if self.tuned[kind] <= WORSE * self.raw
                else "tuning does not help: 'ambkit compare' ranks other kinds"
            )
            yield (
                f"the default filter {kind} is worse than the raw sensor: its position error is "
                f"{raw:.2g} of the sensor's; {remedy}"
            )
        if not naive <= WORSE:
            yield (
                f"the default filter {kind} is worse than a constant-velocity filter, with both "
                f"tuned: its position error is {naive:.2g} of the other's. Use "
                "--filter constant-velocity for the position"
            )


def score_defaults(
    machine: Machine,
    kinds: Sequence[str] = (),
    *,
    runs: int = 3,
    seed: int = 0,
    tune: Sequence[str] = (),
) -> DefaultScore:
    """Simulate a machine, tune the naive filter on as many other runs, and judge all by truth."""
    # The plant has the unbalance and the runout that one of the kinds estimates.
    builders = factories(kinds or default_name(machine), machine)
    case = CASES["model"].with_states_of(builders)
    made = _untouched(case, machine, runs + max(runs, CONSISTENCY_RUNS), 2 * runs, seed)
    training, judged = made[:runs], made[runs:]
    defaults = {kind: build() for kind, build in builders.items()}
    sampled = {0.0: made[runs:]}
    for std in {filter.scale_std for filter in defaults.values()} - {0.0}:
        tolerance = math.sqrt(3) * std  # half the width of a uniform distribution
        uncertain = replace(case, spread=Spread(magnet_constant=tolerance))
        sampled[std] = _untouched(uncertain, machine, CONSISTENCY_RUNS, runs, seed)
    settling = SETTLING * max(map(own_time, isolated_axes(machine)))
    first = max(1, round(settling / machine.sampling_time))

    def error(build: Callable[[], Any], of: Sequence[Trial]) -> float:
        return rms(errors(build, of, first)[:, 0])

    def best(build: Callable[[float], Any]) -> float:
        decade = _least(lambda decade: error(lambda: build(decade), training))
        return error(lambda: build(decade), judged)

    def consistency(filter: Any) -> tuple[float, float]:
        records = [trial.record for trial in sampled[filter.scale_std]]
        estimates = (filter.run(record, covariance=True) for record in records)
        shares = list(map(partial(nees, first=first, view=View(machine)), estimates, records))
        scatter = np.std(shares, ddof=1) if len(shares) > 1 else math.nan
        return float(np.mean(shares)), float(scatter / math.sqrt(len(shares)))

    naive, usual = KINDS["constant-velocity"], usual_acceleration(machine)
    load = np.atleast_1d(KalmanFilter(machine).variances.disturbance)

    def scaled(kind: str) -> Callable[[float], Any]:
        return lambda decade: builders[kind](FilterNoise(disturbance=tuple(load * 10**decade)))

    judged_nees = {kind: consistency(filter) for kind, filter in defaults.items()}
    return DefaultScore(
        rms(np.array([raw_error(machine, [trial.record], first) for trial in judged])),
        best(lambda decade: naive.make(machine, acceleration=usual * 10**decade)),
        {kind: error(build, judged) for kind, build in builders.items()},
        {kind: best(scaled(kind)) for kind in tune or list(builders)[:1]},
        {kind: mean for kind, (mean, _) in judged_nees.items()},
        {kind: error for kind, (_, error) in judged_nees.items()},
    )


def _untouched(case: Case, machine: Machine, count: int, least: int, seed: int) -> list[Trial]:
    """Simulate runs of a case; leave out those with contact."""
    attempts = iterate_trials(case, machine, 2 * count, seed)
    made = list(islice((trial for trial in attempts if not trial.lost), count))
    if len(made) < least:
        lost = 2 * count - len(made)
        assumed = math.sqrt(max(np.atleast_1d(case.process_noise(machine))))
        raise AmbkitError(
            f"{machine.name}: the rotor met a stop in {lost} of {2 * count} runs, under the "
            f"disturbance force that filters assume, up to {engineering(assumed, 'N')} after 1 s"
        )
    return made


def _least(cost: Callable[[float], float]) -> float:
    """Return the decade of least cost: of every one, and around the best of them."""
    from scipy.optimize import minimize_scalar

    costs = {decade: cost(decade) for decade in np.arange(-DECADES, DECADES + 0.5).tolist()}
    best = min(costs, key=lambda decade: costs[decade])
    result = minimize_scalar(cost, bounds=(best - 1, best + 1), method="bounded",
                             options={"xatol": 0.05})  # fmt: skip
    return float(result.x) if result.fun < costs[best] else best
