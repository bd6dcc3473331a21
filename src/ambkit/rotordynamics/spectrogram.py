"""Spectrum of a rotor's motion over the speed, as in a run-up."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import QuantityLike, in_si
from ambkit.base.units import figure
from ambkit.data.record import Record
from ambkit.result.report import Axis, Figure, Heatmap, Item, Line, Panel
from ambkit.result.result import Result
from ambkit.result.row import At, Row
from ambkit.result.signal_styles import TIME


@dataclass(frozen=True, eq=False, repr=False)
class Waterfall(Result):
    """Amplitude spectra of successive segments of a run."""

    signal: str  #: Name of the signal.
    unit: str  #: Its unit.
    t: Array  #: (n,) Centre of each segment [s].
    speed: Array  #: (n,) Speed of rotation there [rad/s].
    frequency: Array  #: (m,) [Hz].
    amplitude: Array  #: (n, m) Of each line, in the signal's unit.

    TITLE = "Spectrum of {0.signal} over the run"

    @property
    def finding(self) -> str:
        high = self._highest
        where = 0.0 if high.at is None else high.at.value
        return f"{self.title}: maximum {high.text()} at {figure(where, 'Hz')}."

    @property
    def _highest(self) -> Row:
        at, line = np.unravel_index(int(np.argmax(self.amplitude)), self.amplitude.shape)
        return Row(
            "amplitude", "greatest amplitude", float(self.amplitude[at, line]), self.unit,
            at=At("frequency", float(self.frequency[line]), "Hz"),
        )  # fmt: skip

    @property
    def rows(self) -> list[Row]:
        return [self._highest]

    @property
    def series(self) -> dict[str, Any]:
        arrays = {name: getattr(self, name).tolist() for name in ("t", "speed", "frequency")}
        return {"signal": self.signal, **arrays, "amplitudes": self.amplitude.tolist()}

    def figures(self) -> list[Figure]:
        return [waterfall_figure(self)]


def waterfall(
    record: Record,
    signal: str | None = None,
    *,
    window: QuantityLike | None = None,
    highest: QuantityLike | None = None,
) -> Waterfall:
    """Return the spectra of a run's signal over time."""
    window, highest = in_si("window", window, "s"), in_si("highest", highest, "Hz")
    if signal is None:
        signal = next((name for name in record if name.startswith("s_")), "x")
    values, speed, t = record[signal], record["speed"], record.t
    window = min(0.1, float(t[-1] - t[0]) / 4) if window is None else window
    T = float(t[1] - t[0])
    n = round(window / T)
    if not 8 <= n <= len(t):
        raise ValueError(f"window must be {8 * T:g} s to {len(t) * T:g} s, got {window!r}")
    rotation_frequency = float(np.abs(speed).max()) / (2 * math.pi)
    highest = max(4 * rotation_frequency, 100.0) if highest is None else highest
    hann = np.hanning(n + 1)[:-1]
    starts = np.arange(0, len(t) - n + 1, max(1, n // 4))
    parts = np.lib.stride_tricks.sliding_window_view(values, n)[starts]
    parts = parts - parts.mean(axis=1, keepdims=True)
    frequency = np.asarray(np.fft.rfftfreq(n, T), np.float64)
    in_range = frequency <= highest
    spectra = 2 / hann.sum() * np.abs(np.fft.rfft(parts * hann, axis=1))
    middle = starts + n // 2
    unit = record.units.get(signal, "1")
    return Waterfall(
        signal, unit, t[middle], speed[middle], frequency[in_range], spectra[:, in_range]
    )


FREQUENCY = Axis("frequency", "Hz")
RANGE = 60.0  #: Dynamic range of the plot [dB].


def waterfall_figure(result: Waterfall) -> Figure:
    """Plot spectra over time, with once and twice the speed of rotation."""
    one, unit = (1e-6, "µm") if result.unit == "m" else (1.0, result.unit)
    decibels = 20 * np.log10(np.maximum(result.amplitude / one, 1e-30))
    most = 10 * math.ceil(float(decibels.max()) / 10)
    bar = Axis("amplitude", f"dB re 1 {unit}", limits=(most - RANGE, float(most)))
    levels = np.clip(decibels, most - RANGE, most).T
    items: list[Item] = [Heatmap(result.t, result.frequency, levels, bar, lines=1, zero=False)]
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
