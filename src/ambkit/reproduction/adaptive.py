"""Chapter 5: the adaptive Kalman filter (paper, Fig. 8, 13-16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate import Estimate
from ambkit.magnets import evaluate_stiffness
from ambkit.report.blocks import Chapter, FigureBlock, Text
from ambkit.report.figure import Figure, Panel
from ambkit.report.items import Axis, Item, Line, Rule
from ambkit.reproduction.study import POSITION, STEP_TIME, TIME, TIME_MS, Part, Study, row
from ambkit.simulation import Run

STEP = 0.5e-3  # m


def adaptive(study: Study) -> Part:
    """Run linear and adaptive filter through the step of 0.5 mm, each in its own loop."""
    scenario = study.scenario(STEP)
    runs = {name: study.run(scenario, name) for name in ("estimate linear", "estimate adaptive")}
    estimate = _estimate(runs["estimate adaptive"])
    record = runs["estimate adaptive"].record
    true_k_i, true_k_s = evaluate_stiffness(study.law, record["iu"], record["x"])
    late = record.t > STEP_TIME + 0.1
    far_i = 100 * float(np.mean(estimate.k_i[late]) / study.constant.k_i - 1)
    far_s = 100 * float(np.mean(estimate.k_s[late]) / study.constant.k_s - 1)
    overshoot = {name: 100 * float(run.record["x"].max() / STEP - 1) for name, run in runs.items()}
    return Part(
        Chapter(
            id="adaptive",
            title="The adaptive Kalman filter",
            lead="At every sample the expert is asked for k_i and k_s at the estimated "
                 "displacement "
            "and the control current, and the prediction goes on with its answer.",
            blocks=[
                FigureBlock(_figure_stiffness("fig13", "k_i", "N/A", 1.0, estimate, true_k_i,
                                              study.constant.k_i)),
                FigureBlock(_figure_stiffness("fig14", "k_s", "N/mm", 1e-3, estimate, true_k_s,
                                              study.constant.k_s)),
                Text(f"At rest at 0.5 mm the expert's $k_i$ is {far_i:+.1f} % and its $k_s$ "
                     f"{far_s:+.1f} % from the constants of the origin. The answer is as "
                     "noisy as the question: the control current carries the noise of the "
                     "feedback."),
                FigureBlock(_figure_step(runs)),
                FigureBlock(_figure_close(runs)),
                Text("Both filters track the rotor: in position they can hardly be told apart. "
                     "Where they differ is in what they say of the forces, see [](#gain)."),
            ],
        ),
        [
            row("fig13.k_i", "k_i of the expert at rest at 0.5 mm, from the constant", None, far_i,
                "%", "not given"),
            row("fig14.k_s", "k_s of the expert at rest at 0.5 mm, from the constant", None, far_s,
                "%", "not given"),
            row("fig15.overshoot", "overshoot of the 0.5 mm step: linear filter in the loop", None,
                overshoot["estimate linear"], "%", "not given"),
            row("fig15.adaptive", "the same with the adaptive filter in the loop", None,
                overshoot["estimate adaptive"], "%", "not given"),
        ],
    )  # fmt: skip


def _estimate(run: Run) -> Estimate:
    assert run.estimate is not None  # every run here has an estimator
    return run.estimate


def _figure_stiffness(
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
        caption="Blue: what the expert answered at the estimated displacement and the control "
        "current. Black: the same from the closed law at the true ones. Dotted: the constant of "
        "the linear filter. While the rotor overshoots beyond 0.5 mm it is outside the box of the "
        "rules, and the expert answers as at its edge.",
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


def _figure_step(runs: dict[str, Run]) -> Figure:
    return Figure(
        id="fig15",
        title="Step response of 0.5 mm: reference, truth, measured, estimated",
        source="paper, Fig. 15",
        caption="Above with the linear, below with the adaptive filter in the loop, with the same "
        "noise. The estimate lies on the truth in both; the measurement scatters around it and "
        "comes a little late.",
        panels=[
            Panel(TIME, POSITION, _lines(run, name), title=title)
            for (name, run), title in zip(
                runs.items(), ("linear filter", "adaptive filter"), strict=True
            )
        ],
    )


def _figure_close(runs: dict[str, Run]) -> Figure:
    window = (STEP_TIME - 0.002, STEP_TIME + 0.028)

    def cut(run: Run) -> Run:
        kept = slice(*(round(end / run.record.t[1]) for end in window))
        e = _estimate(run)
        return Run(
            run.record.between(*window),
            Estimate(
                e.t[kept], e.mean[kept], e.innovation[kept], e.innovation_variance[kept],
                e.k_i[kept], e.k_s[kept], e.status[kept], None, e.estimator,
            ),
        )  # fmt: skip

    near = {name: cut(run) for name, run in runs.items()}
    return Figure(
        id="fig16",
        title="The same step, its first milliseconds",
        source="paper, Fig. 16 (which gives no more than 'rotor displacement')",
        caption="Drawn large: zoom in to see the measurement lag the truth by the sensor's 0.2 ms "
        "and scatter "
        "by 9 µm, which the estimate does not.",
        panels=[
            Panel(TIME_MS, POSITION, _lines(run, name), title=title)
            for (name, run), title in zip(
                near.items(), ("linear filter", "adaptive filter"), strict=True
            )
        ],
        columns=2,
    )
