"""Figure of an experiment: signals, spectra, and the distribution of its information."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.data.record import Record
from ambkit.result.report import Axis, Figure, Item, Line, Panel, Rule
from ambkit.result.signal_styles import CURRENT, POSITION, TIME

FREQUENCY = Axis("frequency", "Hz", scale="log")

_LOOKS = ("series 1", "series 2", "series 3", "series 4", "constant")


def excitation_figure(design: Any) -> Figure:
    """Plot an experiment over time and over frequency."""
    record, T = design.record, design.record.sampling_time
    reference = Line(record.t, record["r"], signal="reference")
    frequency, reference_spectrum = _amplitudes(record["r"], T)
    _, moved = _amplitudes(record["x"], T)
    in_band = (frequency >= 0.5 * design.band[0]) & (frequency <= 2 * design.band[1])
    top = 2 * max(np.max(reference_spectrum[in_band]), np.max(moved[in_band]))
    # Values lower by a factor of a thousand are noise, or zeros between two lines.
    amplitude = Axis("amplitude", "µm", 1e6, "log", limits=(1e-3 * top, top))
    excited: list[Item] = [
        Line(frequency[in_band], reference_spectrum[in_band], signal="reference", label=""),
        Line(frequency[in_band], moved[in_band], signal="truth", label=""),
    ]
    name = markdown(design.expectation.model.isolated.name)
    return Figure(
        id="excitation",
        title=f"Experiment for {name}: {design.excitation.kind}",
        caption="Simulated with the noise of the machine. Below: share of the information on each "
        "parameter in each third of an octave, the other parameters known.",
        panels=[
            *panels_within(record, design.limits, reference),
            Panel(FREQUENCY, amplitude, excited),
            Panel(FREQUENCY, Axis("information", "%", 100.0), _shares(design, T)),
        ],
    )  # fmt: skip


def panels_within(record: Record, limits: Any, added: Line) -> list[Panel]:
    """Plot position and current of an experiment within its limits, and the added signal."""

    def within(signal: str, limit: float, style: str, label: str) -> list[Item]:
        return [
            Line(record.t, record[signal], signal=style, label=label),
            *(Rule(sign * limit, signal="limit", label="limit") for sign in (1, -1)),
        ]

    position = within("x", limits.displacement, "truth", "position")
    current = within("iu", limits.current, "control", "control current")
    return [Panel(TIME, POSITION, [added, *position]), Panel(TIME, CURRENT, current)]


def _amplitudes(values: Array, T: float) -> tuple[Array, Array]:
    """Return positive frequencies [Hz], and the amplitudes of a signal there."""
    amplitude: Array = 2 / values.size * np.abs(np.fft.rfft(values))
    return np.asarray(np.fft.rfftfreq(values.size, T)[1:], dtype=float), amplitude[1:]


def _shares(design: Any, T: float) -> list[Item]:
    """Return lines: share of each third of an octave in the information on each parameter."""
    expectation = design.expectation
    low, high = 0.5 * design.band[0], 2 * design.band[1]
    edges = low * 2 ** (np.arange(round(3 * np.log2(high / low)) + 1) / 3)
    centres = np.sqrt(edges[1:] * edges[:-1])
    items: list[Item] = []
    for row, parameter in zip(expectation.sensitivity, expectation.parameters, strict=True):
        power = np.abs(np.fft.rfft(row)) ** 2
        frequency = np.fft.rfftfreq(row.size, T)
        # Information from the noise variances belongs to no frequency.
        if len(items) == len(_LOOKS) or parameter.name.endswith(("_noise", "_growth")):
            continue
        share = np.histogram(frequency, edges, weights=power)[0] / np.sum(power)
        label = parameter.name.replace("_", " ")
        items.append(Line(centres, share, signal=_LOOKS[len(items)], label=label))
    return items
