"""What an estimator is judged by, run by run; NaN where a criterion does not apply."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.estimate.estimate import packed
from ambkit.estimate.innovations import whiteness
from ambkit.machine.magnets import evaluate_force, magnet_of

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.estimate.estimate import Estimate
    from ambkit.judge.comparison.cases import Load, Trial
    from ambkit.machine.bearing import Bearing

Array = NDArray[np.float64]

SETTLING = 2.0
"""What counts begins after this time, in the plant's own: all have then left their start."""

LAGS = 50
"""Lags of the whiteness test."""

EVALUATED = ("x", "v", "f_d")
"""States whose errors are judged together."""


@dataclass(frozen=True)
class Criterion:
    """One column of the evaluation."""

    label: str  #: What it is, short.
    unit: str  #: As shown.
    factor: float  #: What SI is multiplied with to be in `unit`.
    best: float  #: What it should be.
    #: How distance from the best is judged: as a multiple of the least, as a factor either way, as
    #: a difference.
    kind: Literal["error", "ratio", "share"]
    about: str  #: How it is found, in a sentence.


CRITERIA = {
    "x": Criterion("x", "µm", 1e6, 0, "error", "RMSE of the position."),
    "v": Criterion("v", "mm/s", 1e3, 0, "error", "RMSE of the velocity."),
    "f_d": Criterion("F_St", "N", 1, 0, "error", "RMSE of the disturbance force."),
    "force": Criterion("F_mag", "N", 1, 0, "error", "RMSE of the magnet force, as the estimator's "
                       "own force law gives it at its estimated position and the current asked."),
    "nees": Criterion("NEES", "%", 100, 0.95, "share", "Share of the samples at which the "
                      "normalised estimation error squared of x, v and F_St is within its "
                      "95 % chi-square bound, 7.81; less: the filter is too sure."),
    "nis": Criterion("NIS", "", 1, 1, "ratio", "Normalised innovation squared; the same, of the "
                     "innovations."),
    "white": Criterion("white", "%", 100, 0.95, "share", "Share of 50 lags at which the "
                       "innovations' correlation is within its 95 % bound; white: 95 %."),
    "delay": Criterion("delay", "ms", 1e3, 0, "error", "How late the disturbance force is: lag of "
                       "the greatest correlation with the truth."),
    "tracking": Criterion("r − x", "µm", 1e6, 0, "error", "RMS control error, with the estimator "
                          "in the loop."),
    "effort": Criterion("effort", "mA", 1e3, 0, "error", "RMS change of the current asked for from "
                        "sample to sample, with the estimator in the loop."),
    "overshoot": Criterion("oversh.", "%", 100, 0, "error", "Overshoot of the last step before the "
                           "load, in the loop."),
    "settling": Criterion("settling", "ms", 1e3, 0, "error", "Time after that step until the rotor "
                          "stays within 5 % of it."),
    "lost": Criterion("lost", "%", 100, 0, "share", "Share of the runs in which the estimate "
                      "is not finite or is off by a tenth of the travel, or the rotor meets a stop "
                      "with the estimator in the loop."),
    "cost": Criterion("cost", "ns", 1e9, 0, "error", "Time a step takes, in one thread."),
}  # fmt: skip
"""All criteria by name."""


OF_THE_LOOP = {
    "tracking": "tracking_rms", "effort": "effort", "overshoot": "overshoot",
    "settling": "settling",
}  # fmt: skip
"""What is judged in the loop, and what :data:`ambkit.simulation.many.FIGURES` calls it."""


def evaluate_run(
    estimator: Any, trial: Trial, bearing: Bearing, settling: float
) -> dict[str, float]:
    """Run an estimator along a trial's record, and judge it."""
    record = trial.record
    first = max(1, round(settling / record.sampling_time))
    estimate = estimator.run(record, covariance=True)
    figures = dict.fromkeys(CRITERIA, np.nan)
    del figures["cost"]
    error = (estimate.x - record["x"])[first:]
    lost = not np.isfinite(error).all()
    lost = lost or bool(np.abs(error).max() > 0.1 * bearing.rotor.travel_limit)
    if not lost:
        figures |= {name: rms((estimate[name] - record[name])[first:]) for name in ("x", "v")}
        figures["f_d"] = rms((estimate.f_d - record["f_d"])[first:])
        figures["force"] = rms(
            (magnet_force(estimator, estimate, record) - record["f_mag"])[first:]
        )
        figures["nees"] = nees(estimate, record, first)
        figures |= _innovations(estimate, first)
        figures["delay"] = delay(estimate.f_d[first:], trial.load(first), record.sampling_time)
    figures["lost"] = float(lost)
    return figures


def rms(error: Array) -> float:
    """Root mean square; NaN where any is."""
    return float(np.sqrt(np.mean(error**2)))


def magnet_force(estimator: Any, estimate: Estimate, record: Record) -> Array:
    """Magnet force as an estimator sees it [N]; NaN where it knows no force law."""
    magnet = getattr(estimator, "magnet", None)
    if magnet is None:
        return np.full(len(record), np.nan)
    bearing = estimator.bearing
    force = evaluate_force(magnet, _current(bearing, estimate, record), estimate.x)
    force = force + magnet_of(bearing).bias_force
    return force if estimate.scale is None else estimate.scale * force


def _current(bearing: Bearing, estimate: Estimate, record: Record) -> Array:
    """Control current just after each sample as an estimator sees it [A]."""
    # A state where the amplifier lags; of a loop with a delay the oldest that still acts; else the
    # one asked for.
    for role in ("current", "past control"):
        late = [at for at, state in enumerate(estimate.states) if state.role == role]
        if late:
            return np.asarray(estimate.mean[:, late[-1]])
    asked = bearing.amplifier.gain * record["u"]
    return np.asarray(np.clip(asked, bearing.current_min, bearing.current_max))


def normalised_errors(estimate: Estimate, record: Record) -> Array:
    """NEES sample by sample, (n,): e' P^-1 e of x, v, f_d; NaN without covariances."""
    # The lagged position is left out: it follows from the others but for a few parts in a million,
    # and a NEES with it would judge the last digits of how the model was made discrete.
    if estimate.covariance is None:
        return np.full(len(record), np.nan)
    upper = np.asarray(estimate.covariance, dtype=float).T
    places = [estimate.names.index(name) for name in EVALUATED]

    def P(i: int, j: int) -> Array:
        low, high = sorted((places[i], places[j]))
        return np.asarray(upper[packed(low, high, len(estimate.states))])

    with np.errstate(invalid="ignore", divide="ignore"):
        std = [np.sqrt(P(i, i)) for i in range(3)]
        # In standard deviations, so that what is inverted is a correlation matrix; by its minors.
        a, b, c = (P(i, j) / (std[i] * std[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
        x, v, f = (
            (estimate[name] - record[name]) / each
            for name, each in zip(EVALUATED, std, strict=True)
        )
        determinant = 1 + 2 * a * b * c - a * a - b * b - c * c
        squares = (1 - c * c) * x * x + (1 - b * b) * v * v + (1 - a * a) * f * f
        mixed = (b * c - a) * x * v + (a * c - b) * x * f + (a * b - c) * v * f
        found = (squares + 2 * mixed) / determinant
    return np.asarray(np.where((determinant > 0) & np.isfinite(found), found, np.nan))


def nees(estimate: Estimate, record: Record, first: int) -> float:
    """Share of samples from `first` on whose NEES is within its bound; NaN without covariances."""
    found = normalised_errors(estimate, record)[first:]
    return float(np.mean(found <= _nees_bound())) if np.isfinite(found).all() else np.nan


@cache
def _nees_bound() -> float:
    from scipy.stats import chi2

    return float(chi2.ppf(0.95, 3))


def _innovations(estimate: Estimate, first: int) -> dict[str, float]:
    taken = estimate.used[first:]
    with np.errstate(invalid="ignore", divide="ignore"):
        nis = estimate.nis[first:][taken]
    innovation = estimate.innovation[first:][taken]
    known = np.isfinite(innovation).all() and innovation.size >= 4 * LAGS
    if not known or not np.ptp(innovation) > 0:
        return {}
    return {
        "nis": float(np.mean(nis)),
        "white": whiteness(innovation, LAGS).share_within,
    }


def delay(estimated: Array, load: Load, T: float) -> float:
    """How late a signal is [s]: the lag of the greatest correlation with the truth."""
    # Found between the samples by a parabola through the three around it. NaN where the truth never
    # moves, or the estimate does not.
    # estimated (n,)
    from scipy.fft import irfft, rfft

    n, furthest = estimated.size, load.furthest
    if n < 16 or not np.isfinite(estimated).all():
        return float("nan")
    # The same stretch of the estimate for all lags, against the truth so much earlier: with a
    # stretch that shrinks, the greatest correlation of a step would be at no lag at all.
    e = estimated[furthest:] - estimated[furthest:].mean()
    if not (np.ptp(e) > 0 and load.moves):
        return float("nan")
    size = load.transform_size
    product = irfft(load.transform * rfft(e, size).conj(), size)[furthest::-1]  # lags 0, 1, ...
    found = np.where(load.still, -1.0, product / load.spread)
    at = int(np.argmax(found))
    if not 0 < at < furthest:
        return float(at * T)
    before, peak, after = found[at - 1 : at + 2]
    bend = before - 2 * peak + after
    between = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float((at + np.clip(between, -0.5, 0.5)) * T)
