"""The waterfall of a run-up."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Heatmap, Item, Line

TIME = Axis("time", "s")
FREQUENCY = Axis("frequency", "Hz")
RANGE = 60.0
"""Decibels that are told apart below the highest line."""


def waterfall_figure(result: Any) -> Figure:
    """Show spectra over time, with once and twice the speed of rotation."""
    one, unit = (1e-6, "µm") if result.unit == "m" else (1.0, result.unit)
    decibels = 20 * np.log10(np.maximum(result.amplitude / one, 1e-30))
    most = 10 * math.ceil(float(decibels.max()) / 10)
    bar = Axis("amplitude", f"dB re 1 {unit}", limits=(most - RANGE, float(most)))
    items: list[Item] = [
        Heatmap(
            result.t,
            result.frequency,
            np.clip(decibels, most - RANGE, most).T,
            bar,
            lines=1,
            zero=False,
        )
    ]
    once = np.abs(result.speed) / (2 * math.pi)
    for times, signal in ((1, "reference"), (2, "limit")):
        near = times * once <= result.frequency[-1]
        if near.sum() > 1:
            label = "speed of rotation" if times == 1 else "twice that"
            items.append(Line(result.t[near], times * once[near], signal=signal, label=label))
    return Figure(
        id="waterfall",
        title=f"Spectrum of {markdown(result.signal)} over the run",
        caption="Amplitude of each frequency, stretch by stretch; unbalance turns with the rotor.",
        panels=[Panel(TIME, FREQUENCY, items)],
        panel_height=3.6,
    )
