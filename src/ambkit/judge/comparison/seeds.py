"""Estimators over many seeds, each in its own loop, judged by the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import methodcaller

import numpy as np

from ambkit.base.arrays import Array, rms
from ambkit.base.escaping import label as escaped
from ambkit.base.quantity_arguments import of_type
from ambkit.base.threads import pool_of
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Estimator
from ambkit.judge.comparison.criteria import CRITERIA, EVALUATED, errors_along
from ambkit.judge.comparison.figures import SHOWN
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.result.report import Axis, Bars, Figure, Item, Panel, Rule
from ambkit.result.row import Row, put
from ambkit.result.signal_styles import looks
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario


@dataclass(frozen=True)
class Score:
    """How one estimator did over several seeds."""

    #: ``x`` [m], ``v`` [m/s], ``f_d`` [N]: root mean square errors over all axes, (seeds,).
    rmse: Mapping[str, Array]
    nis: Array  #: (seeds,) Mean normalised innovation squared; 1 where model and noise are right.
    touched: int = 0  #: Runs in which the rotor touched a stop.

    def mean(self, signal: str) -> float:
        """Mean RMSE over the seeds."""
        return float(self.rmse[signal].mean())

    def spread(self, signal: str) -> float:
        """Standard deviation of the RMSE over the seeds."""
        return float(self.rmse[signal].std(ddof=1)) if len(self.rmse[signal]) > 1 else 0.0

    def rows(self) -> list[Row]:
        """Return the means over the seeds."""
        return [
            *(Row(name, CRITERIA[name].label, self.mean(name), unit, 3, error=self.spread(name),
                  error_key="spread") for name, unit in EVALUATED.items()),
            Row("nis", "mean NIS", float(self.nis.mean())),
            Row("runs_at_the_stop", "runs at the stop", self.touched,
                detail=not self.touched),
        ]  # fmt: skip


def rows_of(scores: Mapping[str, Score]) -> list[Row]:
    """Return the errors of each."""
    return [row for name, score in scores.items() for row in put(score.rows(), of=name)]


def rmse(estimate: Estimate, record: Record, signal: str) -> float:
    """Root mean square error of an estimated signal against the truth in the record."""
    return rms(estimate[signal] - record[signal])


def compare(
    bearing: Machine,
    scenario: Scenario,
    estimators: Mapping[str, Callable[[], Estimator]],
    seeds: Sequence[int],
    *,
    magnet: MagnetModel | None = None,
    threads: int = 2,
    done: Callable[[], None] = lambda: None,
) -> dict[str, Score]:
    """Monte Carlo over seeds: every estimator closes its own loop against the same noise."""
    of_type(Machine, bearing=bearing)
    of_type(Scenario, scenario=scenario)
    plant = bearing

    def one(name: str, seed: int) -> tuple[list[float], float, bool]:
        estimator, seeded_scenario = estimators[name](), scenario.model_copy(update={"seed": seed})
        run = simulate_run(plant, seeded_scenario, estimator=estimator, magnet=magnet)
        assert run.estimate is not None  # an estimator was given
        wrong = errors_along(run.estimate, run.record, estimator.view)
        errors = [rms(wrong[signal]) for signal in EVALUATED]
        done()
        touched = run.record.meta["stop_touched"] > 0
        return errors, float(run.estimate.nis[1:].mean()), touched

    scores = {}
    with pool_of(threads) as pool:
        futures = {name: [pool.submit(one, name, seed) for seed in seeds] for name in estimators}
        for name, waiting in futures.items():
            errors, nis, touched = zip(*(future.result() for future in waiting), strict=True)
            by_signal = dict(zip(EVALUATED, np.array(errors).T, strict=True))
            scores[name] = Score(by_signal, np.array(nis), sum(touched))
    return scores


def comparison_figure(scores: Mapping[str, Mapping[str, Score]], what: str = "step") -> Figure:
    """Show the errors of several filters as bars."""
    axes = SHOWN | {"f_d": Axis("error of disturbance force", "N rms")}
    cases, names = list(scores), list(next(iter(scores.values())))

    def bars(mean: Callable[[Score], float], spread: Callable[[Score], float]) -> list[Item]:
        return [
            Bars([escaped(case) for case in cases],
                 *(np.array([of(scores[case][name]) for case in cases]) for of in (mean, spread)),
                 signal=style, label=label)
            for name, (style, label) in zip(names, looks(names), strict=True)
        ]  # fmt: skip

    errors = [
        Panel(Axis(what), axis, bars(methodcaller("mean", signal), methodcaller("spread", signal)))
        for signal, axis in axes.items()
    ]
    nis = bars(lambda score: float(score.nis.mean()), lambda score: float(score.nis.std()))
    return Figure(
        id="comparison",
        title="Errors of the filters",
        caption="Means over the seeds; error bars: standard deviation over them.",
        panels=[
            *errors,
            Panel(Axis(what), Axis("mean NIS"), [*nis, Rule(1.0, signal="bound", label="")]),
        ],
        columns=2,
    )
