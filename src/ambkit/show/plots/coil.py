"""A coil that was found: its time constant over the distance, and what it leaves of each log."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Line, Points, Rule

if TYPE_CHECKING:
    from ambkit.identification.coil import CoilFit

SHOWN = 0.6
"""Seconds shown around the largest step of a log."""


def coil_figure(fit: CoilFit) -> Figure:
    """Show the largest step down of one log, the time constant, and what is left of each log."""
    names, records = list(fit.records), list(fit.records.values())
    distance = Axis("distance $z$", "mm", 1e3)
    at = np.linspace(0.0, 1.05 * max(fit.distance.values()), 200)
    far = sorted(range(len(names)), key=lambda k: fit.distance[names[k]])[len(names) // 2]
    record = records[far]
    jump = int(np.argmax(np.abs(np.diff(record["u"]))))
    half_window = round(SHOWN / 2 / record.sampling_time)
    cut = slice(max(jump - half_window // 3, 0), jump + half_window)
    parts = np.array([(fit.distance[n], fit.each[n], fit.left_out.get(n, np.nan)) for n in names])
    return Figure(
        id="coil",
        title="A coil, from steps of its control signal",
        caption=f"Above the largest step of {names[far]}.",
        panels=[
            Panel(Axis("time $t$", "s"), Axis("coil current $i$", "A"), [
                Line(record.t[cut], record["i"][cut], signal="measurement", label="measured"),
                Line(record.t[cut], fit.coil.current(record)[cut], signal="fit", label="found"),
            ]),
            Panel(distance, Axis("time constant", "ms", 1e3), [
                Line(at, fit.coil.time_constant(at), signal="fit", label="found"),
            ]),
            Panel(distance, Axis("left, rms", "mA", 1e3), [
                Rule(fit.noise, signal="bound", label="noise"),
                Points(parts[:, 0], parts[:, 1], signal="measurement", label="found from it"),
                Points(parts[:, 0], parts[:, 2], signal="estimate", label="found without it"),
            ]),
        ],
    )  # fmt: skip
