"""Results of estimators along a record."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ambkit.data.record import Record
from ambkit.data.signals import by_name, signal, values_of
from ambkit.estimate.errors import rms_errors
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.noise_model import FilterNoise
from ambkit.judge.evaluation import Evaluation, filter_figure
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.rotordynamics.harmonics import Harmonic

HORIZONS = (1, 10)  #: Prediction horizons in samples.
ESTIMATORS = ("estimators",)  #: Section of its rows.


@dataclass(frozen=True)
class Stretch:
    """The part of a record on which filters are tuned; the rest judges them."""

    start: float  #: Start and end, from the record's first sample [s].
    stop: float
    #: Whether it is the default: the tuning is then kept only if it fits the rest better.
    by_itself: bool


@dataclass(frozen=True)
class TunedNoise:
    """Tuned process noise, and how it was chosen."""

    tuned: FilterNoise  #: Intensities of maximum likelihood and of `default_disturbance`.
    untuned: FilterNoise
    why: str  #: Reason for the choice if the likelihood does not determine it; else empty.
    worse: bool  #: Whether the rest of the record is less likely with it than untuned.
    #: Whether the filter uses it although it is less likely, because the user requested tuning.
    kept: bool


@dataclass(frozen=True, eq=False)
class Filtered:
    """One estimator along a record."""

    name: str  #: Kind of filter.
    noise: FilterNoise  #: Its final noise parameters.
    evaluation: Evaluation  #: Evaluation of the estimate.
    tuning: TunedNoise | None = None  #: None if nothing was tuned.
    smoothed: Estimate | None = None  #: Smoothed estimate, if requested.
    #: How more than one per cent of the samples lie outside the expert's training range, by axis.
    outside: Mapping[str, str] = field(default_factory=dict)
    #: Unbalance and runout at the end of the record.
    turning: Sequence[Harmonic] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Filtering(Result):
    """Estimators along a record."""

    machine: Machine  #: Machine that they assume.
    record: Record  #: Filtered part of the record: levitation only.
    stretch: Stretch | None  #: Part used for tuning.
    settling: float  #: Initial time excluded from the evaluation [s].
    estimators: Mapping[str, Filtered]  #: Results by estimator.
    source: str = ""  #: Record file.
    #: Objections by estimator; empty if it was not judged.
    adequacy: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    remarks: Sequence[str] = ()  #: Warnings about mismatches of filter and record.

    def __getitem__(self, name: str) -> Filtered:
        """Return the result of one estimator."""
        return self.estimators[name]

    @property
    def evaluations(self) -> dict[str, Evaluation]:
        """The evaluations, by estimator."""
        return {name: estimator.evaluation for name, estimator in self.estimators.items()}

    @property
    def smoothed(self) -> dict[str, Estimate]:
        """The smoothed estimates, by estimator; empty unless requested."""
        return {n: e.smoothed for n, e in self.estimators.items() if e.smoothed is not None}

    def after(self, name: str) -> dict[str, Any]:
        """Figures of a smoothed estimate: disturbance force, and errors against the truth."""
        estimate, t = self.smoothed[name], self.record.t
        first = int(np.argmax(t - t[0] >= self.settling))
        axes = self.machine.axis_names
        loads = [estimate[signal("f_d", axis)][first:] for axis in axes]
        return {
            "rmse": rms_errors(estimate, self.record, first),
            "disturbance_mean": by_name(axes, [float(load.mean()) for load in loads]),
            "disturbance_std": by_name(axes, [float(load.std()) for load in loads]),
        }

    def process_noise(self, noise: FilterNoise) -> Any:
        """Assumed process noise intensity of f_d [N^2/s], of each axis if there are several."""
        axes, intensity = self.machine.axis_names, noise.disturbance
        return (
            dict(zip(axes, intensity, strict=True)) if isinstance(intensity, tuple) else intensity
        )

    @property
    def title(self) -> str:
        return f"{self.machine.name}, {len(self.record)} samples"

    @property
    def finding(self) -> str:
        ahead, gain = HORIZONS[-1], {}
        for name, e in self.evaluations.items():
            pairs = zip(values_of(e.prediction[ahead]), values_of(e.held[ahead]), strict=True)
            ratios = [error / held if held > 0 else math.inf for error, held in pairs]
            gain[name] = max(r if math.isfinite(r) else math.inf for r in ratios)
        best = min(gain, key=gain.__getitem__)
        if math.isinf(gain[best]):
            return f"{self.title}: too few samples to judge a prediction."
        nis = self[best].evaluation.nis
        return (
            f"{self.title}: {best} predicts {ahead} steps ahead with {gain[best]:.3g} times the "
            f"error of the last measurement held"
            f"{'' if math.isnan(nis) else f'; mean NIS {nis:.3f}'}."
        )

    @property
    def rows(self) -> list[Row]:
        flags = dict.fromkeys(flag for e in self.evaluations.values() for flag in e.status)
        result, harmonic_rows = [], []
        for name, estimator in self.estimators.items():
            result += put(self._of(estimator, list(flags)), section=ESTIMATORS, of=name)
            harmonic_rows += [
                row for of in estimator.turning for row in of.rows((*ESTIMATORS, name))
            ]
        return result + harmonic_rows

    def _of(self, item: Filtered, flags: Sequence[str]) -> list[Row]:
        """Return the figures of one estimator."""
        after: dict[str, Any] = {} if item.smoothed is None else self.after(item.name)
        units = item.evaluation.estimate.units
        return [
            *item.evaluation.rows(self.machine, flags),
            Row("disturbance_noise", "disturbance force, assumed noise",
                self.process_noise(item.noise), "N^2/s"),
            Row("smoothed.disturbance_mean", "disturbance force, mean, smoothed",
                after.get("disturbance_mean"), "N", detail=True),
            Row("smoothed.disturbance_std", "disturbance force, std, smoothed",
                after.get("disturbance_std"), "N"),
            *(Row(f"smoothed.rmse.{name}", f"error of {name}, rms, smoothed", error, units[name])
              for name, error in after.get("rmse", {}).items()),
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        harmonic_sections: dict[tuple[str, ...], Section] = {
            (*ESTIMATORS, name, "synchronous"): Section(f"{name}: synchronous states", across=True)
            for name in self.estimators
        }
        return {ESTIMATORS: Section(self.title), **harmonic_sections}

    @property
    def notes(self) -> Sequence[str]:
        return self.remarks

    def file(self) -> Record:
        return self.to_record()

    @property
    def series(self) -> dict[str, Any]:
        adequacy = {
            name: [item._asdict() for item in findings] for name, findings in self.adequacy.items()
        }
        return ({"record": self.source, "adequacy": adequacy} if self.source else {}) | {
            "machine": self.machine.name,
            "estimators": {
                name: {key: {} for key in ("rmse", "status", "logged")}
                | {"synchronous": {
                    h.name: {"covariance": h.covariance.tolist()} for h in estimator.turning
                }}
                for name, estimator in self.estimators.items()
            },
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        return [filter_figure(self.record, self.evaluations, self.smoothed)]

    def to_record(self) -> Record:
        """Return the estimates; with several estimators the signal names carry theirs."""
        records = {
            name: evaluation.estimate.to_record() for name, evaluation in self.evaluations.items()
        }
        records |= {f"{n}_smoothed": e.to_record() for n, e in self.smoothed.items()}
        if len(records) == 1:
            return next(iter(records.values()))
        signals = {f"{n}_{s}": r[s] for n, r in records.items() for s in r}
        units = {f"{n}_{s}": r.units[s] for n, r in records.items() for s in r}
        t = next(iter(records.values())).t
        return Record(t, signals, units, {"estimators": list(records)})
