"""Evaluation of a filter on a record, by innovations, predictions and known truth; its figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.base.escaping import label, markdown
from ambkit.data.record import Record
from ambkit.data.record_card import lost_spans
from ambkit.data.signals import by_name, signal, values_of
from ambkit.estimate.errors import LAGS, rms, rms_errors, true_signal, whiteness
from ambkit.estimate.estimate import Estimate, Status
from ambkit.estimate.estimate_panels import (
    contact_spans,
    innovation_panel,
    settled_samples,
    true_noise,
    with_limits,
)
from ambkit.estimate.estimator import Estimator
from ambkit.machine.machine import Machine
from ambkit.models.model import Descriptor
from ambkit.result.report import Axis, Figure, Item, Line, Panel
from ambkit.result.row import Row
from ambkit.result.signal_styles import CURRENT, DISTURBANCE, NOISE, POSITION, TIME, VELOCITY, looks


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of a filter along a record."""

    # Figures of a reading or an axis are numbers with a single axis, else mappings by name.

    estimate: Estimate  #: Estimate, all samples.
    #: Excluded initial time [s]; the first sample is always excluded.
    settling: float
    samples: int  #: Number of evaluated samples, and of those whose measurement was used.
    used: int
    innovation_mean: Any  #: Of the used measurements [m], by reading.
    innovation_std: Any
    #: Rms of the stated standard deviation of the innovations, ``sqrt(S)`` [m].
    expected_std: Any
    #: Mean normalised innovation squared; 1 if model and noise are right. Below 1 the filter
    #: overestimates its error, above 1 it underestimates it. NaN without S.
    nis: float
    #: Autocorrelation of the innovations, `LAGS` lags; None if fewer than four times as many
    #: measurements were used, or all innovations are equal. By reading.
    whiteness: Any
    #: Number of samples with each flag of :class:`ambkit.Status` that occurred.
    status: Mapping[str, int]
    #: RMS error of the filter's prediction of the readings [m], by steps ahead.
    prediction: Mapping[int, Any]
    #: The same if the last measurement is held [m].
    held: Mapping[int, Any]
    #: (mapping of int to float) The same for the rig's logged estimates [m], see
    #: `logged_predictions`.
    logged: Mapping[str, Mapping[int, float]]
    #: RMS errors against the truth, by state: ``x`` [m], ``v`` [m/s], ``f_d`` [N] of one axis;
    #: empty without truth.
    rmse: Mapping[str, float]
    disturbance_mean: Any  #: Mean of the estimated disturbance force [N], by axis.
    disturbance_std: Any

    def rows(self, machine: Machine, flags: Sequence[str]) -> list[Row]:
        """Return the figures; of several readings only the means, unless verbose."""
        several, units = len(machine.axes) > 1, self.estimate.units
        white = values_of(self.whiteness)
        share, bound = (
            by_name(self.estimate.readings or ("",), [w and getattr(w, name) for w in white])
            for name in ("share_within", "bound")
        )
        gap = max(placed.magnet.air_gap for placed in machine.bearings)
        ways = {
            "prediction": ("error {} ahead, rms", self.prediction),
            "held": ("  last measurement held, {}", self.held),
        } | {f"logged.{name}": (f"  {name}, {{}}", way) for name, way in self.logged.items()}
        return [
            Row("estimator", "filter", self.estimate.estimator, detail=True),
            Row("samples", "samples evaluated", self.samples),
            Row("used", "measurements used", self.used),
            *(Row(f"status.{flag}", f"  status: {flag}", self.status.get(flag)) for flag in flags),
            Row("settling", "settling time", self.settling, "s", detail=True),
            Row("innovation_mean", "innovation, mean", self.innovation_mean, "m", detail=several),
            Row("innovation_std", "innovation, std", self.innovation_std, "m"),
            Row("expected_std", "  expected by the filter", self.expected_std, "m",
                detail=several),
            Row("nis", "  mean NIS (1: consistent)", self.nis),
            Row("white_share", "  lags within 95 % bound", share, "%", detail=several),
            Row("white_bound", "  bound", bound, detail=True),
            *(Row(f"{key}.{ahead}", name.format(f"{ahead} step{'s' * (ahead > 1)}"), error, "m",
                  note="beyond the air gap" if max(values_of(error)) > gap else "",
                  detail=several and key != "prediction")
              for key, (name, way) in ways.items() for ahead, error in way.items()),
            Row("disturbance_mean", "disturbance force, mean", self.disturbance_mean, "N"),
            Row("disturbance_std", "disturbance force, std", self.disturbance_std, "N"),
            *(Row(f"rmse.{name}", f"error of {name}, rms", error, units[name])
              for name, error in self.rmse.items()),
        ]  # fmt: skip


def evaluate(
    kalman: Estimator, record: Record, *, horizons: Sequence[int] = (1, 10), settling: float = 0.0
) -> Evaluation:
    """Run a filter along a record and evaluate the fit."""
    _check(record, horizons, settling)
    judged_by_nees = record.has_truth and bool(kalman.machine.unbalance)
    estimate = kalman.run(record, covariance=judged_by_nees)
    names, axes = estimate.readings or ("",), estimate.axes or ("",)
    y = np.column_stack([record[signal("y", name)] for name in names])
    # The filter starts from the first measurement, whose innovation is therefore zero.
    first = max(1, round(settling / record.sampling_time))
    innovation = estimate.innovation.reshape(y.shape)[first:]
    variance = estimate.innovation_variance.reshape(y.shape)
    # The status is that of all readings together: if one of several is missing, S shows the rest.
    taken = estimate.used[:, None] | ((len(names) > 1) & (variance > 0))
    # A rejected measurement is neither a target of the prediction nor held.
    judged = np.where(taken, y, np.nan)
    used, used_mask, variance = estimate.used[first:], taken[first:], variance[first:]
    if not used_mask.any():
        raise RecordError(f"no measurement could be used: {_why(estimate, y, first)}")
    last = _last_measured(judged)
    of_readings = zip(innovation.T, variance.T, used_mask.T, strict=True)
    pairs = [(e[some], S[some]) for e, S, some in of_readings]
    forecasts = {
        ahead: np.reshape(kalman.forecast(estimate, record, ahead), y[ahead:].shape)
        for ahead in horizons
    }

    def by_reading(figures: Iterable[Any]) -> Any:
        return by_name(names, list(figures))

    def errors(predicted: Array, ahead: int) -> Any:
        wrong = (judged[ahead:] - predicted)[first:]
        return by_reading(rms(one) for one in wrong.T)

    loads = [estimate[signal("f_d", axis)][first:] for axis in axes]
    return Evaluation(
        estimate=estimate,
        settling=settling,
        samples=used.size,
        used=int(used.sum()),
        innovation_mean=by_reading(float(e.mean()) if e.size else math.nan for e, _ in pairs),
        innovation_std=by_reading(float(e.std()) if e.size else math.nan for e, _ in pairs),
        expected_std=by_reading(float(np.sqrt(S.mean())) if S.size else math.nan for _, S in pairs),
        nis=_mean_nis(innovation[used_mask], variance[used_mask]),
        whiteness=by_reading(
            whiteness(e) if e.size >= 4 * LAGS and np.ptp(e) > 0 else None for e, _ in pairs
        ),
        status=_flags(estimate.status[first:]),
        prediction={ahead: errors(predicted, ahead) for ahead, predicted in forecasts.items()},
        held={ahead: errors(last[:-ahead], ahead) for ahead in horizons},
        logged=logged_predictions(record, horizons, first=first),
        rmse=rms_errors(estimate, record, first),
        disturbance_mean=by_name(axes, [float(load.mean()) for load in loads]),
        disturbance_std=by_name(axes, [float(load.std()) for load in loads]),
    )


def _why(estimate: Estimate, y: Array, first: int) -> str:
    """Return why no measurement was used."""
    flags, count = _flags(estimate.status[first:]), len(y) - first
    there = int(np.isfinite(y[first:]).any(axis=1).sum())
    if flags.get("missing", 0) > count - there:  # the core has one flag for both
        absent = count - there
        flags["far beyond the travel"] = flags.pop("missing") - absent
        flags |= {"missing": absent} if absent else {}
    return f"of {count} samples " + ", ".join(f"{n} {flag}" for flag, n in flags.items())


def logged_predictions(
    record: Record, horizons: Sequence[int] = (1, 10), *, first: int = 0
) -> dict[str, dict[int, float]]:
    """Return the prediction errors of a rig's logged estimates."""
    # The rig's filter defines no prediction. Two are evaluated: its position held, and, if the
    # velocity was logged, extrapolated with it.
    if "x_logged" not in record:
        return {}
    x, T = record["x_logged"], record.sampling_time
    ways = {"x_logged held": np.zeros_like(x)}
    if "v_logged" in record:
        ways["x_logged and v_logged"] = record["v_logged"]
    return {
        name: {
            ahead: rms((record["y"][ahead:] - (x + ahead * T * slope)[:-ahead])[first:])
            for ahead in horizons
        }
        for name, slope in ways.items()
    }


def _check(record: Record, horizons: Sequence[int], settling: float) -> None:
    wrong = [ahead for ahead in horizons if ahead < 1]
    if wrong:
        raise ValueError(f"a horizon must be 1 sample or more, is {wrong[0]}")
    if not (np.isfinite(settling) and settling >= 0):
        raise ValueError(f"settling must be 0 s or more, is {settling:g} s")
    needed = max(1, round(settling / record.sampling_time)) + max(horizons, default=0) + 1
    if len(record) < needed:
        raise RecordError(
            f"the record has {len(record)} samples, {needed} are needed to predict "
            f"{max(horizons, default=0)} samples ahead after {settling:g} s of settling"
        )


def _last_measured(y: Array) -> Array:
    """Return y (n, readings) with missing samples replaced by the last measured one."""
    at = np.where(np.isnan(y), 0, np.arange(len(y))[:, None])
    return np.take_along_axis(y, np.maximum.accumulate(at, axis=0), axis=0)


def _mean_nis(innovation: Array, variance: Array) -> float:
    known = variance > 0  # a low-pass has no S
    return float(np.mean(innovation[known] ** 2 / variance[known])) if known.any() else math.nan


def _flags(status: NDArray[np.uint16]) -> dict[str, int]:
    """Count the samples with each flag, by lower-case name."""
    counts = {
        str(flag.name).lower(): int(np.count_nonzero(status & np.uint16(flag))) for flag in Status
    }
    return {name: count for name, count in counts.items() if count}


_SMOOTHED = ("smoothed", "smoothed 2", "smoothed 3")


CAPTION = (
    "Bounds: two standard deviations of the innovation as the filter expects it. Innovations at "
    "the start and after long gaps may exceed the axes."
)
LOGGED = {
    "x": ((("y", "measured"), ("r", "reference")), (("x_logged", "logged"),)),
    "v": ((("v_logged", "logged"),), ()),
}
"""Signals of a record plotted below and above the estimates of a state, with their styles."""


def filter_figure(
    record: Record,
    evaluated: Mapping[str, Evaluation],
    smoothed: Mapping[str, Estimate] | None = None,
) -> Figure:
    """Plot estimates along a record, and their innovations."""
    t = record.t
    time = replace(TIME, limits=(float(t[0]), float(t[-1])))
    smoothed = smoothed or {}

    def true(state: str) -> list[Item]:
        truth = true_signal(record, state)
        return [] if truth is None else [Line(t, truth, signal="truth")]

    def estimated(signal: str) -> list[Item]:
        return lines(lambda estimate: estimate[signal] if signal in estimate.names else None)

    def lines(read: Callable[[Estimate], Array | None]) -> list[Item]:
        after = ((style, f"{label(n)}, smoothed") for style, n in zip(cycle(_SMOOTHED), smoothed))
        estimates = [*(item.estimate for item in evaluated.values()), *smoothed.values()]
        return [
            Line(t, values, signal=style, label=label)
            for (style, label), estimate in zip([*looks(evaluated), *after], estimates, strict=True)
            if (values := read(estimate)) is not None
        ]

    estimates = [item.estimate for item in evaluated.values()]
    readings = [record[signal("y", name)] for name in estimates[0].readings or ("",)]
    absent = lost_spans(np.any(np.isnan(readings), axis=0), t) + contact_spans(t, estimates)
    innovations = [
        innovation_panel(name, item.estimate, time, absent) for name, item in evaluated.items()
    ]
    settled = settled_samples(t, estimates)

    def logged(signals: Sequence[tuple[str, str]]) -> list[Item]:
        return [Line(t, record[name], signal=style) for name, style in signals if name in record]

    def panel(state: Descriptor) -> Panel:
        axis = of_state(state)
        below, above = LOGGED.get(state.name, ((), ()))
        items = [*logged(below), *true(state.name), *estimated(state.name), *logged(above)]
        if state.role != "position":
            axis = with_limits(axis, items, settled)
        return Panel(time, axis, [*items, *absent])

    late = {n: None for item in estimates for n in item.states_with_role("current")}
    currents = [
        Panel(
            time,
            CURRENT,
            [*true(f"iu{name.removeprefix('i')}"), *estimated(name), *absent],
            title=f"Current {label(name)}" if len(late) > 1 else "",
        )
        for name in late
    ]
    coloured = [] if any(estimates[0].readings) else lines(lambda entry: entry.sensor_noise)
    noises = [Panel(time, NOISE, [*true_noise(record), *coloured, *absent])] if coloured else []
    return Figure(
        id="filter",
        title=f"Estimates along {markdown(record.meta.get('source') or 'the record')}",
        caption=CAPTION,
        panels=[
            *(panel(state) for state in estimates[0].states if state.role in AXES),
            *currents, *noises, *innovations,
        ],
    )  # fmt: skip


AXES = {"position": POSITION, "velocity": VELOCITY, "disturbance force": DISTURBANCE}
"""Axes of the plotted states, by role."""


def of_state(state: Descriptor) -> Axis:
    """Return the plot axis of a state; with several axes it has a name, and a tilt is in mrad."""
    axis = AXES[state.role]
    if state.name not in ("x", "v", "f_d"):
        axis = replace(axis, label=f"{axis.label} {state.name}")
    return replace(axis, unit=axis.unit.replace("mm", "mrad")) if "rad" in state.unit else axis
