"""Measurement noise from a recording at rest."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from ambkit.base.arrays import Array, Bools
from ambkit.base.errors import RecordError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.machine.machine import Machine

FROZEN_RUN = 20  #: Equal consecutive samples that indicate a saturated or stuck sensor.

REST_RATIO = 1.0
"""Von Neumann's ratio below which a window contains motion: 2 for white noise, 0 for motion."""

LAGS = 10  #: Lags of the noise's correlation; a window has at least 20 samples.
OUTLIER = 6.0  #: Standard deviations beyond which a sample is an outlier.
FINE = 0.1  #: Quantisation step over the noise's standard deviation below which it is negligible.


@dataclass(frozen=True)
class Noise:
    """Noise of one signal at rest."""

    signal: str  #: Signal and its SI unit.
    unit: str
    variance: float  #: Variance of the noise and its standard error, in the squared unit.
    standard_error: float
    #: Median distance of neighbouring values, in the unit; None if values hardly repeat.
    quantisation_step: float | None
    samples: int  #: Number of samples for the variance.
    #: Numbers of unused samples: ``missing``; ``frozen``, repeated for long, as by a saturated
    #: sensor; ``in motion`` and ``outliers``, in a window with such; ``left over``, next to a
    #: missing or frozen one or at the end.
    dropped: Mapping[str, int]
    #: Autocorrelation of the noise, `LAGS` lags from 1 sample on, corrected for detrending.
    correlation: tuple[float, ...] = field(default=(), repr=False)

    @property
    def bound(self) -> float:
        """95 % bound of white noise's correlations."""
        return 1.96 / math.sqrt(self.samples)

    @property
    def white(self) -> bool:
        """Whether the noise is white: no lag beyond twice the bound (1 in 1000)."""
        return all(abs(rho) <= 2 * self.bound for rho in self.correlation)

    @property
    def colour(self) -> str:
        """Colour of the noise, in words."""
        if self.white:
            return "white"
        most = max(self.correlation, key=abs)
        lag = 1 + self.correlation.index(most)
        return f"coloured: {lag} sample{'s' * (lag > 1)} apart it correlates by {most:+.2f}"

    @property
    def standard_deviation(self) -> float:
        """Standard deviation of the noise, in the signal's unit."""
        return float(np.sqrt(self.variance))


def measurement_noise(record: Record, signal: str = "y", *, window: float = 0.5) -> Noise:
    """Return the variance of a signal's noise where the record is at rest."""
    # The record is divided into windows. Each is detrended, and the ratio of the mean squared
    # difference of neighbours to the variance distinguishes noise from motion (von Neumann, 1941).
    # Windows with an outlier relative to the median variance are excluded, because it would tilt
    # their trend. Noise slower than a few samples counts as motion.
    x, unit = record[signal], record.units[signal]
    missing = np.isnan(x)
    frozen = _in_long_runs(x) & ~missing
    length = max(20, round(window / record.sampling_time))
    full_length = x.size // length * length
    cut = x[:full_length].reshape(-1, length)
    good = ~(missing | frozen)[:full_length].reshape(cut.shape).any(axis=1)

    residuals = _straightened(cut[good])
    squares = (residuals**2).sum(axis=1)
    steps = (np.diff(residuals) ** 2).sum(axis=1)
    standstill = (steps >= REST_RATIO * squares) & (squares > 0)
    typical = np.median(squares[standstill]) / (length - 2) if standstill.any() else 0.0
    clean = standstill & (np.abs(residuals).max(axis=1) <= OUTLIER * np.sqrt(typical))
    samples = int(clean.sum()) * length
    dropped = {
        "missing": int(missing.sum()),
        "frozen": int(frozen.sum()),
        "in motion": int((~standstill).sum()) * length,
        "outliers": int((standstill & ~clean).sum()) * length,
    }
    if not samples:
        counts = ", ".join(f"{count} {what}" for what, count in dropped.items() if count)
        where = f" at {engineering(float(np.median(x[frozen])), unit)}" if frozen.any() else ""
        raise RecordError(
            f"{signal} is nowhere at rest for {length} samples, so that its noise could be seen: "
            f"of {x.size} samples {counts}{where}"
        )
    dropped["left over"] = x.size - samples - sum(dropped.values())
    variance = float(squares[clean].sum() / (samples - 2 * clean.sum()))
    return Noise(
        signal=signal,
        unit=unit,
        variance=variance,
        standard_error=variance * float(np.sqrt(2 / samples)),
        quantisation_step=quantisation_step(cut[good][clean]),
        samples=samples,
        dropped=dropped,
        correlation=_correlation(residuals[clean], variance),
    )


StandstillNoise = Mapping[str, Noise | str]
"""Noise of each signal of a record at rest, or the reason why it is unknown."""


def standstill_noise(record: Record) -> dict[str, Noise | str]:
    """Return the noise of each signal of a record at rest, or the reason why it is unknown."""
    results: dict[str, Noise | str] = {}
    for name in record:
        try:
            results[name] = measurement_noise(record, name)
        except RecordError as error:
            results[name] = str(error)
    return results


def _in_long_runs(x: Array) -> Bools:
    """Return which samples are in runs of at least `FROZEN_RUN` equal ones."""
    starts = np.flatnonzero(np.concatenate(([True], np.diff(x) != 0)))
    lengths = np.diff(np.append(starts, x.size))
    return np.asarray(np.repeat(lengths >= FROZEN_RUN, lengths))


def _straightened(windows: Array) -> Array:
    """Subtract the least-squares line from each row."""
    ramp = np.linspace(-1.0, 1.0, windows.shape[1])
    centred = windows - windows.mean(axis=1, keepdims=True)
    slopes = centred @ ramp / (ramp @ ramp)
    return np.asarray(centred - slopes[:, None] * ramp)


def _correlation(residuals: Array, variance: float) -> tuple[float, ...]:
    """Return the autocorrelation of detrended windows (m, L) at lags from 1 on, corrected."""
    # Detrending white noise leaves ``(I - H)``, so that neighbours correlate by ``-H``, which is
    # added again.
    windows, length = residuals.shape
    ramp = np.linspace(-1.0, 1.0, length)
    H = 1 / length + np.outer(ramp, ramp) / (ramp @ ramp)
    return tuple(
        float(
            (np.sum(residuals[:, lag:] * residuals[:, :-lag]) / windows / variance)
            + np.trace(H, offset=lag)
        )
        / (length - lag)
        for lag in range(1, LAGS + 1)
    )


def white_noise(values: Array) -> float:
    """Return the standard deviation of a signal's noise from its second differences."""
    # Those of white noise have six times its variance; the median is robust against motion.
    bend = np.diff(values, 2)
    bend = bend[np.isfinite(bend)]
    return float(np.median(np.abs(bend))) / (0.6745 * math.sqrt(6)) if bend.size >= 10 else math.nan


def quantisation_step(values: Array) -> float | None:
    """Return the median distance of neighbouring values; None if values hardly repeat."""
    levels = np.unique(values)
    if levels.size < 2 or levels.size > values.size / 2:
        return None
    return float(np.median(np.diff(levels)))


def position_step(records: Iterable[Record]) -> float | None:
    """Return the smallest quantisation step of ``y`` in records [m]; None if one has none."""
    steps = [quantisation_step(y[np.isfinite(y)]) for y in (record["y"] for record in records)]
    known = [step for step in steps if step is not None]
    return min(known) if len(known) == len(steps) else None


def with_steps(machine: Machine, step: float | None, *, has_noise: bool = True) -> Machine:
    """Return a machine with identified quantisation of its sensor."""
    total, stated = machine.sensor.noise_variance, machine.sensor.quantisation
    step = step if stated is None else stated
    if step is None or (stated is None and step**2 < FINE**2 * total):
        return machine
    left = max(total - step**2 / 12, 0.01 * step**2) if has_noise else total
    return machine.replace(sensor__quantisation=step, sensor__noise_variance=left)
