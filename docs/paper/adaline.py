"""Chapter 2: magnet force and constant by ADALINE (paper, eq. 22-25, Fig. 5, 6, 11, 12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.identification.online.adaline import Adaline, AdalineResult
from ambkit.result.report import Axis, Figure, Line, Panel, Rule
from ambkit.result.report.blocks import Chapter, Equation, FigureBlock, Text
from ambkit.simulation.run import Run
from paper.study import SEEDS, TIME, Part, Study, mean_row, reached, row

Array = NDArray[np.float64]

STEP = 0.5e-3  # m
START = 0.5  # of the true magnet constant
LOAD = 3.0  # N
WRONG_MASS = 1.1
MANY = 100  # seeds of the noisy case, whose worst is wanted
SETTLED = 0.6  # of the record: k has settled from there on
WIDE, WIDE_RATE = 200.0, 0.2  # Hz, 1: an element that follows the force's peak, for Fig. 11

K_AXIS = Axis("magnet constant $k_{\\mathrm{Magnet}}$", "N mm²/A²", 1e6)


def adaline(study: Study) -> Part:
    """Identify force and k from step responses, clean, noisy, loaded, and with a wrong mass."""
    truth = study.bearing.magnet.magnet_constant
    clean = study.run(study.scenario(STEP, noise=False))
    noisy = study.run(study.scenario(STEP))
    loaded = study.run(study.scenario(STEP, LOAD))
    learned = {
        "clean": _learn(study, clean),
        "noisy": _learn(study, noisy),
        "clean wide": _learn(study, clean, bandwidth=WIDE, rate_force=WIDE_RATE),
        "noisy wide": _learn(study, noisy, bandwidth=WIDE, rate_force=WIDE_RATE),
        "loaded": _learn(study, loaded),
        "load known": _learn(study, loaded, disturbance=loaded.record["f_d"]),
        "wrong mass": _learn(study, noisy, mass=WRONG_MASS),
    }
    clean_off = _worst(learned["clean"], truth)
    (noisy_off,) = study.over_seeds(lambda seed: _noisy(study, seed), MANY)
    few, many = np.quantile(noisy_off, (0.05, 0.95))
    of_load, of_told, of_mass = study.over_seeds(lambda seed: _limits(study, seed))
    median_row = mean_row(
        "fig12.noisy", f"ADALINE, error of k: paper's noise, median of {MANY} seeds", noisy_off, "%"
    ) | {"ours": float(np.median(noisy_off))}

    def said(off: Array) -> str:
        return f"{off.mean():+.2f} ± {off.std(ddof=1):.2f} %"

    return Part(
        Chapter(
            id="adaline",
            title="ADALINE: magnet force and magnet constant",
            lead="Two adaptive linear elements. The first identifies the magnet force from "
                 "the motion, the second the magnet constant from force, current and gap.",
            blocks=[
                Equation(r"x(k+1) = x + T v + \frac{T^2}{2m} (F_\mathrm{St} + F_0) + "
                         r"\frac{T^2}{2m} F_\mathrm{Magnet}", "eq. 24"),
                Equation(r"F_\mathrm{Magnet} = k_\mathrm{Magnet} \left[ \left(\frac{i_0 + "
                         r"i_u}{s_0 - x}\right)^2 - "
                         r"\left(\frac{i_0 - i_u}{s_0 + x}\right)^2 \right]", "eq. 25"),
                Text("$F_0$ is the known forces, here the rotor's weight. The elements learn by "
                     r"the normalised Widrow-Hoff rule, $w(k+1) = w + r e / x_\mathrm{in}$. It is "
                     r"stable for $0 < r < 2$; the error settles "
                     "as $(1-r)^n$, and a fraction $r/(2-r)$ of the noise variance remains. Here "
                     "$r = 0.05$ for the force and $0.002$ for k, which averages over a tenth of a "
                     "second. A measured position differentiated twice would bury the force in "
                     "noise ($2m/T^2$ is 10⁸ N/m), so position and regressor pass the same "
                     "low-pass filter: an equal loss on both sides does not affect k."),
                Text("The paper draws the element as a block diagram (Fig. 5: inputs, "
                     "weights, a sum, and the error that moves the weights), and its "
                     "connection to the plant (Fig. 6): the inputs are position and control "
                     "signal, the first element passes the identified force to the second, "
                     "and the output is k."),
                FigureBlock(_figure_force(study, clean, noisy, learned)),
                FigureBlock(_figure_constant(study, learned["clean"], learned["noisy"], truth)),
                Text("**Accuracy.** The measure is the largest error of k over the last two "
                     f"fifths of the record. Without noise it is {clean_off:.3f} %; with the "
                     f"paper's noise {np.median(noisy_off):.2f} % in the median of {MANY} "
                     f"seeds, {few:.2f} to {many:.2f} % in nine of ten, {noisy_off.max():.2f} "
                     "% in the worst."),
                FigureBlock(_figure_limits(study, learned, truth)),
                Text("**Limits.** One record determines only the ratio of k to the mass, and "
                     f"only if the other forces are known. A load of {LOAD:g} N that the "
                     f"element does not know shifts k by {said(of_load)}; a known one, by "
                     f"{said(of_told)}. A mass that is {100 * (WRONG_MASS - 1):.0f} % too "
                     f"large makes k {said(of_mass)} wrong (at the end of the record, {SEEDS} "
                     "seeds). Without current and motion k cannot be identified: the "
                     "excitation is monitored, and k is held while it is too small."),
            ],
        ),
        [
            row("fig12.clean", "ADALINE, error of k: no noise "
                "(goal 0.5 %)", None, clean_off, "%", reached(clean_off <= 0.5)),
            median_row,
            row("fig12.worst", "ADALINE, error of k: paper's noise, worst seed (goal 2 %)", None,
                float(noisy_off.max()), "%", reached(float(noisy_off.max()) <= 2.0), MANY),
            mean_row("adaline.load", f"ADALINE, error of k: f_d unknown, {LOAD:g} N",
                     of_load, "%"),
            mean_row("adaline.mass", "ADALINE, error of k: mass 10 % too large", of_mass, "%"),
        ],
    )  # fmt: skip


def _learn(
    study: Study, run: Run, *, mass: float = 1.0, disturbance: Array | None = None, **options: float
) -> AdalineResult:
    """Learn from half the true k, with the mass times a factor."""
    machine = study.bearing.replace(rotor__mass=mass * study.bearing.rotor.mass)
    start = START * study.bearing.magnet.magnet_constant
    element = Adaline(machine, start=start, **options)
    return element.run(run.record, disturbance=disturbance)


def _worst(result: AdalineResult, truth: float) -> float:
    """Largest error of k once it has settled [%]."""
    settled = result.k[int(SETTLED * len(result.k)) :]
    return 100 * float(np.max(np.abs(settled / truth - 1)))


def _noisy(study: Study, seed: int) -> tuple[float]:
    """Largest error once settled [%], with the noise of a seed."""
    truth = study.bearing.magnet.magnet_constant
    return (_worst(_learn(study, study.run(study.scenario(STEP, seed=seed))), truth),)


def _limits(study: Study, seed: int) -> list[float]:
    """Errors of k at the end [%]: with an unknown load, a known one, and a wrong mass."""
    truth = study.bearing.magnet.magnet_constant
    loaded = study.run(study.scenario(STEP, LOAD, seed=seed))
    results = (
        _learn(study, loaded),
        _learn(study, loaded, disturbance=loaded.record["f_d"]),
        _learn(study, study.run(study.scenario(STEP, seed=seed)), mass=WRONG_MASS),
    )
    return [100 * float(result.k[-1] / truth - 1) for result in results]


def _figure_force(
    study: Study, clean: Run, noisy: Run, learned: dict[str, AdalineResult]
) -> Figure:
    axis = Axis("magnet force $F_{\\mathrm{Magnet}}$", "N")

    def panel(run: Run, of: str, title: str) -> Panel:
        return Panel(TIME, axis, [
            Line(run.record.t, learned[f"{of} wide"].force, signal="estimate linear",
                 label=f"identified, low-pass of {WIDE:g} Hz"),
            Line(run.record.t, run.record["f_mag"], signal="truth"),
            Line(run.record.t, learned[of].force, signal="identified",
                 label="identified, low-pass of 38 Hz"),
        ], title=title)  # fmt: skip

    return Figure(
        id="fig11",
        title="Identified magnet force, step of 0.5 mm without disturbance",
        source="paper, Fig. 11",
        caption="What the magnet exerts, and what the first element finds from the motion. A wide "
        "low-pass follows the force's peak, and lets the noise of the twice differentiated "
        "position through; a narrow one is quiet and rounds the peak. For the magnet constant the "
        "narrow one is better: the second element sees current and gap through the same low-pass. "
        f"{study.one_run}",
        panels=[panel(clean, "clean", "without noise"),
                panel(noisy, "noisy", "with the paper's noise")],
    )  # fmt: skip


def _figure_constant(
    study: Study, clean: AdalineResult, noisy: AdalineResult, truth: float
) -> Figure:
    return Figure(
        id="fig12",
        title="Learning the magnet constant from half its value",
        source="paper, Fig. 12",
        caption="From 3.35 the second element learns 6.7 N mm²/A² in a quarter of a second. Below, "
        "the error: without noise it goes on shrinking, with the paper's it does not. "
        f"{study.one_run}",
        panels=[
            Panel(TIME, K_AXIS, [
                Rule(truth, signal="truth"),
                Line(noisy.t, noisy.k, signal="estimate linear", label="with the paper's noise"),
                Line(clean.t, clean.k, signal="identified", label="without noise"),
            ]),
            Panel(TIME, Axis("size of the error", "%", 100, "log", (1e-6, 1)), [
                Line(noisy.t, np.abs(noisy.k / truth - 1), signal="estimate linear", label=""),
                Line(clean.t, np.abs(clean.k / truth - 1), signal="identified", label=""),
                Rule(0.005, signal="limit", text="0.5 %", label=""),
                Rule(0.02, signal="limit", text="2 %", label=""),
            ]),
        ],
    )  # fmt: skip


def _figure_limits(study: Study, learned: dict[str, AdalineResult], truth: float) -> Figure:
    shown = {
        "noisy": ("series 1", "nothing wrong"),
        "loaded": ("series 2", "unknown load of 3 N from 0.25 s"),
        "load known": ("series 3", "the same load, known"),
        "wrong mass": ("series 4", "mass 10 % too large"),
    }
    return Figure(
        id="adaline_limits",
        title="What a disturbance or a wrong mass does to the magnet constant",
        caption="The element attributes every force to the magnet. An unknown load or a wrong "
        f"mass biases k; a known load does not. {study.one_run}",
        panels=[
            Panel(TIME, K_AXIS, [
                Rule(truth, signal="truth"),
                *(Line(learned[name].t, learned[name].k, signal=signal, label=label)
                  for name, (signal, label) in shown.items()),
            ]),
        ],
    )  # fmt: skip
