"""Filters along a record: what they estimate, and how their innovations fare."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.data.record import Record
from ambkit.data.record_card import missing_spans
from ambkit.data.signals import signal
from ambkit.estimate.errors import true_signal
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimate_panels import (
    innovation_panel,
    settled_samples,
    true_noise,
    with_limits,
)
from ambkit.judge.evaluation import Evaluation
from ambkit.models.model import Descriptor
from ambkit.result.report import Axis, Figure, Item, Line, Panel
from ambkit.result.report.style import style_of
from ambkit.result.signal_styles import (
    CURRENT,
    DISTURBANCE,
    NOISE,
    POSITION,
    TIME,
    VELOCITY,
    looks,
)

_SMOOTHED = ("smoothed", "smoothed 2", "smoothed 3")


CAPTION = (
    "Bounds: two standard deviations of the innovation as the filter expects it. First guesses, at "
    "the start and after a long gap, may reach beyond the axes."
)
LOGGED = {
    "x": ((("y", "measured"), ("r", "reference")), (("x_logged", "logged"),)),
    "v": ((("v_logged", "logged"),), ()),
}
"""Signals of a record drawn below and above the estimates of a state, with their styles."""


def filter_figure(
    record: Record,
    evaluated: Mapping[str, Evaluation],
    smoothed: Mapping[str, Estimate] | None = None,
) -> Figure:
    """Show what filters estimate along a record, and how their innovations fare."""
    t = record.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    smoothed = smoothed or {}

    def true(state: str) -> list[Item]:
        truth = true_signal(record, state)
        return [] if truth is None else [Line(t, truth, signal="truth")]

    def estimated(signal: str) -> list[Item]:
        return drawn(lambda estimate: estimate[signal] if signal in estimate.names else None)

    def drawn(read: Callable[[Estimate], Array | None]) -> list[Item]:
        names = (label or style_of(style).label for style, label in looks(smoothed))
        after = ((style, f"{name}, smoothed") for style, name in zip(cycle(_SMOOTHED), names))
        estimates = [*(item.estimate for item in evaluated.values()), *smoothed.values()]
        return [
            Line(t, values, signal=style, label=label)
            for (style, label), estimate in zip([*looks(evaluated), *after], estimates, strict=True)
            if (values := read(estimate)) is not None
        ]

    estimates = [item.estimate for item in evaluated.values()]
    absent = _absent(record, estimates[0])
    innovations = [
        innovation_panel(name, item.estimate, time, absent) for name, item in evaluated.items()
    ]
    settled = settled_samples(t, estimates)

    def logged(signals: Sequence[tuple[str, str]]) -> list[Item]:
        return [Line(t, record[name], signal=style) for name, style in signals if name in record]

    def panel(state: Descriptor) -> Panel:
        axis = of_state(state)
        below, above = LOGGED.get(state.name, ((), ()))
        items = [*logged(below), *true(state.name), *estimated(state.name), *logged(above)]
        if state.role != "position":
            axis = with_limits(axis, items, settled)
        return Panel(time, axis, [*items, *absent])

    late = {n: None for item in estimates for n in item.of_role("current")}
    currents = [
        Panel(time, CURRENT, [*true(f"iu{name.removeprefix('i')}"), *estimated(name), *absent])
        for name in late
    ]
    coloured = [] if any(estimates[0].readings) else drawn(lambda entry: entry.sensor_noise)
    noises = [Panel(time, NOISE, [*true_noise(record), *coloured, *absent])] if coloured else []
    return Figure(
        id="filter",
        title=f"Estimates along {markdown(record.meta.get('source') or 'the record')}",
        caption=CAPTION,
        panels=[
            *(panel(state) for state in estimates[0].states if state.role in AXES),
            *currents, *noises, *innovations,
        ],
    )  # fmt: skip


AXES = {"position": POSITION, "velocity": VELOCITY, "disturbance force": DISTURBANCE}
"""Axes of the states that are shown, by their roles."""


def of_state(state: Descriptor) -> Axis:
    """Return the axis of a state; one of several is named, and a tilt is in mrad."""
    axis = AXES[state.role]
    if state.name not in ("x", "v", "f_d"):
        axis = replace(axis, label=f"{axis.label} {state.name}")
    return replace(axis, unit=axis.unit.replace("mm", "mrad")) if "rad" in state.unit else axis


def _absent(record: Record, estimate: Estimate) -> list[Item]:
    """Mark where nothing was measured."""
    t = record.t
    lost = np.isnan([record[signal("y", name)] for name in estimate.readings or ("",)]).any(axis=0)
    edges = np.flatnonzero(np.diff(np.r_[False, lost, False]))
    stretches = [(float(t[a]), float(t[b - 1])) for a, b in edges.reshape(-1, 2)]
    return list(missing_spans(stretches, t))
