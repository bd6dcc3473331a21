"""Figures of an identification: estimates with intervals, residuals, predictions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.escaping import label, markdown
from ambkit.base.units import engineering, interval, typeset
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.baselines import FROM_THE_PAST, PREDICTORS
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import NOISES
from ambkit.identification.maximum_likelihood.validation import Validation
from ambkit.result.report import (
    Axis,
    Bars,
    Cells,
    Figure,
    Intervals,
    Item,
    Line,
    Panel,
    Points,
    Rule,
)

RECORDS = ("record 1", "record 2", "record 3", "record 4")
LAG = Axis("lag", "samples")
RATIO = Axis("estimate / initial")
ORDER = ("bearing", "noise", "offsets", "delay", "position-dependent noise")
WIDE = 3.0  #: Ratio of the ends above which an axis is logarithmic.
FITS = ("error", "held", "of_start")  #: Predictors whose fit is plotted.
SHOWN = 400  #: Samples of the prediction in the figure.


def identified_figure(result: Any, checks: Sequence[Validation]) -> Figure:
    """Plot estimates, residuals and predictions in one figure."""
    estimates = estimates_figure(result).panels
    # The two panels of the residuals are side by side.
    fit, beside = fit_figure(checks).panels, len(estimates) % 2
    panels = [*estimates, *fit[:beside], *residual_figure(checks).panels, *fit[beside:]]
    return Figure(
        id="identified",
        title=f"Identification of {markdown(result.isolated.name)}",
        caption="",
        panels=panels,
        columns=2,
    )


def estimates_figure(result: Any) -> Figure:
    """Plot estimates with 95 % intervals, and the initial values."""
    # Grouped by suitable axis, one panel per group.
    groups: dict[tuple[str, Axis], list[tuple[str, float, float, float, str]]] = {}
    for p in result.parameters:
        value, (low, high), start = result[p.name], result.interval(p.name), p.of(result.start)
        ends = interval(low, high, p.unit, 4, like=value)
        text = typeset(f"{engineering(value, p.unit, 4)},  {ends}")
        if p.positive:
            group = "noise" if p.name in NOISES else "bearing", RATIO
            row = (value / start, low / start, high / start)
        else:
            scale, group = _natural(result, p.name)
            row = ((value - start) / scale, (low - start) / scale, (high - start) / scale)
        groups.setdefault(group, []).append((f"${p.symbol}$", *row, text))
    panels = []
    for (title, axis), entries in sorted(
        groups.items(), key=lambda group: ORDER.index(group[0][0])
    ):
        names, values, low_ends, high_ends, texts = zip(*entries, strict=True)
        wide = axis is RATIO and max(high_ends) > WIDE * min(low_ends)
        intervals = Intervals(
            names, np.array(values), np.array(low_ends), np.array(high_ends), texts,
            signal="identified", label="estimate, 95 % interval",
        )  # fmt: skip
        start_at = Rule(1.0 if axis is RATIO else 0.0, axis="x", signal="start")
        panel_axis = replace(axis, scale="log") if wide else axis
        panels.append(Panel(panel_axis, Axis(""), [start_at, intervals], title=title))
    return Figure(
        id="estimates",
        title="Identified parameters, 95 % intervals",
        caption="Ratios to the initial model, with intervals of their logarithm; offsets are "
        "differences from it.",
        panels=panels,
        columns=2,
    )


def correlation_figure(result: Any) -> Figure:
    """Plot the correlation of the estimates."""
    names = [f"${p.symbol}$" for p in result.parameters]
    texts = [[f"{r:+.2f}".replace("-", "−") for r in row] for row in result.correlation]
    cells: list[Item] = [Cells(names, names, (1 + result.correlation) / 2, texts, diverging=True)]
    return Figure(
        id="correlations",
        title="Correlation of the estimates",
        caption="Near ±1 the records determine a combination of two parameters better than either.",
        panels=[Panel(Axis(""), Axis(""), cells)],
        panel_height=0.6 + 0.27 * len(names),
    )


def residual_figure(checks: Sequence[Validation]) -> Figure:
    """Plot the autocorrelation of the residuals and their correlation with the control."""
    panels = []
    for title, picks in (
        ("autocorrelation of the residuals", [check.residual for check in checks]),
        ("correlation with past control signals", [check.cross for check in checks]),
    ):
        bound = max(white.bound for white in picks)
        items: list[Item] = [
            Points(np.arange(1.0, white.correlation.size + 1), white.correlation,
                   signal=RECORDS[i % len(RECORDS)], label=label(check.name))
            for i, (white, check) in enumerate(zip(picks, checks, strict=True))
        ]  # fmt: skip
        items += [Rule(sign * bound, signal="bound", label="") for sign in (1, -1)]
        panels.append(Panel(LAG, Axis("correlation"), items, title=title))
    return Figure(
        id="residuals",
        title="Residuals: autocorrelation, and correlation with past control signals",
        caption="For a complete model 95 % of the points lie between the lines.",
        panels=panels,
        columns=2,
    )


def fit_figure(checks: Sequence[Validation]) -> Figure:
    """Plot the fit of predictions over the horizon."""
    items: list[Item] = []
    for i, check in enumerate(checks):
        ahead = np.array(list(check.fit()), dtype=float)
        look = RECORDS[i % len(RECORDS)]
        fit, held, of_start = (np.array(list(check.fit(kind).values())) for kind in FITS)
        items += [
            Points(ahead, fit, signal=look, label=label(check.name)),
            Line(ahead, fit, signal=look, label=""),
            Line(ahead, held, signal=f"{look} held", label="last measurement held"),
        ]
        if of_start.size:
            items.append(
                Line(
                    ahead, of_start, signal=f"{look} start", label="prediction of the initial model"
                )
            )
    fits = [fit for check in checks for kind in FITS for fit in check.fit(kind).values()
            if math.isfinite(fit)]  # fmt: skip
    low = 10 * math.floor(min([90.0, *fits]) / 10)
    limits = (max(-100.0, low), 103.0)
    panel = Panel(
        Axis("samples ahead", scale="log"), Axis("fit", "%", limits=limits), items,
        title="prediction",
    )  # fmt: skip
    names = tuple(label(check.name) for check in checks)
    ahead_past = max((k for check in checks for k in check.errors.get("arx", ())), default=0)
    bars: list[Item] = [
        Bars(names, np.array([check.errors.get(kind, {}).get(ahead_past, math.nan)
                              for check in checks]), signal=signal, label=text)
        for kind in FROM_THE_PAST for _, signal, text in [PREDICTORS[kind]]
    ]  # fmt: skip
    past = Panel(
        Axis("record"), Axis("error, rms", "µm", 1e6), bars,
        title=f"from the past alone, {ahead_past} samples ahead",
    )  # fmt: skip
    return Figure(
        id="fit",
        title="Prediction: fit against the number of samples ahead",
        caption="100 % is perfect; 0 % is no better than the mean. One colour per record; dashed: "
        "initial model; dotted: last measurement held.",
        panels=[panel, past] if ahead_past else [panel],
    )


def prediction_figure(model: LoopModel, record: Record, ahead: int, name: str) -> Figure:
    """Plot a prediction with the measurement, in the part with the largest motion."""
    predicted = model.predict(record, ahead)
    y, t = record["y"][ahead:], record.t[ahead:]
    width = min(SHOWN, y.size)
    moves = np.abs(np.diff(np.where(np.isfinite(y), y, 0.0), prepend=y[:1]))
    busy = np.convolve(moves, np.ones(width), mode="valid")
    quarter = busy.size // 4  # not where the filter starts
    first = quarter + int(np.argmax(busy[quarter:]))
    part = slice(first, first + width)
    time = Axis("time", "s")
    miss: list[Item] = [
        Line(t[part], (y - predicted)[part], signal="innovation", label="measured less predicted")
    ]
    return Figure(
        id="prediction",
        title=f"Predicted {ahead} samples ahead, {markdown(name)}",
        caption="Where the rotor moves most.",
        panels=[
            Panel(time, Axis("position", "mm", 1e3), [
                Line(t[part], y[part], signal="truth", label="measured"),
                Line(t[part], predicted[part], signal="estimate", label="predicted"),
            ]),
            Panel(time, Axis("prediction error", "µm", 1e6), miss),
        ],
    )  # fmt: skip


def _natural(result: Any, name: str) -> tuple[float, tuple[str, Axis]]:
    """Return the natural unit of an offset, and its panel."""
    b = result.isolated
    if name == "delay":
        return b.sampling_time, ("delay", Axis("estimate − initial", "samples"))
    if name == "position_noise":
        return 1.0, ("position-dependent noise", Axis("estimate − initial", "1/m"))
    percent = Axis("estimate − initial, of clearance and bias", "%", 100.0)
    scale = b.clearance if name == "position_offset" else b.magnet.bias_current
    return scale, ("offsets", percent)
