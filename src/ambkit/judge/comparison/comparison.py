"""The comparison: same records, same tuning effort, other runs for the judgement, and the bound."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import pool_of
from ambkit.data.record import Record
from ambkit.data.signals import displacement, signal
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison.bound import bearing_bound
from ambkit.judge.comparison.cases import Case, Trial, in_the_loop, trials
from ambkit.judge.comparison.criteria import OF_THE_LOOP, SETTLING, evaluate_run
from ambkit.judge.comparison.score import Comparison, Score, half_width, mean
from ambkit.judge.comparison.tuning import SIGNALS, Candidate, Tuning, errors, tune
from ambkit.machine.axes import slowest_time
from ambkit.machine.machine import Machine

TRAINING = 4  #: Runs for tuning; others judge.
BOUND_RUNS = 8  #: Runs over which the expectations in the bound are averaged.

_TRAINING_SEED = 500_009


def bench(
    machine: Machine,
    case: Case,
    field: Mapping[str, Candidate],
    *,
    runs: int = 16,
    budget: int = 0,
    seed: int = 0,
    threads: int = 2,
    done: Callable[[], None] = lambda: None,
) -> Comparison:
    """Compare estimators in one case."""
    made = trials(case, machine, runs, seed)
    valid = [trial for trial in made if not trial.lost]
    if not valid:
        raise AmbkitError(
            f"case {case.name}: in each of {runs} runs the rotor meets a stop, because the steps "
            "are too large for this machine: compare steps takes smaller ones by --steps"
        )
    settling = SETTLING * slowest_time(machine)
    first = max(1, round(settling / machine.sampling_time))
    with pool_of(threads) as pool:

        def search(candidate: Candidate) -> Tuning:
            result = tune(candidate, training, reference, budget, first, seed)
            done()
            return result

        def evaluated(candidate: Candidate, tuning: Tuning | None = None) -> Score:
            values = dict(tuning.values) if tuning else candidate.defaults
            figures = _figures(candidate, values, valid, machine, settling)
            done()
            return Score(candidate.name, candidate.label, values, figures, tuning)

        def scores(*tunings: Sequence[Tuning]) -> dict[str, Score]:
            judged = dict(zip(field, pool.map(evaluated, field.values(), *tunings), strict=True))
            for name, score in judged.items():  # timed alone
                cost = _cost(field[name].build(**score.values), valid[0])
                score.figures["cost"] = np.full(len(valid), cost)
            return judged

        tunings: list[Tuning] = []
        if budget > 0:
            made = trials(case, machine, TRAINING, seed + _TRAINING_SEED)
            training = [trial for trial in made if not trial.lost]
            reference = errors(lambda: KalmanFilter(machine), training, first).mean(axis=0)
            tunings = list(pool.map(search, field.values()))
        default = scores()
        tuned = scores(tunings) if tunings else {}
    return Comparison(
        machine=machine,
        case=case,
        runs=runs,
        stopped=runs - len(valid),
        seed=seed,
        budget=budget,
        default=default,
        tuned=tuned,
        limit=_limit(machine, case, valid, first),
        raw=raw_error(machine, [trial.record for trial in valid], first),
        units={name: {t.name: t.unit for t in item.tunable} for name, item in field.items()},
    )


def _figures(
    candidate: Candidate,
    values: Mapping[str, float],
    valid: Sequence[Trial],
    machine: Machine,
    settling: float,
) -> dict[str, Array]:
    """Evaluate an estimator along the records and, if possible, in the loops, (runs,)."""
    # An instance of ours serves all runs, because it starts anew in each.
    estimator = candidate.build(**values)
    rows = [
        evaluate_run(estimator if candidate.in_loop else candidate.build(**values), trial, machine,
                     settling)
        for trial in valid
    ]  # fmt: skip
    figures = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    if not candidate.in_loop:
        return figures
    looped = in_the_loop(valid, estimator, settling)
    touched = looped.figures["touched"] > 0
    for name, of in OF_THE_LOOP.items():  # some do not apply to several axes
        figures[name] = np.where(touched, np.nan, looped.figures.get(of, np.nan))
    figures["settling"][np.isinf(figures["settling"])] = np.nan
    figures["lost"] = np.maximum(figures["lost"], touched)
    return figures


def _cost(estimator: Any, trial: Trial) -> float:
    """Time of a step [s]: the minimum of three runs along a record, timed alone."""
    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        estimator.run(trial.record)
        best = min(best, time.perf_counter() - start)
    return best / len(trial.record)


def raw_error(machine: Machine, records: Sequence[Record], first: int) -> float:
    """Return the rms error of the raw sensors along the axes from a sample on [m]."""
    view, errors = View(machine), []
    for record in records:
        y = np.array([record[signal("y", r.name)] for r in view.machine.readings])
        x = np.array([record[displacement(axis.name)] for axis in view.machine.axes])
        errors.append(np.sqrt(np.mean((view.measured @ y - x)[:, first:] ** 2)))
    return float(np.mean(errors))


def _limit(machine: Machine, case: Case, valid: Sequence[Trial], first: int) -> dict[str, float]:
    if not case.walks:
        return {}
    model, view = KalmanFilter(machine), View(machine)
    variances = model.variances._replace(disturbance=case.process_noise(machine))
    records = [trial.record for trial in valid[:BOUND_RUNS]]
    rows = np.concatenate(view.rows_along(model.states))
    names = [name for name in SIGNALS for _ in view.isolated]
    if view.single:
        names, rows = [*names, "x_m"], np.eye(len(model.states))[: len(names) + 1]
    bound = bearing_bound(valid[0].plant, records, variances, model.default_std(), rows)
    squares = np.mean(bound[first:] ** 2, axis=0)
    return {
        name: float(np.sqrt(np.mean(squares[[item == name for item in names]])))
        for name in dict.fromkeys(names)
    }


@dataclass(frozen=True)
class Sweep:
    """Errors of each estimator over one varied quantity."""

    values: Array  #: (n,) Values of the quantity.
    #: (mapping of str to ndarray (n,)) By estimator, then x, v, f_d: mean RMSE.
    errors: Mapping[str, Mapping[str, Array]]
    #: Half of their 95 % confidence interval.
    half_widths: Mapping[str, Mapping[str, Array]]
    limit: Mapping[str, Array]  #: (n,) Bound of x, v, f_d; empty if unknown.


def sweep(
    machine: Machine,
    cases: Mapping[float, Case],
    field: Mapping[str, Candidate],
    *,
    tuned: Mapping[str, Tuning] | None = None,
    runs: int = 4,
    seed: int = 0,
    threads: int = 2,
    done: Callable[[], None] = lambda: None,
) -> Sweep:
    """Compare estimators along records in a series of cases that differ in one quantity."""
    first = max(1, round(SETTLING * slowest_time(machine) / machine.sampling_time))
    rows: list[dict[str, Array]] = []
    limits: list[dict[str, float]] = []
    with pool_of(threads) as pool:
        for case in cases.values():
            valid = [t for t in trials(case, machine, runs, seed + 31) if not t.lost]

            def one(candidate: Candidate, valid: list[Trial] = valid) -> Array:
                values = dict(tuned[candidate.name].values) if tuned else candidate.defaults
                return errors(lambda: candidate.build(**values), valid, first)

            rows.append(dict(zip(field, pool.map(one, field.values()), strict=True)))
            limits.append(_limit(machine, case, valid, first) if valid else {})
            done()

    def gathered(what: Callable[[Array], float]) -> dict[str, dict[str, Array]]:
        return {
            name: {
                signal: np.array([what(row[name][:, place]) for row in rows])
                for place, signal in enumerate(SIGNALS)
            }
            for name in field
        }

    limit = {}
    if all(limits):
        limit = {signal: np.array([item[signal] for item in limits]) for signal in SIGNALS}
    half_widths = gathered(lambda values: float(np.nan_to_num(half_width(values))))
    return Sweep(np.array(list(cases)), gathered(mean), half_widths, limit)
