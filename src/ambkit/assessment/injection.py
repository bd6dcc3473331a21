"""An experiment that measures a loop's sensitivity, as it was designed: signal, limits, record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.identification.excitation import Limits
from ambkit.identification.excitation.signals import Excitation
from ambkit.judge.loop.measured_sensitivity import MeasuredSensitivity
from ambkit.result.report import Axis, Band, Figure, Item, Line, Panel, Points, Rule
from ambkit.result.result import Result
from ambkit.result.row import Row
from ambkit.result.sections import Section
from ambkit.result.signal_styles import CURRENT, POSITION, TIME

PERIODS = 10
"""Of the signal: the first is left out, as the loop settles in it."""


@dataclass(frozen=True, eq=False, repr=False)
class Injection(Result):
    """An experiment for the sensitivity, and what it would tell."""

    name: str  #: Of the bearing, or of the machine and its axis.
    axis: str  #: Of a machine, at whose summing point the signal is added; else empty.
    excitation: Excitation  #: One period, of amplitude 1.
    added: Array  #: (n,) What is to be added to the measurement [m].
    band: tuple[float, float]  #: Lowest and highest frequency [Hz].
    #: The experiment, simulated with noise: ``y``, ``injected``, ``iu`` and ``x`` of the axis.
    record: Record
    limits: Limits  #: What it keeps within.
    expected: MeasuredSensitivity  #: What that record tells.

    @property
    def amplitude(self) -> float:
        """Greatest value of the signal [m]."""
        return float(np.abs(self.added).max())

    @property
    def period(self) -> float:
        """How long a period is [s]."""
        return len(self.excitation.values) * self.expected.sampling_time

    @property
    def periods(self) -> int:
        """How often it comes."""
        return PERIODS

    @property
    def error(self) -> Array:
        """Half width (k,) of the expected 95 % interval of abs(S), of its value [1]."""
        low, high = self.expected.interval()
        return np.asarray((high - low) / 2 / np.abs(self.expected.sensitivity))

    def file(self) -> Record:
        """Return the signal as a record, to be saved and run: ``t`` and ``injected``."""
        # Of a machine ``injected_NAME`` of its axis.
        low, high = self.band
        source = f"ambkit excite sensitivity, {low:.4g} to {high:.4g} Hz, for {self.name}"
        name = signal("injected", self.axis) if self.axis else "injected"
        return Record(self.record.t, {name: self.added}, {name: "m"}, meta={"source": source})

    TITLE = "Experiment for the sensitivity of {0.name}"

    @property
    def finding(self) -> str:
        """What it would tell."""
        low, high = self.expected.peak_interval()
        return (
            f"{self.name}: with {engineering(self.amplitude, 'm', 4)} added to the measurement the "
            f"expected interval of the peak of |S| is {low:.3f} to {high:.3f}."
        )

    @property
    def rows(self) -> list[Row]:
        """Signal, limits and what is expected."""
        record, limits, expected = self.record, self.limits, self.expected
        current, far = (float(np.abs(record[name]).max()) for name in ("iu", "x"))
        return [
            Row("duration", "duration", float(record.t[-1]), "s"),
            Row("samples", "  samples", len(record)),
            Row("period", "period", self.period, "s"),
            Row("periods", "  repetitions", self.periods),
            Row("lines", "frequencies", len(self.excitation.frequencies)),
            Row("band", "  of them", self.band, "Hz", 3),
            Row("amplitude", "amplitude added to the measurement", self.amplitude, "m"),
            Row("crest_factor", "  crest factor", self.excitation.crest_factor, digits=3),
            Row("greatest_current", "greatest control current", current, "A",
                below=limits.current),
            Row("greatest_displacement", "greatest displacement", far, "m",
                below=limits.displacement),
            Row("expected_peak", "expected peak of |S|", expected.peak, "|S|",
                interval=expected.peak_interval()),
            Row("expected_error", "median half width of the 95 % interval",
                float(np.median(self.error)), "%"),
            Row("greatest_expected_error", "  maximum", float(np.max(self.error)), "%"),
        ]  # fmt: skip

    SECTIONS = {(): Section("Sensitivity of {0.name}: {0.excitation.kind}")}

    @property
    def series(self) -> dict[str, Any]:
        """Of what it is."""
        return {"bearing": self.name, "kind": self.excitation.kind}

    def figures(self) -> list[Figure]:
        """Return the experiment over time, and the error that is expected."""
        return [injection_figure(self.name, self.record, self.limits, self.expected)]


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
