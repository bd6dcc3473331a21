"""Criteria for an estimator in one run; NaN where one does not apply."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ambkit.base.arrays import Array, rms
from ambkit.data.files.tables import Table
from ambkit.data.record import Record
from ambkit.data.signals import signal
from ambkit.estimate.errors import LAGS, true_signal, whiteness
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.machine_model import View
from ambkit.judge.comparison.cases import Trial
from ambkit.judge.comparison.conditions import Load
from ambkit.machine.axes import models_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import evaluate_force, magnet_of

SETTLING = 2.0
"""Initial time excluded from the evaluation, in time constants of the plant."""


EVALUATED = {"x": "m", "v": "m/s", "f_d": "N"}
"""States whose errors are evaluated together, and their units."""


@dataclass(frozen=True)
class Criterion:
    """One column of the evaluation."""

    label: str  #: Short label.
    unit: str  #: Displayed unit.
    factor: float  #: Factor from SI to `unit`.
    best: float  #: Ideal value.
    #: Measure of the distance from the ideal: as a multiple of the least, as a factor in both
    #: directions, as a difference.
    kind: Literal["error", "ratio", "share"]
    about: str  #: Definition, in a sentence.

    @property
    def si(self) -> str:
        """SI unit, as in a row."""
        return {"µm": "m", "mm/s": "m/s", "ms": "s", "mA": "A", "ns": "s", "": "1"}.get(
            self.unit, self.unit
        )


CRITERIA = {
    "x": Criterion("x", "µm", 1e6, 0, "error", "RMSE of the position."),
    "v": Criterion("v", "mm/s", 1e3, 0, "error", "RMSE of the velocity."),
    "f_d": Criterion("f_d", "N", 1, 0, "error", "RMSE of the disturbance force."),
    "force": Criterion("F_mag", "N", 1, 0, "error", "RMSE of the magnet force, as the filter's "
                       "force law gives it at its estimated position and the demanded current."),
    "nees": Criterion("NEES", "%", 100, 0.95, "share", "Share of the samples at which the "
                      "normalised estimation error squared of x, v and f_d of all axes is within "
                      "its 95 % chi-square bound, of one axis 7.81; less: overconfident."),
    "nis": Criterion("NIS", "", 1, 1, "ratio", "Normalised innovation squared; the same, of the "
                     "innovations."),
    "white": Criterion("white", "%", 100, 0.95, "share", "Share of 50 lags at which the "
                       "innovations' correlation is within its 95 % bound; white: 95 %."),
    "delay": Criterion("delay", "ms", 1e3, 0, "error", "Delay of the disturbance force: lag of "
                       "the greatest correlation with the truth."),
    "tracking": Criterion("r − x", "µm", 1e6, 0, "error", "RMS control error, with the estimator "
                          "in the loop."),
    "effort": Criterion("effort", "mA", 1e3, 0, "error", "RMS change of the demanded current from "
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
"""Criteria of the loop, and their names in :data:`ambkit.simulation.run_figures.FIGURES`."""


def evaluate_run(
    estimator: Any, trial: Trial, machine: Machine, settling: float
) -> dict[str, float]:
    """Run an estimator along a trial's record, and evaluate it over all axes."""
    record, view = trial.record, View(machine)
    first = max(1, round(settling / record.sampling_time))
    estimate = estimator.run(record, covariance=True)
    figures = dict.fromkeys(CRITERIA, np.nan)
    del figures["cost"]
    errors = {name: item[:, first:] for name, item in errors_along(estimate, record, view).items()}
    travel = np.array([[axis.clearance] for axis in view.isolated])
    lost = not np.isfinite(errors["x"]).all()
    lost = lost or bool((np.abs(errors["x"]) > 0.1 * travel).any())
    if not lost:
        figures |= {name: rms(error) for name, error in errors.items()}
        figures["force"] = rms(_force_errors(estimator, estimate, record, view)[:, first:])
        figures["nees"] = nees(estimate, record, first, view)
        figures |= _innovations(estimate, first)
        late = [
            delay(estimate[load][first:], trial.load(first, axis.name), record.sampling_time)
            for axis in view.machine.axes
            if (load := signal("f_d", axis.name)) in estimate.names
        ]
        known = [item for item in late if np.isfinite(item)]
        figures["delay"] = float(np.mean(known)) if known else np.nan
        if not estimator.estimates_force:
            figures |= dict.fromkeys(("f_d", "force", "delay"), np.nan)
    figures["lost"] = float(lost)
    return figures


def errors_along(estimate: Estimate, record: Record, view: View) -> dict[str, Array]:
    """Return the errors of x, v and f_d along the axes (p, n); NaN for what is not estimated."""
    unknown = np.zeros(len(record))
    results = {}
    for name, rows in zip(EVALUATED, view.rows_along(estimate.states), strict=True):
        known = np.any(rows != 0, axis=0)  # states that are NaN do not affect other rows
        wrong = np.zeros((len(rows), len(record)))
        for k in np.flatnonzero(known):
            truth = true_signal(record, estimate.names[k])
            wrong += rows[:, [k]] * (estimate.mean[:, k] - (unknown if truth is None else truth))
        results[name] = np.where(np.any(rows != 0, axis=1, keepdims=True), wrong, np.nan)
    return results


def _force_errors(estimator: Any, estimate: Estimate, record: Record, view: View) -> Array:
    """Errors of an estimator's magnet forces (p, n) [N]; NaN without a force law."""
    magnet = getattr(estimator, "magnet", None)
    result = np.full((len(view.isolated), len(record)), np.nan)
    if magnet is None:
        return result
    x = view.along_axes(estimate.states)[0] @ estimate.mean.T
    for k, (axis, model) in enumerate(zip(view.isolated, models_of(magnet), strict=True)):
        current = _current(view, k, estimate, record)
        force = evaluate_force(model, current, x[k]) + magnet_of(axis).bias_force
        force = force if estimate.scale is None else estimate.scale * force
        result[k] = force - record[signal("f_mag", view.machine.axes[k].name)]
    return result


def _current(view: View, axis: int, estimate: Estimate, record: Record) -> Array:
    """Control current of an axis just after each sample, according to the estimator [A]."""
    # A state if the amplifier has a lag; with dead time the oldest that still acts; else the
    # commanded one.
    for role in ("current", "past control"):
        late = [at for at, state in enumerate(estimate.states)
                if state.role == role and view.axis_of(state) == axis]  # fmt: skip
        if late:
            return np.asarray(estimate.mean[:, late[-1]])
    of = view.isolated[axis]
    current_command = of.amplifier.gain * record[signal("u", view.machine.axes[axis].name)]
    return np.asarray(np.clip(current_command, of.current_min, of.current_max))


def normalised_errors(estimate: Estimate, record: Record, view: View) -> Array:
    """NEES sample by sample, (n,): e' P^-1 e of x, v, f_d of all axes; NaN without covariances."""
    # The lagged position is excluded: the others determine it to a few parts in a million, and a
    # NEES with it would depend on the last digits of the discretisation.
    if estimate.covariance is None:
        return np.full(len(record), np.nan)
    W = np.concatenate(view.rows_along(estimate.states))
    n = W.shape[1]
    rows, columns = np.triu_indices(n)
    upper = np.asarray(estimate.covariance, dtype=float)
    P = np.zeros((len(upper), n, n))
    P[:, rows, columns] = P[:, columns, rows] = upper
    error = np.concatenate(list(errors_along(estimate, record, view).values())).T
    with np.errstate(invalid="ignore", divide="ignore"):
        # Normalised by standard deviations, so that the inverted matrix is a correlation matrix.
        of = W @ P @ W.T
        std = np.sqrt(np.einsum("nii->ni", of))
        of, error = of / (std[:, :, None] * std[:, None, :]), error / std
        good = np.isfinite(of).all(axis=(1, 2)) & np.isfinite(error).all(axis=1)
        good[good] = np.linalg.det(of[good]) > 0
    result = np.full(len(record), np.nan)
    solved = np.linalg.solve(of[good], error[good][:, :, None])[:, :, 0]
    result[good] = np.einsum("ni,ni->n", error[good], solved)
    return result


def nees(estimate: Estimate, record: Record, first: int, view: View) -> float:
    """Share of samples from `first` on whose NEES is within its bound; NaN without covariances."""
    from scipy.stats import chi2

    result = normalised_errors(estimate, record, view)[first:]
    bound = float(chi2.ppf(0.95, len(EVALUATED) * len(view.isolated)))
    return float(np.mean(result <= bound)) if np.isfinite(result).all() else np.nan


def _innovations(estimate: Estimate, first: int) -> dict[str, float]:
    used_mask = estimate.used[first:]
    nis = estimate.nis[first:][used_mask]
    innovation = estimate.innovation.reshape(len(estimate.t), -1)[first:][used_mask]
    known = np.isfinite(innovation).all() and len(innovation) >= 4 * LAGS
    if not known or not (np.ptp(innovation, axis=0) > 0).all():
        return {}
    white = [whiteness(item).share_within for item in innovation.T]
    return {"nis": float(np.mean(nis)), "white": float(np.mean(white))}


def delay(estimated: Array, load: Load, T: float) -> float:
    """Delay of a signal [s]: the lag of the greatest correlation with the truth."""
    # Interpolated by a parabola through three samples. NaN if the truth or the estimate is
    # constant. estimated (n,)
    from scipy.fft import irfft, rfft

    n, furthest = estimated.size, load.furthest
    if n < 16 or not np.isfinite(estimated).all():
        return float("nan")
    # The window of the estimate is the same for all lags: with a shrinking window the greatest
    # correlation of a step would be at zero lag.
    e = estimated[furthest:] - estimated[furthest:].mean()
    if not (np.ptp(e) > 0 and load.moves):
        return float("nan")
    size = load.transform_size
    product = irfft(load.transform * rfft(e, size).conj(), size)[furthest::-1]  # lags 0, 1, ...
    result = np.where(load.still, -1.0, product / load.spread)
    at = int(np.argmax(result))
    if not 0 < at < furthest:
        return float(at * T)
    before, peak, after = result[at - 1 : at + 2]
    bend = before - 2 * peak + after
    between = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float((at + np.clip(between, -0.5, 0.5)) * T)


def per_run(benches: Mapping[str, Any]) -> Table:
    """Return a row for each case and run, columns by filter and criterion."""
    # Each case is an `ambkit.judge.comparison.score.Comparison`.
    columns: dict[str, list[Any]] = {"case": [], "run": []}
    units = {"case": "1", "run": "1"}
    for place, bench in enumerate(benches.values()):
        count = bench.runs - bench.stopped
        columns["case"].append(np.full(count, float(place)))
        columns["run"].append(np.arange(count, dtype=float))
        for how, scores in (("default", bench.default), ("tuned", bench.tuned)):
            for name, score in scores.items():
                for criterion, values in score.figures.items():
                    key = f"{name}_{how}_{criterion}"
                    columns.setdefault(key, []).append(values)
                    units[key] = CRITERIA[criterion].si
    first = next(iter(benches.values()))
    meta = {"machine": first.machine.name, "cases": list(benches), "seed": first.seed}
    return Table({key: np.concatenate(parts) for key, parts in columns.items()}, units, meta)
