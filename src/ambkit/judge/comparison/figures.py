"""Figures of a comparison, one question each."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import label
from ambkit.data.signals import displacement
from ambkit.data.signals import signal as name_of
from ambkit.estimate.machine_model import View
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.criteria import CRITERIA, Criterion
from ambkit.result.report import Axis, Bars, Cells, Figure, Item, Line, Panel, Points, Rule
from ambkit.result.report.markup import symbols
from ambkit.result.report.style import OF_KINDS

TIMES = 3.0  #: Multiple of the best value that has the darkest colour.

SHOWN = {
    "x": Axis("error of position", "µm rms", 1e6),
    "v": Axis("error of velocity", "mm/s rms", 1e3),
    "f_d": Axis(r"error of $f_d$", "N rms"),
}


def _styles(names: Iterable[str]) -> dict[str, str]:
    """Return the style of each estimator, the same in all figures."""
    names = list(names)
    known = list(dict.fromkeys([*KINDS, *names]))
    return {name: f"kind {known.index(name) % len(OF_KINDS)}" for name in names}


def matrix_figure(bench: Any, id: str = "matrix") -> Figure:
    """Plot all estimators over all criteria; darker is worse."""
    scores = list(bench.best.values())
    names = [name for name in CRITERIA if any(np.isfinite(s.mean(name)) for s in scores)]
    shade = np.column_stack([_shades(scores, name) for name in names])
    texts = [[_text(CRITERIA[name].factor * s.mean(name)) for name in names] for s in scores]
    how = "tuned alike" if bench.tuned else "with their defaults"
    cells = Cells([_head(CRITERIA[name]) for name in names], list(bench.best), shade, texts)
    about = (
        f"{label(bench.machine.name)}, {bench.case.name}: {bench.case.title}; {_runs(bench)}, {how}"
    )
    shades = f"palest: best or ideal value of a column; darkest: {TIMES:g} times worse, or more"
    return Figure(
        id=id,
        title=f"All filters, all criteria, {how}",
        caption="Empty: the criterion does not apply.",
        panels=[Panel(Axis(shades), Axis(""), [cells], title=about)],
    )


def _head(criterion: Criterion) -> str:
    label = symbols(criterion.label)
    return f"{label}\n[{criterion.unit}]" if criterion.unit else label


def _shades(scores: Sequence[Any], name: str) -> Array:
    criterion = CRITERIA[name]
    means = np.array([score.mean(name) for score in scores])
    with np.errstate(divide="ignore", invalid="ignore"):
        if criterion.kind == "error":
            far = np.log(means / np.nanmin(np.where(means > 0, means, np.nan)))
        elif criterion.kind == "ratio":
            far = np.abs(np.log(means))
        else:
            far = np.abs(means - criterion.best) * 2 * np.log(TIMES)
    return np.asarray(np.clip(far / np.log(TIMES), 0, 1))


def _text(value: float) -> str:
    if not np.isfinite(value):
        return ""
    if abs(value) >= 99.5:
        return f"{value:.0f}"
    return f"{value:.1f}" if abs(value) >= 9.95 else f"{value:.2f}"


STEP = Axis("step of the position", "mm", 1e3)
SWEPT = {
    "steps": (STEP, "Errors against the height of the step", "A step, then a load. Bars: 95 % "
              "confidence. Where a line leaves the figure, the filter has lost the rotor, or "
              "nearly."),
    "wrong_k": (Axis("magnet constant of the plant, over the known one"),
                "Errors with a wrong magnet constant",
                "A step of 0.3 of the clearance, then a load."),
    "limit_steps": (STEP, "Errors and their bound", "Black: Cramér-Rao bound. Near the centre the "
                    "linear model is right; further out only filters with the nonlinear law "
                    "stay near it."),
}  # fmt: skip
"""Varied quantity of a sweep, and its title."""


def sweep_figure(id: str, swept: Any) -> Figure:
    """Plot the errors over one quantity, with the bound if it is known."""
    axis, title, caption = SWEPT[id]
    panels = []
    for signal in ("x", "f_d"):
        items: list[Item] = []
        for name, style in _styles(swept.errors).items():
            errors = swept.errors[name][signal]
            items += [
                Line(swept.values, errors, signal=style, label=""),
                Points(swept.values, errors, swept.half_widths[name][signal], signal=style,
                       label=name),
            ]  # fmt: skip
        if signal in swept.limit:
            items.append(Line(swept.values, swept.limit[signal], signal="truth", label="limit"))
        panels.append(Panel(axis, _from_zero(SHOWN[signal], items), items))
    return Figure(id=id, title=title, caption=caption, panels=panels, columns=2)


def _from_zero(axis: Axis, items: Sequence[Item]) -> Axis:
    """Start the axis at zero, and limit it so that one diverged filter does not hide the rest."""
    points = [item for item in items if isinstance(item, Points) and np.isfinite(item.y).all()]
    if not points:
        return axis
    # With confidence intervals, unless there is a single run.
    tops = [np.max(p.y + (0.0 if p.error is None else np.nan_to_num(p.error))) for p in points]
    highest = float(min(max(tops), 4 * np.median(tops)))
    return replace(axis, limits=(0.0, 1.05 * highest))


def cost_figure(bench: Any) -> Figure:
    """Plot the error over the time of a step."""
    scores = list(bench.best.values())
    items: list[Item] = []
    for name, style in _styles(bench.best).items():
        score = bench.best[name]
        cost, error = score.mean("cost"), score.mean("f_d")
        if np.isfinite(cost) and np.isfinite(error):
            width = np.array([score.half_width("f_d")])
            items.append(
                Points(np.array([cost]), np.array([error]), np.nan_to_num(width), signal=style,
                       label=name)
            )  # fmt: skip
    if "f_d" in bench.limit:
        items.append(Rule(bench.limit["f_d"], signal="truth", label="limit"))
    costs = np.array([s.mean("cost") for s in scores])
    highest = max((s.mean("f_d") for s in scores if np.isfinite(s.mean("f_d"))), default=1.0)
    return Figure(
        id="cost",
        title="Cost of a step and error of f_d",
        caption="Time of a step with its history stored, on the machine that made this figure; "
        "error of the disturbance force with its 95 % confidence interval. Lower left is better.",
        panels=[
            Panel(
                Axis("time a step", "ns", 1e9, "log",
                     (float(0.7 * np.nanmin(costs)), float(1.4 * np.nanmax(costs)))),
                Axis(r"error of $f_d$", "N rms", limits=(0.0, 1.15 * highest)),
                items,
            )
        ],
    )  # fmt: skip


def efficiency_figure(bench: Any) -> Figure:
    """Plot the efficiency of each estimator."""
    names = list(bench.default)
    signals = {"x": "x", "v": "v", "f_d": r"$f_d$"}
    bars: list[Item] = [
        Bars(names, np.array([bench.efficiency(name, signal) for name in names]),
             signal=f"series {place}", label=label)
        for place, (signal, label) in enumerate(signals.items(), 1)
    ]  # fmt: skip
    return Figure(
        id="efficiency",
        title="Efficiency: bound over error",
        caption="Cramér-Rao bound over rms error; at most 1, but for chance in a finite number of "
        "runs.",
        panels=[Panel(Axis(""), Axis("efficiency"), [*bars, Rule(1.0, signal="bound", label="")])],
    )


def run_figure(study: Any) -> Figure:
    """Plot one run: position, and the estimates of the disturbance force."""
    trial, field = study.first, study.field
    record, time = trial.record, Axis("time", "s")
    view = View(trial.plant)
    axis = view.machine.axes[0].name
    load, of = name_of("f_d", axis), f" along {label(axis)}" if axis else ""
    readings = np.array([record[name_of("y", reading.name)] for reading in view.machine.readings])
    estimate_lines: list[Item] = []
    start = len(record) // 25
    for name, style in _styles(field).items():
        estimate = field[name].build(**study.best[name].values).run(record)
        # The initial transient would compress the rest.
        estimate_lines.append(
            Line(record.t[start:], estimate[load][start:], signal=style, label=name)
        )
    values = np.concatenate([item.y for item in estimate_lines if isinstance(item, Line)])
    low, high = np.nanpercentile(values, [0.1, 99.9])
    low, high = min(low, record[load].min()), max(high, record[load].max())
    margin = 0.08 * (high - low)
    force = Axis(rf"$f_d${of}", "N", limits=(float(low - margin), float(high + margin)))
    return Figure(
        id="run",
        title="One run and its estimates",
        caption="Above: position. Below: disturbance force, which no sensor measures.",
        panels=[
            Panel(time, Axis(f"displacement $x${of}", "mm", 1e3), [
                Line(record.t, view.measured[0] @ readings, signal="measured"),
                Line(record.t, record[name_of("r", axis)], signal="reference"),
                Line(record.t, record[displacement(axis)], signal="truth"),
            ]),
            Panel(time, force, [*estimate_lines, Line(record.t, record[load], signal="truth")]),
        ],
        panel_height=2.2,
    )  # fmt: skip


def cases_figure(benches: Mapping[str, Any]) -> Figure:
    """Plot the error of the disturbance force in several cases, relative to the linear filter's."""
    first = next(iter(benches.values()))
    names = list(first.best)
    base = "linear" if "linear" in names else names[0]

    def ratio(bench: Any, name: str) -> float:
        return float(bench.best[name].mean("f_d") / bench.best[base].mean("f_d"))

    ratios = np.array([[ratio(bench, name) for bench in benches.values()] for name in names])
    with np.errstate(invalid="ignore"):
        shade = np.clip(0.5 + 0.5 * np.log(ratios) / np.log(TIMES), 0, 1)
    texts = [["" if np.isnan(value) else f"{value:.2f}" for value in row] for row in ratios]
    heads = [name.replace("-", "\n") for name in benches]
    how = "tuned alike" if first.tuned else "with their defaults"
    about = (
        rf"{label(first.machine.name)}: error of $f_d$ over that of {base}; "
        f"{_runs(first)} in each case, {how}"
    )
    shades = f"blue: a smaller error; brown: a larger one; darkest: a factor of {TIMES:g}, or more"
    cells = Cells(heads, names, shade, texts, diverging=True)
    return Figure(
        id="cases",
        title=f"Error of the disturbance force over that of {base}, {how} in each case",
        caption="",
        panels=[Panel(Axis(shades), Axis(""), [cells], title=about)],
    )


def _runs(bench: Any) -> str:
    return f"{bench.runs} runs" if bench.runs > 1 else "1 run"
