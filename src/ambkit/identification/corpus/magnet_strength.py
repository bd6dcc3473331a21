"""Strength of a magnet during levitation, relative to its description, and over the amplitude.

If the law comes from lift-off, the static force is known: what levitation then gives with the same
gap differs by the behaviour of the iron for an alternating current. Minor hysteresis loops are
flatter than the initial curve, most so where they are small. No agreement is enforced.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.data.record import Record
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.machine.magnets import own_time

FEWEST = 3  #: Minimum number of parts for a slope over the amplitude.

LOOSE = 10.0
"""Factor on the prior error of the current's offset: the held gap determines it."""


@dataclass(frozen=True)
class StrengthFit:
    """Strength of a magnet in one part of a log."""

    amplitude: float  #: Rms control current over the time constant of the rotor [A].
    #: Described magnet constant over the identified one, with the described gap.
    factor: float
    error: float  #: Standard error of its logarithm.


@dataclass(frozen=True)
class StrengthLoss:
    """Strength of a magnet in several parts."""

    flights: Mapping[str, StrengthFit]  #: By the names of the logs.
    #: Mean, and the standard error of its logarithm including the scatter between parts.
    factor: float
    factor_error: float
    #: Derivative of the factor's logarithm by that of the amplitude; NaN for fewer than three
    #: parts.
    slope: float
    slope_error: float

    @property
    def text(self) -> str:
        """Result, as a sentence."""
        sentence = (
            f"with the described air gap, the records in levitation give the described magnet "
            f"constant divided by {self.factor:.3g} ± {self.factor * self.factor_error:.2g}"
        )
        if math.isnan(self.slope):
            return sentence
        if abs(self.slope) < 2 * self.slope_error:
            return f"{sentence}, with no significant dependence on the current amplitude"
        ends = [
            end(self.flights.values(), key=lambda one: one.amplitude) for end in (min, max)
        ]  # fmt: skip
        way = "less" if self.slope < 0 else "more"
        seen = ", ".join(f"{one.factor:.3g} at {1e3 * one.amplitude:.2g} mA" for one in ends)
        return f"{sentence}; {way} at larger amplitudes: {seen}"


def _in_flight(
    records: Sequence[Record], result: MaximumLikelihood, start: LoopModel
) -> StrengthFit | None:
    """Identify a log with the described gap; None if it does not determine the magnet."""
    # A smoothed current is kept with its coil.
    described = start.isolated.magnet
    free = [p.name for p in result.parameters if p.name != "air_gap"]
    known = {
        at: (value, std * (LOOSE if at == "current_offset" else 1.0))
        for at, (value, std) in start.known.items()
    }
    begin, several = result.model.replace(magnet__air_gap=described.air_gap, known=known), records
    if result.current is not None:
        begin, several = result.current.driving(begin), result.current.records
    try:
        held = maximum_likelihood(
            list(several), begin, free, improve_start=False, profile=False, use_control=False
        )
        k, error = held["magnet_constant"], held.standard_error("magnet_constant")
    except AmbkitError:
        return None
    return StrengthFit(_amplitude(records, result.model), described.magnet_constant / k, error / k)


def strength_loss(
    records: Mapping[str, Sequence[Record]],
    results: Mapping[str, MaximumLikelihood],
    start: LoopModel,
    threads: int = 1,
) -> StrengthLoss | None:
    """Return the loss of strength of a one-sided magnet relative to its description."""
    if start.isolated.magnet.type != "one-sided":
        return None
    names = [
        name for name, one in results.items()
        if any(p.name == "magnet_constant" for p in one.parameters)
    ]  # fmt: skip
    with ThreadPoolExecutor(threads) as workers:
        parts = workers.map(lambda name: _in_flight(records[name], results[name], start), names)
        log_results = {name: one for name, one in zip(names, parts, strict=True) if one is not None}
    if not log_results:
        return None
    a, y, e = np.array([
        (math.log(one.amplitude), math.log(one.factor), one.error) for one in log_results.values()
    ]).T  # fmt: skip
    mean, mean_error = _line(np.ones((y.size, 1)), y, e)
    slope, slope_error = math.nan, math.nan
    if y.size >= FEWEST and np.ptp(a) > 0:
        line, errors = _line(np.column_stack([np.ones_like(a), a - a.mean()]), y, e)
        slope, slope_error = float(line[1]), float(errors[1])
    return StrengthLoss(
        log_results, math.exp(float(mean[0])), float(mean_error[0]), slope, slope_error
    )


def _line(A: np.ndarray, y: np.ndarray, e: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares; errors are increased to the residuals."""
    inverse = np.linalg.inv((A.T / e**2) @ A)
    solution = inverse @ ((A.T / e**2) @ y)
    left = float(np.sum(((y - A @ solution) / e) ** 2)) / max(y.size - A.shape[1], 1)
    return solution, np.sqrt(np.diag(inverse) * max(left, 1.0))


def _amplitude(records: Sequence[Record], model: LoopModel) -> float:
    """Rms control current between one and twenty time constants of the plant [A]."""
    from scipy.signal import savgol_filter

    own = own_time(model.isolated) / model.isolated.sampling_time
    short, long = (2 * max(1, round(part * own)) + 1 for part in (0.8, 10.0))
    squares = []
    for record in records:
        u = record["u"][np.isfinite(record["u"])]
        if u.size > long:
            band = savgol_filter(u, max(short, 5), 2) - savgol_filter(u, long, 2)
            squares.append(band**2)
    if not squares:
        return math.nan
    mean = math.sqrt(float(np.mean(np.concatenate(squares))))
    return abs(model.isolated.amplifier.gain) * mean
