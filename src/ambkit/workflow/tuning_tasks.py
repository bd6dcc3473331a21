"""Tuning criteria: the likelihood of records, and simulated truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any, Literal

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.data.reading.faults import without_spikes
from ambkit.data.record import Record
from ambkit.data.signals import values_of
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_saving import made_by, origin_of
from ambkit.estimate.kalman import KalmanFilter
from ambkit.judge.comparison.cases import CASES, Trial, loaded, trials
from ambkit.judge.comparison.comparison import raw_error
from ambkit.judge.comparison.tuning import SIGNALS, Candidate, Costed, Range, errors
from ambkit.judge.evaluation import evaluate
from ambkit.judge.load_following import FOLLOWING, least_process_noise
from ambkit.machine.axes import slowest_time
from ambkit.machine.machine import Machine
from ambkit.machine.rotors.descriptions import OfMatrices
from ambkit.machine.rotors.modes import above, max_frequency
from ambkit.workflow.tuning import (
    MUCH_LESS_LIKELY,
    TOO_LARGE,
    check_signals,
    in_units,
    log_likelihood,
)

By = Literal["likelihood", "truth"]

NOISE = ("noise.measurement", "noise.disturbance")
"""What a record tells of a filter's noise; that of the control signal is hardly in it."""

SETTLING = 5.0  #: Initial time excluded from a record, in time constants of the plant.

VALIDATION_SHARE = 0.5
"""Share of each record, its end, that is kept to judge by where there are no other records."""

HALVINGS = 8
"""Of the range above the likeliest process noise, in which the largest likely one is found."""

COMPARED = 3  #: Number of best filters of a search that are compared in all runs, with all modes.


JUDGED: Mapping[By, str] = {
    "likelihood": "negative log-likelihood per sample",
    "truth": "error over the untuned linear filter's",
}
"""What a tuned filter is judged by, on what it was not tuned on."""

RAW = "error of the raw sensors"  #: Figure of simulated runs beside the error of x [m].

AHEAD = {1: "error 1 step ahead [m]", 10: "error 10 steps ahead [m]"}
"""Figures of how well a record is predicted, by the number of samples."""


class LikelihoodObjective:
    """Tuning by the likelihood of records."""

    by: By = "likelihood"
    judge = JUDGED["likelihood"]
    likely: float | None = None  #: Process noise by likelihood, if it was raised above [N^2/s].

    def __init__(
        self, machine: Machine, records: Sequence[Record], validate: Sequence[Record]
    ) -> None:
        self.machine = machine
        for record in (*records, *validate):
            check_signals(machine, record)
        self.settling = SETTLING * slowest_time(machine)
        records, self.spikes = without_spikes(records)
        validate, _ = without_spikes(validate)
        spans = [float(record.t[-1] - record.t[0]) for record in records]
        shortest = 4 * self.settling
        if min(spans) < shortest:
            raise AmbkitError(
                f"a record to tune on must be {engineering(shortest, 's', digits=3)} long at "
                f"least, twenty time constants of the plant; one has "
                f"{engineering(min(spans), 's', digits=3)}"
            )
        self.seen, self.unseen = list(records), list(validate)
        if not validate:
            ends = [
                record.t[0] + VALIDATION_SHARE * span
                for record, span in zip(records, spans, strict=True)
            ]
            self.seen = [r.between(None, end) for r, end in zip(records, ends, strict=True)]
            self.unseen = [r.between(end, None) for r, end in zip(records, ends, strict=True)]

    def usual(self, candidate: Candidate) -> tuple[str, ...]:
        """Return the default tunables."""
        own = [item.name for item in candidate.tunable if not item.name.startswith("noise.")]
        return (*NOISE, *own)

    def best(
        self, evaluated: Sequence[Costed], free: Sequence[Range],
        cost: Callable[[Mapping[str, float]], float],
        build: Callable[[Mapping[str, float]], Estimator],
    ) -> Costed:  # fmt: skip
        """Return the largest process noise consistent with the records (Edwards 1972)."""
        # With a constant load the likelihood cannot bound Q from below, and a filter with a small Q
        # follows no later load: Q is raised to the value for the stated load.
        best = min(evaluated, key=lambda entry: entry.cost)
        noise_range = next((item for item in free if item.name == "noise.disturbance"), None)
        if noise_range is None:
            return best
        samples = sum(len(item) for item in self.seen)
        allowed = best.cost + MUCH_LESS_LIKELY / samples
        low, high = math.log(best.values[noise_range.name]), math.log(noise_range.high)
        accepted_trial = best
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            values = {**best.values, noise_range.name: math.exp(middle)}
            at = cost(values)
            if at < allowed:
                low, accepted_trial = middle, Costed(values, at)
            else:
                high = middle
        if cost({**best.values, noise_range.name: noise_range.low}) < allowed:  # constant load
            result = accepted_trial.values[noise_range.name]
            raised = least_process_noise(
                lambda q: build({**best.values, noise_range.name: q}), result
            )  # fmt: skip
            if raised > result:
                values = {**best.values, noise_range.name: raised}
                self.likely = result
                accepted_trial = Costed(values, cost(values))
        return accepted_trial

    def check(self, estimator: Estimator, kind: str) -> None:
        """Reject a kind that cannot be tuned this way."""
        variance = estimator.run(self.seen[0]).innovation_variance
        if not (np.isfinite(variance) & (variance > 0)).any():
            raise AmbkitError(
                f"the {kind} filter has no innovation variance, so records have no likelihood: "
                "tune it on simulated runs, without records"
            )

    def cost(self, build: Callable[[], Estimator], *, few: bool = False) -> float:
        """Return the cost of the filters that `build` makes."""
        return self._unlikely(build().run(record) for record in self.seen)

    def _unlikely(self, estimates: Iterable[Estimate]) -> float:
        total, samples = 0.0, 0
        for estimate in estimates:
            n = len(estimate.t)
            first = min(round(self.settling / self.machine.sampling_time), n // 2)
            total -= log_likelihood(estimate, first)
            samples += n - first
        return total / samples if math.isfinite(total) else math.inf

    def figures(self, build: Callable[[], Estimator]) -> dict[str, float]:
        """Return figures of such filters on validation data."""
        parts = [evaluate(build(), r, settling=self.settling) for r in self.unseen]

        def pooled(values: Iterable[Any]) -> float:
            return float(np.sqrt(np.mean([np.square(list(values_of(v))) for v in values])))

        results = {
            self.judge: self._unlikely(e.estimate for e in parts),
            "nis": float(np.mean([e.nis for e in parts])),
            AHEAD[1]: pooled(e.prediction[1] for e in parts),
            AHEAD[10]: pooled(e.prediction[10] for e in parts),
        }
        for name in parts[0].rmse:
            if all(name in e.rmse for e in parts):
                results[f"error of {name}"] = pooled(e.rmse[name] for e in parts)
        return results

    def origin(self, values: Iterable[str], source: str) -> dict[str, str]:
        """Return the origin of tuned values by their keys in a filter file."""
        data = f"likelihood of {source or f'{len(self.seen)} records'}"
        raised = {} if self.likely is None else {"noise.disturbance": made_by("tune", FOLLOWING)}
        return origin_of(values, made_by("tune", data)) | raised

    def warnings(
        self, _estimator: Estimator, kept: bool, after: Mapping[str, float]
    ) -> Iterable[str]:
        """Return warnings about the selected filter and its data."""
        if self.spikes:
            yield self.spikes
        if kept and self.likely is not None:
            yield (
                "noise.disturbance is larger than its value by likelihood, "
                f"{in_units(self.likely)}, too small to follow a disturbance force"
            )
        if not kept:
            yield "the tuned filter is no more likely on validation data: the untuned one is used"
        if kept and after["nis"] > TOO_LARGE**2:
            yield (
                f"the innovations are {math.sqrt(after['nis']):.1f} times what the filter expects, "
                "on validation data: is the record of this bearing?"
            )


class SimulationObjective:
    """Tuning by the errors against simulated truth."""

    by: By = "truth"
    judge = JUDGED["truth"]

    def __init__(self, machine: Machine, seeds: range) -> None:
        self.machine, self.runs = machine, len(seeds)
        self.first = round(SETTLING * slowest_time(machine) / machine.sampling_time)
        self.seen = self._trials(2 * seeds.start + 1)
        self.unseen = self._trials(2 * seeds.start + 2)
        if not (self.seen and self.unseen):
            raise AmbkitError(f"{machine.name}: the rotor met a stop in all simulated runs")
        self.untuned = self.errors(lambda: KalmanFilter(machine), self.seen)
        self.reference = self.untuned.mean(axis=0)
        # The search models the modes of the loop's range; the best filters are compared with all
        # modes.
        self.coarse, self.coarse_trials = _with_few_modes(machine), self.seen
        if self.coarse is not machine:
            made = loaded(self.coarse, self.runs, 2 * seeds.start + 1)
            self.coarse_trials = [item for item in made if not item.lost]
            if self.coarse_trials:
                self.untuned = self.errors(lambda: KalmanFilter(self.coarse), self.coarse_trials)
            else:
                self.coarse, self.coarse_trials = machine, self.seen

    def errors(self, build: Callable[[], Estimator], trials: Sequence[Trial]) -> Any:
        """Return the errors of x, v and f_d along the axes in each run (runs, 3)."""
        return errors(build, trials, self.first)

    def _trials(self, seed: int) -> list[Trial]:
        """Return simulated runs without contact."""
        case = CASES["paper"]
        single, runs = self.machine.single, self.runs
        made = (
            trials(case, self.machine, runs, seed) if single else loaded(self.machine, runs, seed)
        )
        return [item for item in made if not item.lost]

    def usual(self, candidate: Candidate) -> tuple[str, ...]:
        """Return the default tunables."""
        names = [item.name for item in candidate.tunable]
        # Gains depend on ratios of the variances only: one variance stays fixed.
        has_process_noise = {"noise.control", "noise.disturbance"} <= set(names)
        return tuple(
            name for name in names if not (has_process_noise and name == "noise.measurement")
        )

    def best(
        self, evaluated: Sequence[Costed], _free: Any, _cost: Any,
        build: Callable[[Mapping[str, float]], Estimator],
    ) -> Costed:  # fmt: skip
        """Return the best of several axes, in all runs and with all modes."""
        best = sorted(evaluated, key=lambda entry: entry.cost)
        if len(self.machine.axes) == 1:
            return best[0]
        return min(
            best[:COMPARED],
            key=lambda at: self._share(
                self.errors(lambda: build(at.values), self.seen), self.reference
            ),
        )

    def check(self, estimator: Estimator, kind: str) -> None:
        """Accept all kinds."""

    def cost(self, build: Callable[[], Estimator], *, few: bool = False) -> float:
        """Return the cost of the filters that `build` makes."""
        # Each run has a step along each axis: a few runs contain as many steps as those of one
        # axis.
        count = (
            math.ceil(len(self.coarse_trials) / len(self.machine.axes))
            if few
            else len(self.coarse_trials)
        )
        made = build()
        if self.coarse is not self.machine:
            made = made.for_machine(self.coarse)
        result = self.errors(lambda: made, self.coarse_trials[:count])
        return self._share(result, self.untuned[:count].mean(axis=0))

    def _share(self, result: Any, reference: Any) -> float:
        shares = result.mean(axis=0) / reference
        known = shares[~np.isnan(shares)]
        return float(known.mean()) if known.size else math.inf

    def figures(self, build: Callable[[], Estimator]) -> dict[str, float]:
        """Return figures of such filters on validation data."""
        result = self.errors(build, self.unseen)
        by_signal = dict(zip(SIGNALS, result.mean(axis=0).tolist(), strict=True))
        errors = {f"error of {name}": value for name, value in by_signal.items()}
        return {self.judge: self._share(result, self.reference)} | errors | {RAW: self.raw}

    @cached_property
    def raw(self) -> float:
        """Return the rms error of the sensors along the axes in the validation runs [m]."""
        return raw_error(self.machine, [trial.record for trial in self.unseen], self.first)

    def origin(self, values: Iterable[str], _source: str) -> dict[str, str]:
        """Return the origin of tuned values by their keys in a filter file."""
        data = f"errors in {len(self.seen)} simulated runs of {self.machine.name}"
        return origin_of(values, made_by("tune", data))

    def warnings(
        self, estimator: Estimator, kept: bool, after: Mapping[str, float]
    ) -> Iterable[str]:
        """Return warnings about the selected filter."""
        if not after["error of x"] < self.raw:
            yield (
                f"its position error is {engineering(after['error of x'], 'm', digits=3)}, that of "
                f"the raw sensor {engineering(self.raw, 'm', digits=3)}"
            )
        if not kept:
            yield "validation runs have no smaller errors: the untuned filter is used"


def _with_few_modes(machine: Machine) -> Machine:
    """Return a machine without bending modes beyond the range of ISO 14839-3."""
    rotor, bending = machine.rotor, machine.bending
    if not isinstance(rotor, OfMatrices) or bending is None:
        return machine
    f = rotor.every_mode.frequency / (2 * math.pi)
    within = f <= max_frequency(machine.sampling_time, machine.speed)
    count = max(1, int(np.count_nonzero(within)))
    if count >= len(bending.frequency) - bending.attached:
        return machine
    return machine.model_copy(
        update={"rotor": rotor.model_copy(update={"modes_up_to": above(f, count)})}
    )
