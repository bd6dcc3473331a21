"""The picture of an experiment for the sensitivity: what it does, and what it would tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.escaping import markdown
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Band, Item, Line, Points, Rule
from ambkit.show.plots.signal_styles import CURRENT, POSITION, TIME

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.identification.excitation import Limits
    from ambkit.judge.loop.measured_sensitivity import MeasuredSensitivity


def injection_figure(
    name: str, record: Record, limits: Limits, expected: MeasuredSensitivity
) -> Figure:
    """Show an experiment for the sensitivity over time, and the interval that it would give."""
    t = record.t

    def within(signal: str, limit: float, style: str, label: str) -> list[Item]:
        return [
            Line(t, record[signal], signal=style, label=label),
            Rule(limit, signal="limit", label="limit"),
            Rule(-limit, signal="limit", label="limit"),
        ]

    f, (low, high) = expected.frequency, expected.interval()
    S = np.abs(expected.sensitivity)
    frequency = Axis("frequency", "Hz", scale="log", limits=(0.8 * f[0], 1.25 * f[-1]))
    return Figure(
        "injection",
        f"Experiment for the sensitivity of {markdown(name)}",
        "As simulated, with the noise of the bearing; below, what this record tells.",
        [
            Panel(TIME, POSITION, [
                Line(t, record["injected"], signal="reference", label="added to the measurement"),
                *within("x", limits.displacement, "truth", "position"),
            ]),
            Panel(TIME, CURRENT, within("iu", limits.current, "control", "control current")),
            Panel(frequency, Axis("sensitivity |S|", limits=(0.0, 1.2 * float(high.max()))), [
                Band(f, low, high, signal="estimate", label="95 % interval"),
                Points(f, S, signal="estimate", label="told"),
            ]),
        ],
    )  # fmt: skip
