"""Chapter 4: the expert system, trained (paper, eq. 32-33, Fig. 9, 10, Table 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.fuzzy.expert import Expert
from ambkit.machine import paper
from ambkit.machine.stiffness import ForceFunction
from ambkit.result.report import Axis, Figure, Heatmap, Line, Panel
from ambkit.result.report.blocks import Chapter, Equation, FigureBlock, Remark, TableBlock, Text
from paper.study import CURRENT, POSITION, Part, Study, reached, row
from paper.tables import widths_csv

Array = NDArray[np.float64]

GOAL_WIDTHS, GOAL_BOTH = 0.16, 0.05  # N


def expert(study: Study) -> Part:
    """Compare six ways to the force, over the box that the rules span."""
    models: dict[str, tuple[str, ForceFunction]] = {
        "constant": ("constant stiffness (eq. 14)", _linear(study)),
        "printed": ("network as printed, Table 6", Expert.paper().force),
        "normalised": ("Table 6, normalised", Expert.paper(normalised=True).force),
        "gradient": ("widths by steepest gradient, normalised", study.descended.force),
        "widths": ("widths by least squares, normalised", study.widths.force),
        "both": ("widths and weights, normalised", study.expert.force),
    }
    rms = {key: study.map.force_rms(force) for key, (_, force) in models.items()}
    whole = study.map.force_rms()

    def beside(error: float) -> str:
        return "better" if error < rms["constant"] else "worse"

    return Part(
        Chapter(
            id="expert",
            title="The expert system: a fuzzy basis function network",
            lead="One rule at each of the 25 operating points. Between them each rule "
            "is weighted by a Gaussian, whose width the paper trains.",
            blocks=[
                Equation(r"u_i = e^{-(\|x - \tau_i\|)^2 / (2 \sigma_i^2)}", "eq. 32"),
                Equation(r"y = \sum w_i u_i", "eq. 33, as printed"),
                Equation(r"y = \frac{\sum w_i u_i}{\sum u_i}", "normalised"),
                TableBlock(
                    id="force_rms",
                    title="Force error over the box |i_u| ≤ 1.5 A, |x| ≤ 0.5 mm",
                    headers=["model", "RMS error [N]", "of the force"],
                    rows=[
                        [name, rms[key], f"{100 * rms[key] / whole:.1f} %"]
                        for key, (name, _) in models.items()
                    ],
                    digits=".3f",
                    caption=f"RMS over the area of the box; the force itself is {whole:.2f} N RMS. "
                    "The paper gives no such figure.",
                ),
                Remark("As printed, it is worse than no expert",
                       "With the widths of Table 6 most rules are far narrower than the distance "
                       "to their neighbours (0.75 A, 0.25 mm). Between the nodes the sum of eq. 33 "
                       "then falls towards zero, and the stiffness with it. Divided by the sum of "
                       "the memberships, the same widths are useful: the output is a weighted mean "
                       "of the rules, and cannot leave their range."),
                Text("The network has three layers (the paper's Fig. 9, a block diagram): the "
                     "inputs are current and displacement, each of the 25 hidden nodes "
                     "computes its membership, and the output is the weighted sum of the "
                     "conclusions. There are two networks, one for each stiffness. The "
                     "training is deterministic: the samples have no noise, and the start is "
                     "not random."),
                FigureBlock(_figure_errors(study, models)),
                FigureBlock(_figure_learning(study)),
                Text("Steepest gradient, as in the paper, starts from 0.4 and adapts the "
                     "widths only, with the stiffnesses of the LSM machine as targets. Least "
                     "squares (trust region, exact Jacobian) needs tens of steps instead of a "
                     "thousand. It fits the force and, with a smaller weight, both "
                     "stiffnesses, because the force alone does not determine k_i and k_s "
                     "separately."),
                _table6(study),
            ],
        ),
        [
            row("force_rms.constant", "Force error over the box: constant stiffnesses", None,
                rms["constant"], "N rms", "not given"),
            row("force_rms.printed",
                "Force error over the box: as printed (eq. 33)",
                None, rms["printed"], "N rms",
                beside(rms["printed"])),
            row("force_rms.normalised", "Force error over the box: normalised, same widths",
                None, rms["normalised"],
                "N rms", beside(rms["normalised"])),
            row("force_rms.gradient",
                "Force error over the box: steepest descent (goal 0.16)",
                None,
                rms["gradient"], "N rms", reached(rms["gradient"] <= GOAL_WIDTHS)),
            row("force_rms.widths", "Force error over the box: least squares (goal 0.16)",
                None, rms["widths"],
                "N rms", reached(rms["widths"] <= GOAL_WIDTHS)),
            row("force_rms.both", "Force error over the box: widths and weights (goal 0.05)", None,
                rms["both"], "N rms", reached(rms["both"] <= GOAL_BOTH)),
        ],
        {"table6.csv": widths_csv(study.descended)},
    )  # fmt: skip


def _linear(study: Study) -> ForceFunction:
    """Force of the constant stiffnesses."""
    return lambda iu, x: study.constant.k_i * iu + study.constant.k_s * x


def _figure_errors(study: Study, models: dict[str, tuple[str, ForceFunction]]) -> Figure:
    iu = np.linspace(study.map.current[0], study.map.current[-1], 61)
    x = np.linspace(study.map.displacement[0], study.map.displacement[-1], 41)
    currents, displacements = (g.ravel() for g in np.meshgrid(iu, x))
    truth = study.law.force(currents, displacements)

    def panel(key: str, limit: float) -> Panel:
        name, force = models[key]
        error = (np.asarray(force(currents, displacements)) - truth).reshape(x.size, iu.size)
        bar = Axis("error", "N", limits=(-limit, limit))
        # The constant law touches the force at the origin, and is flat around it.
        surface = Heatmap(iu, x, error, bar, diverging=True, zero=key != "constant")
        return Panel(CURRENT, POSITION, [surface], title=name)

    return Figure(
        id="expert_errors",
        title="Force errors of the models",
        caption="Top, scale ±6 N: the constant law fails in the corners, the network as "
                "printed everywhere between its nodes. Bottom, scale ±0.3 N: the trained "
                "normalised networks have small errors everywhere; with widths alone they are "
                "largest at the edge of the box.",
        panels=[panel("constant", 6.0), panel("printed", 6.0), panel("widths", 0.3),
                panel("both", 0.3)],
        columns=2,
    )  # fmt: skip


def _figure_learning(study: Study) -> Figure:
    curves = {
        "series 1": ("steepest gradient, widths (as the paper)", study.descended),
        "series 2": ("least squares, widths", study.widths),
        "series 3": ("least squares, widths and weights", study.expert),
    }
    return Figure(
        id="fig10",
        title="Learning curves of the expert",
        source="paper, Fig. 10",
        caption="Force error over the training samples after each step, from the untrained "
        "network. Least squares starts from widths of half a node step, the gradient from the "
        "paper's 0.4.",
        panels=[
            Panel(
                Axis("step, counted from 1", scale="log"),
                Axis("force error", "N rms", scale="log"),
                [
                    Line(np.arange(1.0, 1 + e.learning_curve.size), e.learning_curve,
                         signal=signal, label=label)
                    for signal, (label, e) in curves.items()
                ],
            ),
        ],
    )  # fmt: skip


def _table6(study: Study) -> TableBlock:
    printed, ours = paper.table6(), study.descended.widths
    return TableBlock(
        id="table6",
        title="Widths of the 25 rules, in units of 1 A and 1 mm",
        headers=["rule", "for $k_i$: paper", "ours", "for $k_s$: paper", "ours"],
        rows=[
            [f"{n + 1}: {r.current:g} A, {r.displacement * 1e3:g} mm",
             float(printed[0, n]), float(ours[0, n]), float(printed[1, n]), float(ours[1, n])]
            for n, r in enumerate(study.descended.rules)
        ],
        digits=".3g",
        caption="Ours: steepest gradient from 0.4 on the normalised network. They cannot "
                "equal the paper's, which gives neither its training samples nor their number "
                "of steps, and whose network is not normalised. Ours respect the symmetry of "
                "the law; the paper's do not.",
        source="paper, Table 6",
    )  # fmt: skip
