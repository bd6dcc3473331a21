"""Chapter 5: the adaptive Kalman filter (paper, Fig. 8, 13-16)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ambkit.control.control import Control
from ambkit.estimate.estimate import Estimate
from ambkit.judge.comparison import rmse
from ambkit.machine.magnets import evaluate_stiffness
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule
from ambkit.result.report.blocks import Chapter, FigureBlock, Text
from ambkit.simulation.run import Run
from paper.study import POSITION, SEEDS, STEP_TIME, TIME, TIME_MS, Part, Study, mean_row

STEP = 0.5e-3  # m


def adaptive(study: Study) -> Part:
    """Run linear and adaptive filter through the step of 0.5 mm, each in its own loop."""
    scenario = study.scenario(STEP)
    runs = {name: study.run(scenario, name) for name in ("estimate linear", "estimate adaptive")}
    estimate = _estimate(runs["estimate adaptive"])
    record = runs["estimate adaptive"].record
    true_k_i, true_k_s = evaluate_stiffness(study.law, record["iu"], record["x"])
    far_i, far_s, over_adaptive, error_adaptive = study.over_seeds(
        lambda seed: _figures(study, seed, "estimate adaptive")
    )
    _, _, over_linear, error_linear = study.over_seeds(
        lambda seed: _figures(study, seed, "estimate linear")
    )
    (over_default,) = study.over_seeds(lambda seed: (_calm_overshoot(study, seed),))
    calm = Control.for_bearing(study.bearing)
    noise = 1e6 * float(np.sqrt(study.bearing.sensor.noise_variance))
    return Part(
        Chapter(
            id="adaptive",
            title="The adaptive Kalman filter",
            lead="At every sample the expert gives k_i and k_s at the estimated "
                 "displacement and the control current, and the prediction uses them.",
            blocks=[
                Text("The paper's Fig. 8 is the block diagram: the expert is added to the "
                     "filter of Fig. 4; its inputs are the estimated displacement and the "
                     "control current, its outputs the two stiffnesses of the filter's plant "
                     "model."),
                FigureBlock(_figure_stiffness(study, "fig13", "k_i", "N/A", 1.0, estimate,
                                              true_k_i, study.constant.k_i)),
                FigureBlock(_figure_stiffness(study, "fig14", "k_s", "N/mm", 1e-3, estimate,
                                              true_k_s, study.constant.k_s)),
                Text(f"At rest at 0.5 mm the expert's $k_i$ is {far_i.mean():+.1f} % and its "
                     f"$k_s$ {far_s.mean():+.1f} % from the constants of the origin. The "
                     "stiffnesses are as noisy as their inputs: the control current contains "
                     "the noise of the feedback."),
                FigureBlock(_figure_step(study, runs)),
                FigureBlock(_figure_close(study, runs)),
                Text(f"Both filters track the rotor: over {SEEDS} seeds the error of the position "
                     f"is {error_linear.mean():.2f} ± {error_linear.std(ddof=1):.2f} µm rms with "
                     f"the linear and {error_adaptive.mean():.2f} ± "
                     f"{error_adaptive.std(ddof=1):.2f} µm with the adaptive filter, where the "
                     f"sensor scatters by {noise:.1f} µm. "
                     f"Both overshoot by half of the step, as the paper gives no controller "
                     f"and this one is a textbook PID. The gains that ambkit designs for "
                     f"the margins of the loop (kp {calm.kp:g} A/m, ki {calm.ki:g} A/(m s), kd "
                     f"{calm.kd:g} A s/m, setpoint weight "
                     f"{calm.setpoint_weight:g}) overshoot by {over_default.mean():.0f} %. "
                     "They differ in their estimates of the forces, see [](#gain)."),
            ],
        ),
        [
            mean_row("fig13.k_i", "Expert at 0.5 mm over constant: k_i", far_i,
                     "%"),
            mean_row("fig14.k_s", "Expert at 0.5 mm over constant: k_s", far_s,
                     "%"),
            mean_row("fig15.overshoot", "Overshoot, 0.5 mm step: linear filter",
                     over_linear, "%"),
            mean_row("fig15.adaptive", "Overshoot, 0.5 mm step: adaptive filter",
                     over_adaptive, "%"),
            mean_row("fig15.default", "Overshoot, 0.5 mm step: linear, default PID",
                     over_default, "%"),
        ],
    )  # fmt: skip


def _figures(study: Study, seed: int, name: str) -> tuple[float, float, float, float]:
    """Stiffnesses at rest and overshoot, all from what they would be [%]; position error [µm]."""
    run = study.run(study.scenario(STEP, seed=seed), name)
    estimate, late = _estimate(run), run.record.t > STEP_TIME + 0.1
    return (
        100 * float(np.mean(estimate.k_i[late]) / study.constant.k_i - 1),
        100 * float(np.mean(estimate.k_s[late]) / study.constant.k_s - 1),
        100 * float(run.record["x"].max() / STEP - 1),
        1e6 * rmse(estimate, run.record, "x"),
    )


def _calm_overshoot(study: Study, seed: int) -> float:
    """Overshoot with the linear filter and the default controller [%]."""
    asked = study.scenario(STEP, seed=seed)
    calm = asked.model_copy(update={"controller": Control.for_bearing(study.bearing)})
    return 100 * float(study.run(calm).record["x"].max() / STEP - 1)


def _estimate(run: Run) -> Estimate:
    assert run.estimate is not None  # every run here has an estimator
    return run.estimate


def _figure_stiffness(
    study: Study,
    id: str,
    symbol: str,
    unit: str,
    factor: float,
    estimate: Estimate,
    truth: NDArray[np.float64],
    constant: float,
) -> Figure:
    word = {"k_i": "current", "k_s": "position"}[symbol]
    return Figure(
        id=id,
        title=f"Adapted {word} stiffness during the step of 0.5 mm",
        source=f"paper, Fig. {id[3:]}",
        caption="Blue: output of the expert at the estimated displacement and the control "
                "current. Black: the closed law at the true ones. Dotted: the constant of the "
                "linear filter. While the rotor overshoots beyond 0.5 mm it is outside the "
                "range of the rules, and the expert holds the output of the edge. "
                f"{study.one_run}",
        panels=[
            Panel(TIME, Axis(f"{word} stiffness ${symbol}$", unit, factor), [
                Line(estimate.t, truth, signal="truth", label="closed law at the truth"),
                Line(estimate.t, estimate[symbol], signal="estimate adaptive", label="expert"),
                Rule(constant, signal="constant"),
            ]),
        ],
    )  # fmt: skip


def _lines(run: Run, signal: str) -> list[Item]:
    record = run.record
    return [
        Line(record.t, record["y"], signal="measured"),
        Line(record.t, record["r"], signal="reference"),
        Line(record.t, record["x"], signal="truth"),
        Line(record.t, _estimate(run).x, signal=signal),
    ]


def _errors(run: Run, signal: str) -> list[Item]:
    """Errors of measurement and estimate."""
    record = run.record
    return [
        Line(record.t, record["y"] - record["x"], signal="measured"),
        Line(record.t, _estimate(run).x - record["x"], signal=signal),
        Rule(0.0, signal="truth"),
    ]


def _figure_step(study: Study, runs: dict[str, Run]) -> Figure:
    return Figure(
        id="fig15",
        title="Step response of 0.5 mm: reference, truth, measured, estimated",
        source="paper, Fig. 15",
        caption="Left: linear filter in the loop; right: adaptive filter, with the same "
        "noise. Top: the position; at this scale the estimation error is not visible. "
        "Bottom: the errors; the measurement is noisy, and lags while the rotor "
        "moves; the estimate has a third of that noise. In the first milliseconds the "
        f"filter converges from its initial state. {study.one_run}",
        panels=_beside(runs, TIME),
        columns=2,
    )


def _beside(runs: dict[str, Run], time: Axis) -> list[Panel]:
    """Position above, its error below; the linear filter left, the adaptive one right."""
    titles = dict(zip(runs, ("linear filter", "adaptive filter"), strict=True))
    worst = max(float(np.abs(r.record["y"] - r.record["x"]).max()) for r in runs.values())
    error = Axis("error of position", "µm", 1e6, limits=(-worst, worst))
    return [
        *(Panel(time, POSITION, _lines(run, name), title=titles[name])
          for name, run in runs.items()),
        *(Panel(time, error, _errors(run, name)) for name, run in runs.items()),
    ]  # fmt: skip


def _off_while_fast(run: Run) -> float:
    """Mean error of the position while the speed is half of the greatest or more [m]."""
    fast = np.abs(run.record["v"]) >= 0.5 * np.abs(run.record["v"]).max()
    return float((_estimate(run).x - run.record["x"])[fast].mean())


def _figure_close(study: Study, runs: dict[str, Run]) -> Figure:
    window = (STEP_TIME - 0.002, STEP_TIME + 0.028)

    def cut(run: Run) -> Run:
        kept = slice(*(round(end / run.record.t[1]) for end in window))
        e = _estimate(run)
        return replace(
            run,
            record=run.record.between(*window),
            estimate=Estimate(
                e.t[kept], e.mean[kept], e.innovation[kept], e.innovation_variance[kept],
                e.k_i[kept], e.k_s[kept], e.status[kept], None, e.estimator, e.states,
            ),
        )  # fmt: skip

    near = {name: cut(run) for name, run in runs.items()}
    record = near["estimate adaptive"].record
    late = 1e6 * study.bearing.sensor.lag * float(np.abs(record["v"]).max())
    ahead = {name: 1e6 * _off_while_fast(run) for name, run in near.items()}
    return Figure(
        id="fig16",
        title="The same step, its first milliseconds",
        source="paper, Fig. 16 (which gives no more than 'rotor displacement')",
        caption="Drawn large. The measurement lags the truth by the sensor's 0.2 ms, which is "
        f"{late:.0f} µm where the rotor is fastest, and scatters by 9 µm. While the rotor has half "
        f"of its greatest speed or more, the estimate of the linear filter is "
        f"{ahead['estimate linear']:+.1f} µm off on the average, that of the adaptive one "
        f"{ahead['estimate adaptive']:+.1f} µm. {study.one_run}",
        panels=_beside(near, TIME_MS),
        columns=2,
    )
