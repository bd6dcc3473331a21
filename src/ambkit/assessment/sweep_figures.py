"""Figures of the loop over frequency and speed: sensitivity, modes, and demands of a run-up."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import compress
from typing import Any, Literal

import numpy as np

from ambkit.assessment import assessment_figure
from ambkit.assessment.assessment_figure import LOOKS, Curves
from ambkit.base.arrays import Array, Complex, grouped
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.control.linear.closed_loop import Loop
from ambkit.judge.loop.capacity import ROOM
from ambkit.judge.loop.margins import grid
from ambkit.judge.loop.measured_sensitivity import MeasuredSensitivity
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel, Points, Rule, Vector
from ambkit.result.row import ZERO
from ambkit.rotordynamics.campbell import SPEED, operating_speed

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


SLOW = 2.0  #: Upper end of the modes' axis, over the peak's frequency or the speed.
LINEAR = 20.0  #: Highest peak of abs(S) on a linear axis.
DAMPED = 0.995  #: Damping ratio above which a mode counts as overdamped.


def over_speed_figure(result: Any, zones: Sequence[tuple[str, float]]) -> Figure:
    """Plot sensitivity of each axis, and frequency and damping of the closed loop's modes."""
    near = [k == 0 or limit < 1.5 * np.nanmax(result.peaks) for k, (_, limit) in enumerate(zones)]
    peaks = [*compress(assessment_figure.zone_rules(zones), near), *_of_axes(result, result.peaks)]
    peaks.append(Line(result.speed, result.largest, signal="bound", label="largest singular value"))
    speed_axis = replace(SPEED, limits=(0.0, float(result.speed[-1])))
    own_speed = operating_speed(result.machine)
    top = SLOW * max(float(result.speed[-1]), 2 * math.pi * _fastest_mode(result))
    speeds, frequencies, ratios = list[float](), list[float](), list[float]()
    for speed, poles in zip(result.speed, result.poles, strict=True):
        size = np.abs(poles)
        ratio = -poles.real / np.maximum(size, 1e-300)
        swings = (poles.imag > 0) & (ratio < DAMPED) & (poles.imag < top)
        speeds += [float(speed)] * int(swings.sum())
        frequencies += poles.imag[swings].tolist()
        ratios += ratio[swings].tolist()
    at = np.array(speeds)
    rotation_speeds = result.speed[result.speed <= top]
    modes: list[Item] = [
        Points(at, np.array(frequencies), signal="mode", label="modes of the closed loop"),
        Line(rotation_speeds, rotation_speeds, signal="constant", label="speed of rotation"),
    ]
    damping: list[Item] = [Points(at, np.array(ratios), signal="mode", label="")]
    highest = max(3.5, 1.1 * float(np.nanmax(np.append(result.largest, result.peaks))))
    scale: Literal["linear", "log"] = "log" if highest > LINEAR else "linear"
    peak_axis = Axis("peak of |S|", scale=scale, limits=(1.0, highest))
    return Figure(
        "over-speed",
        f"{markdown(result.machine.name)}: closed loop over speed, controllers fed by "
        f"{result.fed_by}",
        "Each axis with all other loops closed; the worst one decides the zone of ISO 14839-3. "
        "Right: oscillating modes of rotor, controllers and filter together.",
        [
            Panel(speed_axis, peak_axis, peaks + own_speed, title="Sensitivity"),
            Panel(speed_axis, Axis("frequency", "Hz", 1 / (2 * math.pi)), modes, title="Campbell"),
            Panel(speed_axis, Axis("damping ratio", limits=(0.0, 1.0)), damping, title="Damping"),
        ],
        columns=3,
        panel_height=2.8,
    )


def run_up_figure(result: Any) -> Figure:
    """Plot displacement, current and voltage in a slow run-up, with their limits."""
    shares = result.orbit / result.clearance
    room = assessment_figure.zone_rules(ROOM)
    room += _of_axes(result, shares) + operating_speed(result.machine)
    current: list[Item] = [Rule(1.0, signal="limit", label="limit")]
    used = result.current / result.current_limit
    current += _of_axes(result, used)
    panels = [
        Panel(SPEED, _share("share of the clearance", shares, 0.55), room, title="Displacement"),
        Panel(SPEED, _share("share of the current limit", used, 1.1), current, title="Current"),
    ]
    if result.voltage is not None:
        volts: list[Item] = [Rule(1.0, signal="limit", label="limit")]
        volts += _of_axes(result, result.voltage)
        panels.append(
            Panel(
                SPEED, _share("voltage, of its limit", result.voltage, 1.1), volts, title="Voltage"
            )
        )
    if result.temperature is not None:
        warm: list[Item] = []
        if result.temperature_limit is not None:
            warm.append(Rule(result.temperature_limit - ZERO, signal="limit", label="limit"))
        temperatures = np.where(np.isfinite(result.temperature), result.temperature - ZERO, np.nan)
        highest = max(
            np.nanmax(temperatures, initial=0.0), (result.temperature_limit or ZERO) - ZERO
        )
        axis = Axis("coil temperature", "°C", limits=(0.0, 1.1 * float(highest)))
        panels.append(Panel(SPEED, axis, [*warm, *_of_axes(result, temperatures)], title="Coils"))
    return Figure(
        "run-up",
        f"{markdown(result.machine.name)}: run-up through its unbalance, controllers fed by "
        f"{result.fed_by}",
        "Sum of static load, unbalance, runout and three times the rms noise (the voltage without "
        "noise), of the linear loop in steady state at each speed, coil temperatures included. "
        "Lines A, B and C are the upper limits of the zones of ISO 14839-2.",
        panels,
        columns=2,
        panel_height=2.8,
    )


def _share(label: str, values: Vector, least: float) -> Axis:
    """Return an axis from 0 to beyond limit and values."""
    highest = float(np.nanmax(values, initial=0.0))
    return Axis(label, "%", 100.0, limits=(0.0, max(least, 1.1 * highest)))


def _of_axes(result: Any, values: Vector) -> list[Item]:
    """Return a line for each axis, one for equal ones."""

    def alike(k: int, other: int) -> bool:
        return np.allclose(values[:, k], values[:, other], rtol=1e-3, equal_nan=True)

    return [
        Line(
            result.speed, values[:, same[0]], signal=LOOKS[k % len(LOOKS)],
            label=" and ".join(result.axes[axis] for axis in same),
        )
        for k, same in enumerate(grouped(values.shape[1], alike))
    ]  # fmt: skip


def _fastest_mode(result: Any) -> float:
    """Return the frequency of the fastest lightly damped mode at standstill [Hz]."""
    poles = result.poles[0]
    swings = (poles.imag > 0) & (-poles.real < 0.7 * np.abs(poles))
    return float(poles.imag[swings].max(initial=0.0)) / (2 * math.pi)
