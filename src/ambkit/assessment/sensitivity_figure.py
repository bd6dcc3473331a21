"""Figures of a measured or swept sensitivity, over that of the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.assessment import assessment_figure
from ambkit.assessment.assessment_figure import Curves
from ambkit.base.arrays import Array, Complex
from ambkit.base.units import engineering
from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.margins import grid
from ambkit.judge.loop.measured_sensitivity import MeasuredSensitivity
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel, Points, Rule

Zones = Sequence[tuple[str, float]]

LOWEST = -30.0  #: Lower end of the sensitivity axis [dB].

AMPLITUDES = ("series 1", "series 2", "series 3", "series 4")
"""Styles of the sweeps, in order, repeated as needed."""


def measured_figure(
    title: str, result: MeasuredSensitivity, models: Sequence[Curves], *, zones: Zones, top: float
) -> Figure:
    """Plot a measured sensitivity with its 95 % interval, its open loop and the coherence."""
    f, (low, high) = result.frequency, result.interval()
    frequency = Axis("frequency", "Hz", scale="log", limits=(0.8 * f[0], 1.25 * f[-1]))
    bode = assessment_figure.zone_lines(zones, top)
    bode.append(Band(f, _decibels(low), _decibels(high), signal="estimate", label="95 % interval"))
    bode.append(
        Points(f, _decibels(np.abs(result.sensitivity)), signal="estimate", label="measured")
    )
    L, _ = result.open_loop()
    visible = np.maximum(np.abs(L.real), np.abs(L.imag)) < 10
    curves: list[Item] = [Points(L.real[visible], L.imag[visible], signal="estimate", label="")]
    for k, (name, loop, axis) in enumerate(models):
        look = ("truth", *assessment_figure.LOOKS[2:])[k % (len(assessment_figure.LOOKS) - 1)]
        at = _between(loop, f)
        S = loop.of_axis(axis, at)
        open_ = 1 / S - 1
        bode.append(Line(at, _decibels(np.abs(S)), signal=look, label=f"model, {name}"))
        curves.append(assessment_figure.near(Line(open_.real, open_.imag, signal=look, label="")))
    heights = _heights(np.abs(result.sensitivity), high[np.isfinite(high)])
    return Figure(
        "measured-sensitivity",
        title,
        f"{result.periods} period{'s' * (result.periods > 1)}; the interval is that of |S| at a "
        f"single frequency. {assessment_figure.ZONE_CAPTION}",
        [
            Panel(frequency, heights, bode, title="Sensitivity"),
            assessment_figure.nyquist_panel(curves, zones),
            Panel(frequency, Axis("coherence", limits=(0.0, 1.05)),
                  [Points(f, result.coherence, signal="estimate", label="")],
                  title="Coherence of y with the signal"),
            Panel(frequency, Axis("half width of the interval", "%", 100.0, "log"),
                  [Points(f, (high - low) / 2 / np.abs(result.sensitivity), signal="estimate",
                          label="")], title="Error of |S|"),
        ],
        columns=2,
        panel_height=2.6,
    )  # fmt: skip


def sweep_figure(
    title: str,
    loop: Loop | None,
    axis: int,
    swept: Sequence[tuple[float, Array, Complex, Complex | None]],
    *,
    zones: Zones,
    top: float,
) -> Figure:
    """Plot sweeps of the simulated loop, with the linear model if there is one."""
    f = np.concatenate([item[1] for item in swept])
    frequency = Axis("frequency", "Hz", scale="log", limits=(0.8 * f.min(), 1.25 * f.max()))
    bode, off = assessment_figure.zone_lines(zones, top), list[Item]()
    sizes = [np.abs(item[2]) for item in swept]
    if loop is not None:
        at = _between(loop, f)
        sizes.append(np.abs(loop.of_axis(axis, at)))
        bode.append(Line(at, _decibels(sizes[-1]), signal="truth", label="linear model"))
        off.append(Rule(0.02, signal="reference", label="2 %"))
    for k, (amplitude, where, S, linear) in enumerate(swept):
        look, name = AMPLITUDES[k % len(AMPLITUDES)], engineering(amplitude, "m", 3)
        bode.append(Points(where, _decibels(np.abs(S)), signal=look, label=name))
        if linear is not None:
            off.append(Line(where, np.abs(S - linear) / np.abs(linear), signal=look, label=name))
    panels = [Panel(frequency, _heights(*sizes), bode, title="Sensitivity")]
    note = f"its peak is labelled. {assessment_figure.ZONE_CAPTION.partition(';')[0]}."
    if off:
        distance = Axis("distance from the model", "%", 100.0, "log", (1e-5, 3.0))
        panels.append(Panel(frequency, distance, off))
        note += " Below: relative deviation from the linear model."
    return Figure(
        "sweep",
        title,
        "The signal is added to the measurement of the simulated loop, with the magnet's "
        f"nonlinearity and all limits; {note}",
        panels,
        panel_height=2.8,
    )


def _between(loop: Loop, f: Array) -> Array:
    """Return frequencies for a model's curve (k,) [Hz] in the measured range."""
    at = grid(loop)
    frequencies: Array = at[(at >= 0.8 * f.min()) & (at <= 1.25 * f.max())]
    return frequencies


def _heights(*sizes: Array) -> Axis:
    lowest = _decibels(np.concatenate(sizes)).min()
    highest = _decibels(np.concatenate(sizes)).max()
    limits = max(LOWEST, min(-14.0, float(lowest) - 2)), min(40.0, max(16.0, float(highest) + 2))
    return Axis("sensitivity |S|", "dB", limits=limits)


def _decibels(sizes: Array) -> Array:
    """Return magnitudes in dB, none below 1e-6."""
    levels: Array = 20 * np.log10(np.maximum(sizes, 1e-6))
    return levels
