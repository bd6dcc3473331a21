"""Excitation signals of a frequency band: multisine, pseudo-random binary, stepped sine.

All have amplitude 1 and n samples, and start at zero, except the binary signal, which starts with a
jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array

Band = tuple[float, float]

STEPS = 12  #: Number of frequencies of a stepped sine.

CLOCK = 0.4
"""Upper frequency of a binary signal, times its clock period: its power has fallen to six tenths
there, and vanishes at 1.
"""

PER_DECADE = 40  #: Lines of a sparse multisine per decade: about 6 % apart.
ROUNDS = 100  #: Iterations of clipping in the optimisation of phases.


@dataclass(frozen=True, eq=False)
class Excitation:
    """A signal with amplitude 1, and its independently scalable parts."""

    kind: str  #: ``"multisine"``, ``"prbs"`` or ``"stepped-sine"``.
    values: Array  #: (n,) The signal.
    #: Parts, each with its own frequency; one part if all frequencies are simultaneous.
    parts: list[slice]
    frequencies: Array  #: Frequencies [Hz]: its lines, or the ends of a binary signal's band.

    @property
    def crest_factor(self) -> float:
        """Peak over root mean square: 1 for a binary signal, 1.41 for a sine, 3 or 4 for noise."""
        return float(np.max(np.abs(self.values)) / np.sqrt(np.mean(self.values**2)))


def multisine(n: int, T: float, band: Band) -> Excitation:
    """Return a sum of sines with low peak at all frequencies that the record resolves."""
    # Each octave has the same power. The record is one period, without leakage. The phases are
    # Schroeder's (1970), improved by clipping (van der Ouderaa, Schoukens and Renneboog 1988): the
    # peak is some 1.3 to 1.5 times the root mean square.
    first, last = (min(max(1, round(f * n * T)), (n - 1) // 2) for f in band)
    line = np.arange(first, last + 1)
    values = _low_peak(n, line, 1 / np.sqrt(line))
    # The start of a period is arbitrary: use the flattest zero crossing.
    after = np.roll(values, -1)
    passing = np.flatnonzero(np.sign(values) != np.sign(after))
    gentlest = passing[np.argmin(np.abs(values - after)[passing])]
    values = np.roll(values, -int(gentlest) - 1)
    return Excitation("multisine", values, [slice(0, n)], line / (n * T))


def sparse_multisine(
    n: int,
    T: float,
    band: Band,
    *,
    per_decade: int = PER_DECADE,
    without: Sequence[float] = (),
    weight: Callable[[Array], Array] | None = None,
) -> Excitation:
    """Return one period of a sum of few sines, evenly spread over the decades."""
    # Each line has much power. The phases are those of `multisine`.
    low, high = band
    count = max(2, round(per_decade * math.log10(high / low)) + 1)
    line = np.unique(np.round(np.geomspace(low, high, count) * n * T)).astype(int)
    line = line[(line >= 1) & (line <= (n - 1) // 2)]
    away = [bool(all(abs(k - f * n * T) > 1 for f in without)) for k in line]
    line = line[away]
    amplitude = np.ones(len(line)) if weight is None else weight(line / (n * T))
    return Excitation("multisine", _low_peak(n, line, amplitude), [slice(0, n)], line / (n * T))


def _low_peak(n: int, line: NDArray[np.int_], amplitude: Array) -> Array:
    """Return a sum of sines with amplitude 1 and phases for a low peak."""
    values = _sum_of_sines(n, line, amplitude, _phases(line, amplitude))
    return np.asarray(values / np.max(np.abs(values)))


def _sum_of_sines(n: int, line: NDArray[np.int_], amplitude: Array, phase: Array) -> Array:
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    spectrum[line] = amplitude * np.exp(1j * phase)
    return np.fft.irfft(spectrum, n)


def _phases(line: NDArray[np.int_], amplitude: Array) -> Array:
    """Return Schroeder's phases, improved by repeated clipping; the best of all."""
    # On a coarse grid with eight samples per shortest period.
    n = 2 ** math.ceil(math.log2(8 * line[-1]))
    power = amplitude**2 / np.sum(amplitude**2)
    phase = -2 * np.pi * np.concatenate([[0.0], np.cumsum(np.cumsum(power))[:-1]])
    best, least = phase, np.inf
    for level in np.linspace(0.5, 0.98, ROUNDS):
        values = _sum_of_sines(n, line, amplitude, phase)
        peak = np.max(np.abs(values))
        if peak < least:
            best, least = phase, peak
        clipped = np.clip(values, -level * peak, level * peak)
        phase = np.angle(np.fft.rfft(clipped)[line])
    return best


def prbs(n: int, T: float, band: Band) -> Excitation:
    """Return a maximum-length pseudo-random binary sequence, repeated over the record."""
    # Its clock period is 0.4 / high, a whole number of samples, and its period at least 1 / low,
    # which makes its lines dense enough for the band.
    from scipy.signal import max_len_seq

    low, high = band
    hold = max(1, round(CLOCK / (high * T)))
    bits = min(20, max(3, math.ceil(math.log2(1 / (low * hold * T) + 1))))
    sequence, _ = max_len_seq(bits)
    values = np.repeat(2.0 * sequence - 1.0, hold)
    values = np.resize(values, n)
    ends = np.array([1 / ((2**bits - 1) * hold * T), CLOCK / (hold * T)])
    return Excitation("prbs", values, [slice(0, n)], ends)


def stepped_sine(n: int, T: float, band: Band) -> Excitation:
    """Return sines in ascending sequence, each for the same time and whole periods."""
    low, high = band
    steps = max(1, min(STEPS, math.floor(low * n * T)))
    ends = np.linspace(0, n, steps + 1).round().astype(int)
    values, parts, frequencies = np.zeros(n), [], []
    for frequency, start, stop in zip(np.geomspace(low, high, steps), ends, ends[1:], strict=False):
        size = int(stop - start)
        periods = max(1, round(frequency * size * T))
        values[start:stop] = np.sin(2 * np.pi * periods * np.arange(size) / size)
        parts.append(slice(int(start), int(stop)))
        frequencies.append(periods / (size * T))
    return Excitation("stepped-sine", values, parts, np.array(frequencies))


KINDS = {"multisine": multisine, "prbs": prbs, "stepped-sine": stepped_sine}
"""The signals by name."""
