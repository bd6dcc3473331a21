"""Estimators over many seeds, each in its own loop, against the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from ambkit.base.arrays import rms
from ambkit.base.escaping import label as escaped
from ambkit.base.quantity_arguments import of_type
from ambkit.base.threads import pool_of
from ambkit.data.record import Record
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Estimator
from ambkit.judge.comparison.criteria import EVALUATED, errors_along
from ambkit.judge.comparison.figures import SHOWN
from ambkit.judge.comparison.score import Score
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.result.report import Axis, Bars, Figure, Item, Panel, Rule
from ambkit.result.signal_styles import looks
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario


def rmse(estimate: Estimate, record: Record, signal: str) -> float:
    """Root mean square error of an estimated signal against the truth in the record."""
    return rms(estimate[signal] - record[signal])


def compare(
    machine: Machine,
    scenario: Scenario,
    estimators: Mapping[str, Callable[[], Estimator]],
    seeds: Sequence[int],
    *,
    magnet: MagnetModel | None = None,
    threads: int = 2,
    done: Callable[[], None] = lambda: None,
) -> dict[str, Score]:
    """Monte Carlo over seeds: every estimator closes its own loop with the same noise."""
    of_type(Machine, machine=machine)
    of_type(Scenario, scenario=scenario)

    def one(name: str, seed: int) -> list[float]:
        estimator, seeded_scenario = estimators[name](), scenario.model_copy(update={"seed": seed})
        run = simulate_run(machine, seeded_scenario, estimator=estimator, magnet=magnet)
        assert run.estimate is not None  # there is an estimator
        wrong = errors_along(run.estimate, run.record, estimator.view)
        errors = [rms(wrong[signal]) for signal in EVALUATED]
        done()
        touched = float(run.record.meta["stop_touched"] > 0)
        return [*errors, float(run.estimate.nis[1:].mean()), touched]

    scores = {}
    with pool_of(threads) as pool:
        futures = {name: [pool.submit(one, name, seed) for seed in seeds] for name in estimators}
        for name, waiting in futures.items():
            figures = np.array([future.result() for future in waiting]).T
            by_criterion = dict(zip((*EVALUATED, "nis", "lost"), figures, strict=True))
            scores[name] = Score(name, name, {}, by_criterion)
    return scores


def comparison_figure(scores: Mapping[str, Mapping[str, Score]], what: str = "step") -> Figure:
    """Plot the errors of several filters as bars."""
    axes = SHOWN | {"f_d": Axis("error of disturbance force", "N rms")}
    cases, names = list(scores), list(next(iter(scores.values())))

    def bars(criterion: str) -> list[Item]:
        return [
            Bars([escaped(case) for case in cases],
                 np.array([scores[case][name].mean(criterion) for case in cases]),
                 np.array([scores[case][name].spread(criterion) for case in cases]),
                 signal=style, label=label)
            for name, (style, label) in zip(names, looks(names), strict=True)
        ]  # fmt: skip

    errors = [Panel(Axis(what), axis, bars(signal)) for signal, axis in axes.items()]
    nis = [*bars("nis"), Rule(1.0, signal="bound", label="")]
    return Figure(
        id="comparison",
        title="Errors of the filters",
        caption="Means over the seeds; error bars: standard deviation over them.",
        panels=[*errors, Panel(Axis(what), Axis("mean NIS"), nis)],
        columns=2,
    )
