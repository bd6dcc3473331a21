"""An experiment that measures a loop's sensitivity, as it was designed: signal, limits, record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.showing import Shown
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.identification.excitation import Limits
from ambkit.identification.excitation.signals import Excitation
from ambkit.judge.loop.measured import MeasuredSensitivity

if TYPE_CHECKING:
    from ambkit.result.report.figure import Figure

Array = NDArray[np.float64]

PERIODS = 10
"""Of the signal: the first is left out, as the loop settles in it."""


@dataclass(frozen=True, eq=False)
class Injection(Shown):
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
        source = f"ambkit excite --for sensitivity, {low:.4g} to {high:.4g} Hz, for {self.name}"
        name = signal("injected", self.axis) if self.axis else "injected"
        return Record(self.record.t, {name: self.added}, {name: "m"}, meta={"source": source})

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        expected, (low, high) = self.expected, self.expected.peak_interval()
        return {
            "bearing": self.name,
            "kind": self.excitation.kind,
            "band": list(self.band),
            "lines": len(self.excitation.frequencies),
            "period": self.period,
            "periods": self.periods,
            "amplitude": self.amplitude,
            "crest_factor": self.excitation.crest_factor,
            "samples": len(self.record),
            "limit_current": self.limits.current,
            "limit_displacement": self.limits.displacement,
            "greatest_current": float(np.abs(self.record["iu"]).max()),
            "greatest_displacement": float(np.abs(self.record["x"]).max()),
            "expected_peak": expected.peak,
            "expected_peak_low": low,
            "expected_peak_high": high,
            "expected_error": float(np.median(self.error)),
        }

    def figure(self) -> Figure:
        """Return the experiment over time, and the error that is expected, as a picture."""
        from ambkit.show.plots.injection import injection_figure

        return injection_figure(self.name, self.record, self.limits, self.expected)
