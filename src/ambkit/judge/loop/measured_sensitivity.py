"""Sensitivity from a record of a loop with an injected signal, with confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ambkit.base.arrays import Array, Complex, period_of
from ambkit.base.errors import RecordError
from ambkit.base.units import engineering
from ambkit.data.record import Record

Logged = Literal["after", "before"]

LEVEL = 0.95  #: Default confidence level.
SAME = 1e-5  #: Relative power in which periods may differ: logs are rounded.
#: Minimum number of periods; the first is excluded, because the loop settles in it.
LEAST_PERIODS = 3

LINE, BROAD = 1e-6, 1e-4
"""Minimum power at a frequency, over the maximum of the injected signal: of a period's lines, and
of a spectrum.
"""

ORDER, HALF = 2, 7
"""Order of the local polynomials, and number of neighbouring frequencies on both sides."""

APART = 1.0
"""Share of one line above which S is not separable from the transient; 0.4 is usual."""

PER_DECADE = 40  #: Density of the frequencies of a spectrum.

CERTAIN = 10.0
"""Ratio to the standard deviation above which a magnitude is nearly normal."""


@dataclass(frozen=True, eq=False)
class MeasuredSensitivity:
    """Measured sensitivity of one axis, with all other loops closed."""

    # Pintelon, Schoukens, System identification: a frequency domain approach, 2012.

    frequency: Array  #: (k,) Frequencies [Hz], ascending.
    sensitivity: Complex  #: (k,) S at the measurement, complex [1].
    #: Standard deviation of S: the root of the expected squared magnitude of its error [1].
    std: Array
    freedom: int  #: Degrees of freedom of this estimate.
    periods: int  #: Number of periods; 1 for an aperiodic signal.
    sampling_time: float  #: Sampling time of the record [s].

    def interval(self, level: float = LEVEL) -> tuple[Array, Array]:
        """Return the confidence interval (k,) of the magnitude of S at each frequency [1]."""
        # From Rice's distribution of a magnitude under noise: the true values for which the
        # measured one is not too unlikely, on either side. It is valid for small S too. As the
        # noise is estimated from the record, it is widened as by Student's t.
        ends = [
            _magnitudes(abs(S), std, self.freedom, level)
            for S, std in zip(self.sensitivity, self.std, strict=True)
        ]
        low, high = np.array(ends).T
        return low, high

    @property
    def peak(self) -> float:
        """Largest measured magnitude [1]."""
        return float(np.abs(self.sensitivity).max())

    @property
    def peak_frequency(self) -> float:
        """Its frequency [Hz]."""
        return float(self.frequency[int(np.abs(self.sensitivity).argmax())])

    def peak_interval(self, level: float = LEVEL, top: float = math.inf) -> tuple[float, float]:
        """Simultaneous confidence interval of the largest magnitude of S at all frequencies [1]."""
        # Each interval is widened so that all hold together (Bonferroni).
        within = self.frequency <= top
        low, high = self.interval(1 - (1 - level) / max(1, int(within.sum())))
        return float(low[within].max()), float(high[within].max())

    def open_loop(self) -> tuple[Complex, Array]:
        """Return the open loop L = 1/S - 1 (k,), and its standard deviation (k,) [1]."""
        S = self.sensitivity
        return np.asarray(1 / S - 1), np.asarray(self.std / np.abs(S) ** 2)

    @property
    def coherence(self) -> Array:
        """Share (k,) of the measurement's power explained by the injected signal [1]."""
        power = np.abs(self.sensitivity) ** 2
        # For one average: as if the record were a single segment of the signal.
        return np.asarray(power / (power + self.periods * self.std**2))


def measured_sensitivity(record: Record, logged: Logged = "after") -> MeasuredSensitivity:
    """Return S from a record of the closed loop with a signal added to its measurement."""
    # The injected signal is external and known, so the feedback causes no bias. If it is periodic
    # with a whole number of samples, S is the mean of the periods' spectra over that of the signal,
    # without leakage, and their scatter is its error; the first period is excluded. Otherwise, for
    # a chirp or noise, S and the transient are polynomials over a few neighbouring frequencies (the
    # local polynomial method), with the error from their residuals. Pintelon, Schoukens, System
    # identification: a frequency domain approach, 2012, chapters 2, 7.
    added, y = record["injected"], record["y"]
    for name, values in (("injected", added), ("y", y)):
        if not np.isfinite(values).all():
            at = int(np.argmin(np.isfinite(values)))
            raise RecordError(
                f"signal {name} has a gap at {engineering(float(record.t[at]), 's')}: cut the "
                "record to a stretch without gaps"
            )
    seen = y if logged == "after" else y + added
    active = np.flatnonzero(np.abs(added) > 1e-9 * np.abs(added).max(initial=0.0))
    if not len(active) or not np.abs(added).max() > 0:
        raise RecordError("signal injected is 0 throughout")
    first, end = int(active[0]), int(active[-1]) + 1
    T, period = record.sampling_time, period_of(added[first:end], SAME)
    count = 0 if period is None else (end - first) // period
    if period is not None and count >= LEAST_PERIODS:
        full_periods = slice(end - (count - 1) * period, end)
        shape = (count - 1, period)
        result = _of_periods(
            added[full_periods].reshape(shape), seen[full_periods].reshape(shape), T
        )
    else:
        # With the samples before and after it, as far as the record extends.
        result = _by_polynomials(added, seen, T)
    if len(result.frequency) < 2:
        raise RecordError(
            "the injected signal has power at too few frequencies for a sensitivity: a multisine, "
            "a chirp or a binary sequence has"
        )
    return result


def _of_periods(added: Array, seen: Array, T: float) -> MeasuredSensitivity:
    """Return S from periods (m, n) of injected and measured signal."""
    m, n = added.shape
    D = np.fft.rfft(added, axis=1).mean(axis=0)[1 : (n + 1) // 2]
    Y = np.fft.rfft(seen, axis=1)[:, 1 : (n + 1) // 2]
    power = np.abs(D) ** 2
    lines = power > LINE * power.max()
    mean = Y.mean(axis=0)
    variance = (np.abs(Y - mean) ** 2).sum(axis=0) / (m - 1) / m
    frequency = np.arange(1, len(D) + 1) / (n * T)
    return MeasuredSensitivity(
        frequency[lines], mean[lines] / D[lines], np.sqrt(variance[lines] / power[lines]),
        2 * (m - 1), m, T,
    )  # fmt: skip


def _by_polynomials(added: Array, seen: Array, T: float) -> MeasuredSensitivity:
    """Return S by local polynomials in the frequency, from an aperiodic record (n,)."""
    n = len(added)
    D, Y = (np.fft.rfft(item - item.mean())[1 : (n + 1) // 2] for item in (added, seen))
    width = 2 * HALF + 1
    if len(D) < 2 * width:
        raise RecordError(
            f"the record has {n} samples with the signal, too few for a spectrum; "
            f"{4 * width + 2} are needed"
        )
    total = np.concatenate([[0.0], np.cumsum(np.abs(D) ** 2)])
    power = (total[width:] - total[:-width]) / width
    middle = np.flatnonzero(power > BROAD * power.max()) + HALF
    # Limited to the resolution of a figure: neighbours are redundant.
    place = np.round(PER_DECADE * np.log10(middle + 1)).astype(int)
    middle = middle[np.unique(place, return_index=True)[1]]
    r = np.arange(-HALF, HALF + 1)
    powers = (r / HALF)[:, None] ** np.arange(ORDER + 1)
    freedom = width - 2 * (ORDER + 1)
    S, std, apart = np.zeros(len(middle), complex), np.zeros(len(middle)), []
    for k, at in enumerate(middle):
        # S and the transient, each a polynomial about this frequency.
        local = D[at + r]
        size = math.sqrt(float(np.mean(np.abs(local) ** 2)))
        K = np.hstack([local[:, None] * powers / size, powers])
        Q, R = np.linalg.qr(K)
        projected = Q.conj().T @ Y[at + r]
        S[k] = np.linalg.solve(R, projected)[0] / size
        left = float(np.sum(np.abs(Y[at + r] - Q @ projected) ** 2)) / freedom
        leverage = float(np.linalg.norm(np.linalg.inv(R)[0]))
        std[k] = math.sqrt(left) * leverage / size
        apart.append(leverage < APART)
    f = (middle + 1) / (n * T)
    return MeasuredSensitivity(f[apart], S[apart], std[apart], 2 * freedom, 1, T)


def _magnitudes(result: float, std: float, freedom: int, level: float) -> tuple[float, float]:
    """Return the interval of a magnitude [1], from its estimate and standard deviation."""
    from scipy.special import chndtrinc
    from scipy.stats import norm, t

    tail = (1 - level) / 2
    # Of real and imaginary part each, widened for its own uncertainty.
    part = std / math.sqrt(2) * float(t.isf(tail, freedom) / norm.isf(tail))
    half_width = part * float(norm.isf(tail))
    if result >= CERTAIN * part:
        return result - half_width, result + half_width

    # The magnitudes for which the estimate is at the quantile of either tail; the function ends at
    # 1e-300 instead of 0.
    ends = chndtrinc((result / part) ** 2, 2, np.array([1 - tail, tail]))
    low, high = (part * np.sqrt(np.where(ends > 1e-100, ends, 0.0))).tolist()
    return low, high
