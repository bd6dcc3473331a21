"""Figures of a machine's loop over its speed: sensitivity, modes, and demands of a run-up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ambkit.assessment.assessment_figure import LOOKS
from ambkit.base.arrays import grouped
from ambkit.base.escaping import markdown
from ambkit.judge.loop.capacity import ROOM
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Points, Rule, Vector
from ambkit.result.row import ZERO
from ambkit.rotordynamics.campbell import SPEED

SLOW = 2.0  #: Upper end of the modes' axis, over the peak's frequency or the speed.
ZONES = "upper limits of zones A, B, C"  #: Label of their lines.
DAMPED = 0.995  #: Damping ratio above which a mode counts as overdamped.


def over_speed_figure(result: Any, zones: Sequence[tuple[str, float]]) -> Figure:
    """Plot sensitivity of each axis, and frequency and damping of the closed loop's modes."""
    peaks: list[Item] = [
        Rule(limit, signal="limit", text=name, label=ZONES if k == 0 else "")
        for k, (name, limit) in enumerate(zones)
        if k == 0 or limit < 1.5 * np.nanmax(result.peaks)
    ]
    peaks += _of_axes(result, result.peaks)
    peaks.append(Line(result.speed, result.largest, signal="bound", label="largest singular value"))
    top = SLOW * max(float(result.speed[-1]), 2 * math.pi * _busy(result))
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
    return Figure(
        "over-speed",
        f"{markdown(result.machine.name)}: closed loop over speed, controllers fed by "
        f"{result.fed_by}",
        "Each axis with all other loops closed; the worst one decides the zone of ISO 14839-3. "
        "Right: oscillating modes of rotor, controllers and filter together.",
        [
            Panel(SPEED, Axis("peak of |S|", limits=(1.0, highest)), peaks, title="Sensitivity"),
            Panel(SPEED, Axis("frequency", "Hz", 1 / (2 * math.pi)), modes, title="Campbell"),
            Panel(SPEED, Axis("damping ratio", limits=(0.0, 1.0)), damping, title="Damping"),
        ],
        columns=3,
        panel_height=2.8,
    )


def run_up_figure(result: Any) -> Figure:
    """Plot displacement, current and voltage in a slow run-up, with their limits."""
    shares = result.orbit / result.clearance
    room: list[Item] = [
        Rule(limit, signal="limit", text=name, label=ZONES if k == 0 else "")
        for k, (name, limit) in enumerate(ROOM)
    ]
    room += _of_axes(result, shares)
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


def _busy(result: Any) -> float:
    """Return the frequency of the fastest lightly damped mode at standstill [Hz]."""
    poles = result.poles[0]
    swings = (poles.imag > 0) & (-poles.real < 0.7 * np.abs(poles))
    return float(poles.imag[swings].max(initial=0.0)) / (2 * math.pi)
