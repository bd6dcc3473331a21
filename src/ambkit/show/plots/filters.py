"""Filters along a record: what they estimate, and how their innovations fare."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.escaping import label as label_of
from ambkit.base.escaping import markdown
from ambkit.data.signals import signal
from ambkit.estimate.estimate import Status
from ambkit.judge.evaluation import true_signal
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Band, Item, Line, Note, Points
from ambkit.result.report.style import style_of
from ambkit.show.plots.signal_styles import (
    CURRENT,
    DISTURBANCE,
    NOISE,
    POSITION,
    TIME,
    VELOCITY,
    looks,
)

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.estimate import Estimate
    from ambkit.judge.evaluation import Evaluation
    from ambkit.models.model import Descriptor

Array = NDArray[np.float64]

_SMOOTHED = ("smoothed", "smoothed 2", "smoothed 3")

STRETCHES, STRETCH = 200, 20
"""Innovations of a longer record are shown by so many stretches, of so many samples at least."""

BEYOND = 1.5
"""An axis of innovations is cut where the largest is farther out by this than most are."""


def filter_figure(
    record: Record,
    evaluated: Mapping[str, Evaluation],
    smoothed: Mapping[str, Estimate] | None = None,
) -> Figure:
    """Show what filters estimate along a record, and how their innovations fare."""
    t = record.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    smoothed = smoothed or {}

    def known(signal: str, style: str, **label: str) -> list[Item]:
        return [Line(t, record[signal], signal=style, **label)] if signal in record else []

    def true(state: str) -> list[Item]:
        truth = true_signal(record, state)
        return [] if truth is None else [Line(t, truth, signal="truth")]

    def told(signal: str) -> list[Item]:
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

    estimates = [evaluation.estimate for evaluation in evaluated.values()]
    absent = _absent(record, estimates[0])
    innovations = [
        innovation_panel(name, evaluation.estimate, time, absent)
        for name, evaluation in evaluated.items()
    ]
    settled = settled_samples(t, estimates)

    def panel(state: Descriptor) -> Panel:
        axis = of_state(state)
        items = [*true(state.name), *told(state.name)]
        if state.name == "x":
            items = [*known("y", "measured"), *known("r", "reference"), *items]
            items += known("x_logged", "logged")
        if state.name == "v":
            items = [*known("v_logged", "logged"), *items]
        if state.role != "position":
            axis = with_limits(axis, items, settled)
        return Panel(time, axis, [*items, *absent])

    late = {n: None for item in estimates for n in item.of_role("current")}
    currents = [
        Panel(time, CURRENT, [*true(f"iu{name.removeprefix('i')}"), *told(name), *absent])
        for name in late
    ]
    coloured = [] if any(estimates[0].readings) else drawn(lambda entry: entry.sensor_noise)
    noises = [Panel(time, NOISE, [*whole_noise(record), *coloured, *absent])] if coloured else []
    return Figure(
        id="filter",
        title=f"Estimates along {markdown(record.meta.get('source') or 'the record')}",
        caption="Bounds: two standard deviations of the innovation as the filter expects it. First "
        "guesses, at the start and after a long gap, may reach beyond the axes.",
        panels=[
            *(panel(state) for state in estimates[0].states if state.role in AXES),
            *currents,
            *noises,
            *innovations,
        ],
    )


AXES = {"position": POSITION, "velocity": VELOCITY, "disturbance force": DISTURBANCE}
"""Axes of the states that are shown, by their roles."""


def of_state(state: Descriptor) -> Axis:
    """Return the axis of a state; one of several is named, and a tilt is in mrad."""
    axis = AXES[state.role]
    if state.name not in ("x", "v", "f_d"):
        axis = replace(axis, label=f"{axis.label} {state.name}")
    return replace(axis, unit=axis.unit.replace("mm", "mrad")) if "rad" in state.unit else axis


def whole_noise(record: Record) -> list[Item]:
    """Show all of the sensor's noise, where the truth is known."""
    if "x_m" not in record.truth:
        return []
    return [Line(record.t, record["y"] - record["x_m"], signal="measured")]


def _absent(record: Record, estimate: Estimate) -> list[Item]:
    """Mark where nothing was measured."""
    from ambkit.show.plots.reading import missing_spans

    t = record.t
    lost = np.isnan([record[signal("y", name)] for name in estimate.readings or ("",)]).any(axis=0)
    edges = np.flatnonzero(np.diff(np.r_[False, lost, False]))
    stretches = [(float(t[a]), float(t[b - 1])) for a, b in edges.reshape(-1, 2)]
    return list(missing_spans(stretches, t))


def with_limits(axis: Axis, items: Iterable[Item], where: NDArray[np.bool_]) -> Axis:
    """Return the axis with limits that show the lines whole where they count."""
    edges = [item.y for item in items if isinstance(item, Line)]
    edges += [edge for item in items if isinstance(item, Band) for edge in (item.low, item.high)]
    values = np.concatenate([edge[where] for edge in edges])
    low, high = np.nanmin(values), np.nanmax(values)
    margin = 0.05 * (high - low)
    if not margin > 0:
        return axis
    return replace(axis, limits=(float(low - margin), float(high + margin)))


def settled_samples(t: NDArray[np.float64], estimates: Iterable[Estimate]) -> NDArray[np.bool_]:
    """Where no filter guesses: in the dark at the start, and anew after a gap where it was HELD."""
    # What they guess there would flatten all else.
    blind = np.zeros(t.size, dtype=bool)
    blind[0] = True
    for estimate in estimates:
        blind |= (estimate.status & np.uint16(Status.HELD)) != 0
    last = np.maximum.accumulate(np.where(blind, np.arange(t.size), 0))
    settled = np.asarray(t >= t[last] + 0.02 * np.ptp(t))
    return settled if settled.any() else np.ones(t.size, dtype=bool)


def _innovations(t: Array, innovation: Array) -> Item:
    """Show innovations one by one, or of a long record how far most of each stretch reach."""
    count = t.size // STRETCH
    if count < STRETCHES:
        return Line(t, innovation, signal="innovation")
    length = t.size // STRETCHES
    stretches = innovation[: STRETCHES * length].reshape(STRETCHES, length)
    known = np.isfinite(stretches).sum(axis=1) >= STRETCH // 2
    low, high = np.full((2, STRETCHES), np.nan)
    low[known], high[known] = np.nanquantile(stretches[known], (0.025, 0.975), axis=1)
    middle = t[: STRETCHES * length].reshape(STRETCHES, length).mean(axis=1)
    return Band(middle, low, high, signal="innovation", label="innovation, 95 % of a stretch")


def innovation_panel(name: str, estimate: Estimate, time: Axis, absent: Sequence[Item]) -> Panel:
    """Show innovations beside what the filter expects; mark those that would flatten the rest."""
    # Of several readings those whose innovations are largest by what is expected.
    t, e, S = estimate.t, estimate.innovation, estimate.innovation_variance
    if e.ndim > 1:
        k = int(np.argmax((e**2 / np.where(S > 0, S, np.inf)).mean(axis=0)))
        e, S, name = e[:, k], S[:, k], f"{name} {estimate.readings[k]}".strip()
    usable = estimate.used | ((estimate.status & np.uint16(Status.OUTLIER)) != 0)
    innovation, expected = np.where(usable, e, np.nan), 2 * np.sqrt(S)
    # The first bounds are so wide that they would make a line of all others.
    expected[expected > 1.5 * np.median(expected)] = np.nan
    expected[expected == 0] = np.nan  # a low-pass has no idea of them
    items: list[Item] = [
        _innovations(t, innovation),
        Line(t, expected, signal="bound", label="±2√S"),
        Line(t, -expected, signal="bound", label=""),
        *absent,
    ]
    axis = Axis(f"innov. {label_of(name)}" if name else "innovation", "µm", 1e6)
    sizes = np.abs(innovation[np.isfinite(innovation)])
    if not sizes.size:
        return Panel(time, axis, items)
    most = float(np.nanmax([np.quantile(sizes, 0.995), *expected]))
    if sizes.max() <= BEYOND * most:
        return Panel(time, axis, items)
    edge = 1.3 * most
    far = np.flatnonzero(np.abs(np.nan_to_num(innovation)) > edge)
    for sign, style in ((1, "beyond above"), (-1, "beyond below")):
        side = far[np.sign(innovation[far]) == sign]
        if side.size:
            items.append(Points(t[side], np.full(side.size, 0.9 * sign * edge), signal=style))
    largest = far[np.argmax(np.abs(innovation[far]))]
    value = f"{1e6 * innovation[largest]:.0f} µm".replace("-", "−")
    up = innovation[largest] > 0
    # Beside the record's end the text would not fit.
    at = float(np.clip(t[largest], *(t[0] + np.ptp(t) * np.array([0.05, 0.95]))))
    items.append(Note(at, 0.84 * edge * (1 if up else -1), value, "below" if up else "above"))
    return Panel(time, replace(axis, limits=(-edge, edge)), items)
