"""The report of a comparison: who did best, when it matters, what is the limit, how it was done."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ambkit.base.units import with_error
from ambkit.judge.comparison.bench import TRAINING, Bench, Standing
from ambkit.judge.comparison.criteria import CRITERIA
from ambkit.judge.comparison.spread import CERTAIN
from ambkit.judge.comparison.study import Study
from ambkit.result.report.blocks import Cell, Chapter, FigureBlock, Remark, Report, TableBlock, Text
from ambkit.result.report.figure import Figure
from ambkit.result.report.items import Axis
from ambkit.result.report.markup import symbols
from ambkit.show.plots import study as figures

STEP = Axis("step of the position", "mm", 1e3)
RATIO = Axis("magnet constant of the plant, over the known one")


def report_of(study: Study) -> Report:
    """Build the report."""
    from importlib.metadata import version

    bench = study.bench
    chapters = [_result(study), _how(study)]
    if study.steps is not None and study.wrong_k is not None:
        chapters.insert(1, _around(study))
    if study.model is not None:
        chapters.insert(2, _limit(study))
    return Report(
        title=f"Estimators compared: {bench.bearing.name}",
        subtitle=f"case {bench.case.name}: {bench.case.title}",
        lead=_lead(bench),
        version=version("ambkit"),
        chapters=chapters,
        facts={
            "bearing": bench.bearing.name,
            "runs": f"{bench.runs}, {bench.stopped} left out" if bench.stopped else str(bench.runs),
            "first seed": str(bench.seed),
            "tuning": f"{bench.budget} evaluations each" if bench.budget else "defaults",
        },
    )


def report_of_cases(benches: Mapping[str, Bench]) -> Report:
    """Build the report of several cases."""
    from importlib.metadata import version

    first = next(iter(benches.values()))

    def entry(bench: Bench, name: str) -> str | None:
        standing = bench.best[name]
        if not np.isfinite(standing.mean("f_d")):
            return None
        return with_error(standing.mean("f_d"), standing.half_width("f_d"))

    table = TableBlock(
        id="cases_table",
        title=r"Error of $F_\mathrm{St}$ [N], mean and 95 % confidence interval",
        headers=["estimator", *benches],
        rows=[
            [standing.label, *(entry(bench, name) for bench in benches.values())]
            for name, standing in first.best.items()
        ],
    )
    chapters = [
        Chapter(
            id="all",
            title="All cases",
            lead="Who sees the disturbance force best depends on what is wrong with the model.",
            blocks=[FigureBlock(figures.cases_figure(benches)), table],
        )
    ]
    for name, bench in benches.items():
        blocks: list[FigureBlock | TableBlock] = [
            FigureBlock(figures.matrix_figure(bench, f"matrix-{name}")),
            _errors_table(
                bench.best, f"errors-{name}", "Errors, mean and 95 % confidence interval"
            ),
        ]
        if bench.tuned:
            blocks.append(_tuning_table(bench, f"tuning-{name}"))
        title = f"{name}: {bench.case.title}"
        chapters.append(Chapter(name, title, blocks, lead=bench.case.about))
    return Report(
        title=f"Estimators compared: {first.bearing.name}",
        subtitle="in all cases",
        lead="The same records and the same start for all, and the same effort of tuning in each "
        "case.",
        version=version("ambkit"),
        chapters=chapters,
        facts={
            "bearing": first.bearing.name,
            "runs": f"{first.runs} in each case",
            "first seed": str(first.seed),
            "tuning": f"{first.budget} evaluations each" if first.budget else "defaults",
        },
    )


def _lead(bench: Bench) -> str:
    standing = {n: s for n, s in bench.best.items() if np.isfinite(s.mean("f_d"))}
    if not standing:
        return "No estimator has finished a run."
    best = min(standing.values(), key=lambda s: s.mean("f_d"))
    text = (
        f"The same records and the same start for all. The least error of the disturbance force "
        f"has the **{best.label}**, {best.mean('f_d'):.3f} ± {best.half_width('f_d'):.3f} N rms"
    )
    linear = standing.get("linear")
    if linear is not None and best is not linear:
        share = best.mean("f_d") / linear.mean("f_d")
        text += f": {100 * share:.0f} % of the linear Kalman filter's {linear.mean('f_d'):.3f} N"
    position = [s.mean("x") for s in standing.values()]
    text += (
        f". Errors of the position lie between {1e6 * min(position):.2f} and "
        f"{1e6 * max(position):.2f} µm rms."
    )
    return text


def _result(study: Study) -> Chapter:
    bench = study.bench
    return Chapter(
        id="result",
        title="Who does best",
        lead=bench.case.about,
        blocks=[
            FigureBlock(figures.matrix_figure(bench)),
            _errors_table(bench.best, "errors", "Errors, mean and 95 % confidence interval"),
            Text(_alike(bench)),
            FigureBlock(figures.cost_figure(bench)),
            FigureBlock(figures.run_figure(study.first, study.field, bench)),
        ],
    )


def _alike(bench: Bench) -> str:
    """Say whose error cannot be told from the best one's: paired over the runs."""
    from scipy.stats import ttest_rel

    standing = {n: s for n, s in bench.best.items() if np.isfinite(s.mean("f_d"))}
    if len(standing) < 2:
        return ""
    first = min(standing, key=lambda n: standing[n].mean("f_d"))
    alike = []
    for name, other in standing.items():
        a, b = other.figures["f_d"], standing[first].figures["f_d"]
        both = np.isfinite(a) & np.isfinite(b)
        if name == first or both.sum() < 3:
            continue
        difference = a[both] - b[both]
        if np.ptp(difference) == 0 or ttest_rel(a[both], b[both]).pvalue > 0.05:
            alike.append(other.label)
    if not alike:
        return (
            r"By the runs' own pairs, the difference in $F_\mathrm{St}$ between the best and each "
            "of the others is beyond chance (t test of pairs, 5 %)."
        )
    return (
        r"In $F_\mathrm{St}$ these cannot be told from the best by the runs' own pairs (t test of "
        f"pairs, 5 %): {', '.join(alike)}."
    )


def _errors_table(standings: Mapping[str, Standing], id: str, title: str) -> TableBlock:
    names = ("x", "v", "f_d", "force", "nees", "nis", "white", "delay", "lost", "cost")

    def entry(standing: Standing, name: str) -> str | None:
        mean, half = (CRITERIA[name].factor * f(name) for f in (standing.mean, standing.half_width))
        if not np.isfinite(mean):
            return None
        if name in ("lost", "cost") or not np.isfinite(half):
            return f"{mean:.3g}"
        return with_error(mean, half)

    return TableBlock(
        id=id,
        title=title,
        headers=[
            "estimator",
            *(_head(name) for name in names),
        ],
        rows=[[s.label, *(entry(s, n) for n in names)] for s in standings.values()],
    )


def _head(name: str) -> str:
    label, unit = symbols(CRITERIA[name].label), CRITERIA[name].unit
    return f"{label} [{unit}]" if unit else label


def steps(study: Study) -> Figure:
    """Show the errors against the height of the step."""
    assert study.steps is not None
    return figures.sweep_figure(
        "steps",
        study.steps,
        STEP,
        "Errors against the height of the step",
        "A step, then a load. Bars: 95 % confidence. Where a line leaves the picture, the "
        "estimator has lost the rotor or nearly so.",
        ("x", "f_d"),
    )


def wrong_k(study: Study) -> Figure:
    """Show the errors against the plant's magnet constant."""
    assert study.wrong_k is not None
    return figures.sweep_figure(
        "wrong_k",
        study.wrong_k,
        RATIO,
        "Errors where the magnet constant is wrong",
        "A step of three tenths of the travel, then a load.",
        ("x", "f_d"),
    )


def limit_steps(study: Study) -> Figure:
    """Show the errors and the limit against the height of the step, where the model is true."""
    assert study.limit is not None
    return figures.sweep_figure(
        "limit_steps",
        study.limit,
        STEP,
        "Errors and the limit",
        "Black: what nobody crosses. Near the centre the linear model is right; further out only "
        "filters that know the law stay at the limit.",
        ("x", "f_d"),
    )


def _around(study: Study) -> Chapter:
    return Chapter(
        id="around",
        title="When it matters",
        lead="How the errors grow with the distance from the centre, and with a magnet constant "
        "that is not the one that the estimators know.",
        blocks=[
            FigureBlock(steps(study)),
            FigureBlock(wrong_k(study)),
        ],
    )  # fmt: skip


def _limit(study: Study) -> Chapter:
    assert study.model is not None
    model = study.model
    return Chapter(
        id="limit",
        title="The limit",
        lead="Where all is as the filters' model says, no estimator of any kind can have a smaller "
        "error than the posterior Cramér-Rao bound.",
        blocks=[
            Text(
                "The bound of Tichavský, Muravchik and Nehorai (1998) needs the inverse of the "
                "process noise, which does not exist here: noise enters the states through the "
                "control signals and the disturbances only. It is therefore taken in the state at "
                "the start and these noises, with the inequality of van Trees (1968), the "
                "Jacobians along true runs, and expectations over several of them. The load is a "
                "random walk with the variance that the filters assume, all noise is white, the "
                "force law is the closed one; with their defaults the filters then assume the "
                "truth, and nothing is tuned."
            ),
            FigureBlock(limit_steps(study)),
            FigureBlock(figures.efficiency_figure(model)),
            TableBlock(
                id="limit_table",
                title="Limit, and how close each comes to it",
                headers=["estimator", "x", "v", r"$F_\mathrm{St}$"],
                rows=[_limits(model), *_efficiencies(model)],
                digits=".3f",
            ),
        ],
    )  # fmt: skip


def _limits(model: Bench) -> list[Cell]:
    x, v, f_d = (model.limit[signal] for signal in ("x", "v", "f_d"))
    return ["limit [µm, mm/s, N]", 1e6 * x, 1e3 * v, f_d]


def _efficiencies(model: Bench) -> list[list[Cell]]:
    return [
        [standing.label, *(model.efficiency(name, signal) for signal in ("x", "v", "f_d"))]
        for name, standing in model.best.items()
    ]


def _how(study: Study) -> Chapter:
    bench, case = study.bench, study.bench.case
    spread = (
        "The plant is the nominal one."
        if case.spread == CERTAIN
        else "Scrambled Sobol points spread the plant around the nominal one, which the estimators "
        "go on with: " + ", ".join(
            f"{name.replace('_', ' ')} ±{100 * share:.0f} %"
            for name, share in vars(case.spread).items()
        ) + "."
    )  # fmt: skip
    blocks: list[Text | TableBlock | Remark | FigureBlock] = [
        Text(
            f"{bench.runs} records are made in closed loop, with the untuned linear filter in it, "
            "and each estimator runs along the same ones, from the same first measurement. "
            f"{spread} Criteria of the loop come from the same runs made anew with each estimator "
            "in the loop. The first two of the plant's own times do not count."
        ),
        TableBlock(
            id="criteria",
            title="The criteria",
            headers=["criterion", "what it is"],
            rows=[[c.label.replace("−", "-"), c.about] for n, c in CRITERIA.items()],
        ),
    ]
    if bench.tuned:
        blocks += [
            Text(
                f"Each estimator had {bench.budget} evaluations on {TRAINING} runs of its own "
                "seeds: its defaults, then scrambled Sobol points for up to half of them, then a "
                "simplex from the best (Nelder and Mead 1965). The objective is the mean over x, v "
                r"and $F_\mathrm{St}$ of the RMSE, each relative to the untuned linear filter's. "
                "The variance of the measurement stays the bearing's, for only the ratios of the "
                "variances count."
            ),
            _tuning_table(bench),
            _errors_table(bench.default, "untuned", "The same, untuned"),
        ]
    return Chapter(
        id="how",
        title="How it was compared",
        lead="The same records, the same start, the same effort for each; judged on runs that "
        "nothing was tuned on.",
        blocks=blocks,
    )


def _tuning_table(bench: Bench, id: str = "tuning") -> TableBlock:
    rows: list[list[Cell]] = []
    for name, standing in bench.tuned.items():
        assert standing.tuning is not None
        units = bench.units.get(name, {})
        found = "; ".join(
            f"{key.removeprefix('noise.')} {value:.3g} {units.get(key, '')}".strip()
            + f" (×{value / bench.default[name].values[key]:.2g})"
            for key, value in standing.values.items()
        )
        rows.append([standing.label, standing.tuning.default, standing.tuning.objective,
                     standing.tuning.evaluations, found or "nothing to tune"])  # fmt: skip
    return TableBlock(
        id=id,
        title="What was tuned",
        headers=["estimator", "objective untuned", "tuned", "evaluations", "found"],
        rows=rows,
        digits=".3f",
    )
