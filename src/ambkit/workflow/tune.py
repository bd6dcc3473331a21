"""Tuning of a filter on records or in simulation, with validation."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.quantity_arguments import all_of_type, of_type
from ambkit.base.threads import one_thread
from ambkit.control.control import as_control
from ambkit.control.linear.steady_state_filter import tells
from ambkit.control.pid import PID
from ambkit.data.input_scaling import Inputs
from ambkit.data.record import Record
from ambkit.estimate import DEFAULT
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import get_kind, learned_magnet
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.criteria import EVALUATED
from ambkit.judge.comparison.tuning import Candidate, Costed, Range, candidate_of_kind, search
from ambkit.judge.contact import stop_notes
from ambkit.judge.loop.loop_builder import InfeasibleError, LoopBuilder, zone_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.tuning_tasks import JUDGED, RAW, By, LikelihoodObjective, SimulationObjective

BUDGET = 60  #: Default number of evaluations.
RUNS = 8  #: Default number of simulated runs for tuning, and of as many for validation.
#: Ratio of the sensitivity peaks, tuned over untuned, above which there is a warning.
MUCH_WORSE = 1.25

BEYOND, FARTHEST = 100.0, 1e3
"""Cost of a peak beyond its ceiling by a factor of e, far above what else may change; and a ratio
to it from which on it costs no more."""

NEARLY = 1.05
"""Peak over the least one, up to which errors decide where no filter keeps its ceiling."""

AT_THE_END = 0.02
"""Share of the range, in its logarithm, within which a value has run into its end."""


VALUES, VALIDATION = ("values",), ("unseen",)  #: Sections of a tuning.


@dataclass(frozen=True, eq=False, repr=False)
class Tuned(Result):
    """A tuned filter, with its criterion and validation."""

    #: The filter to use: the tuned one, or the untuned if that fits the validation data better.
    estimator: Estimator
    kind: str  #: Kind of filter.
    #: Criterion: the likelihood of records, or the errors against simulated truth.
    by: By
    free: tuple[Range, ...]  #: Tunables and their ranges.
    #: All evaluations in order: values, and their cost. By likelihood the cost is minus the mean
    #: log likelihood of a sample; by truth, the mean error over that of the untuned linear filter.
    trace: tuple[Costed, ...]
    #: Tuned values by name, in SI. By likelihood the process noise is the largest consistent with
    #: the records: with a constant load the likelihood cannot bound it from below.
    values: Mapping[str, float]
    #: (float, float) Figures on validation data, untuned and tuned; smaller is better, except for
    #: ``nis``, which is 1 if model and noise are right.
    unseen: Mapping[str, tuple[float, float]]
    kept: bool  #: Whether `estimator` is the tuned one.
    #: Peak of abs(S) of all evaluations, if the search computed it because of `max_sensitivity`;
    #: else empty, and `peaks` computes it.
    known_peaks: tuple[float, ...]
    #: Magnet model of all evaluations, if it is not the kind's default.
    magnet: MagnetModel | None
    max_sensitivity: float | None  #: Limit of the peak of abs(S).
    controller: PID | None  #: Controller of that loop; None: the default of each axis.
    warnings: tuple[str, ...] = field(default=())  #: Warnings about the result.
    #: Files of machine and magnet, if there are any.
    files: Mapping[str, Any] = field(default_factory=dict)

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        self.estimator.save(path, **self.files)

    def named(self, **files: str | os.PathLike[str] | None) -> Tuned:
        """Return it with the names of the files of machine and magnet, for the filter file."""
        return replace(self, files=files)

    @cached_property
    def _loop(self) -> LoopBuilder:
        return LoopBuilder(self.estimator.machine, self.controller)

    @cached_property
    def peak(self) -> float:
        """Peak of abs(S) in the loop with `estimator` [1]; NaN if undetermined."""
        return self._loop.peak(self.estimator) if tells(self.estimator) else math.nan

    @cached_property
    def untuned_peak(self) -> float:
        """Peak of abs(S) in the loop with the untuned filter [1]; NaN if undetermined."""
        return self.known_peaks[0] if self.known_peaks else self._peak_with({})

    @cached_property
    def peaks(self) -> tuple[float, ...]:
        """Peak of abs(S) in the loop of each evaluation [1]."""
        # Infinite if unstable, NaN for a kind without steady-state gain. Without `max_sensitivity`
        # they are computed on first access.
        return self.known_peaks or tuple(self._peak_with(item.values) for item in self.trace)

    def _peak_with(self, values: Mapping[str, float]) -> float:
        """Return the peak with other values of the tunables."""
        machine = self.estimator.machine
        built = candidate_of_kind(self.kind, machine, self.magnet, all_noise=True).build(**values)
        return self._loop.peak(built) if tells(built) else math.nan

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether `estimator` is adequate, with NIS on validation data."""
        scenario = (
            None if self.controller is None else Scenario(controller=as_control(self.controller))
        )
        nis = self.unseen.get("nis", (math.nan, math.nan))[self.kept]
        return judge_adequacy(self.estimator, None, scenario, nis)

    @property
    def outcome(self) -> str:
        """Summary of the result, in a sentence."""
        return f"The {'tuned' if self.kept else 'untuned'} filter is used."

    TITLE = "Tuning of the {0.estimator.name} for {0.estimator.machine.name}"

    @property
    def finding(self) -> str:
        if math.isnan(self.peak):
            return f"{self.title}: {self.outcome}"
        below = "" if self.max_sensitivity is None else f" (limit {self.max_sensitivity:g})"
        return (
            f"{self.title}: {self.outcome} Peak of |S| in the loop: {self.peak:.3f}, zone "
            f"{zone_of(self.peak)}{below}; untuned {self.untuned_peak:.3f}."
        )

    @property
    def rows(self) -> list[Row]:
        results = [
            Row(item.name, item.name, value, item.unit, of=of, section=VALUES)
            for of, values in (("untuned", {}), ("tuned", self.values))
            for item in self.free
            for value in [float(values.get(item.name, item.default))]
        ]  # fmt: skip
        raw = {RAW.removeprefix("error of "): "m"}
        units = {state.name: state.unit for state in self.estimator.states} | EVALUATED | raw
        for name, pair in self.unseen.items():
            what, _, unit = name.removesuffix("]").partition(" [")
            what = "mean NIS" if what == "nis" else what
            unit = unit or units.get(name.removeprefix("error of "), "1")
            for of, figure in zip(("untuned", "tuned"), pair, strict=True):
                results.append(Row(name, what, figure, unit, of=of, section=VALIDATION))
        peaks = (("untuned", self.untuned_peak), ("taken", self.peak))
        return results + [
            Row("peak", "peak of |S|", None if math.isnan(peak) else peak, "|S|", of=of,
                section=("loop",), below=self.max_sensitivity if of == "taken" else None,
                detail=True)
            for of, peak in peaks
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        how = f"{len(self.trace)} evaluations, by {self.by}"
        return {
            VALUES: Section(f"{self.estimator.name} for {self.estimator.machine.name}: {how}"),
            VALIDATION: Section("On validation data"),
            ("loop",): Section("In the loop"),
        }

    @property
    def notes(self) -> tuple[str, ...]:
        return (*self.warnings, *sentences(self.adequacy))

    @property
    def series(self) -> dict[str, Any]:
        peaks = [self.known_peaks] if self.known_peaks else []
        return {
            "machine": self.estimator.machine.name,
            "kind": self.kind,
            "by": self.by,
            "kept": self.kept,
            "bounds": {r.name: {"low": r.low, "high": r.high, "default": r.default,
                                "unit": r.unit} for r in self.free},
            "trace": [{"cost": item.cost} | ({"peak": known[0]} if known else {})
                      | dict(item.values)
                      for item, *known in zip(self.trace, *peaks, strict=True)],
            "max_sensitivity": self.max_sensitivity,
        }  # fmt: skip

    def figures(self) -> list[Figure]:
        from ambkit.workflow.tuning_figure import tuning_figure

        title = f"Tuning of the {self.estimator.name} for {markdown(self.estimator.machine.name)}"
        return [tuning_figure(
            title, self.free, self.trace, self.values, JUDGED[self.by], self.outcome,
            self.peaks, self.max_sensitivity,
        )]  # fmt: skip


@one_thread()
def tune(
    machine: Machine,
    records: Record | Sequence[Record] = (),
    kind: str = DEFAULT,
    *,
    validate: Sequence[Record] = (),
    max_sensitivity: float | None = None,
    controller: PID | None = None,
    free: Iterable[str] | None = None,
    magnet: MagnetModel | None = None,
    inputs: Inputs | None = None,
    source: str = "",
    seeds: range = range(RUNS),
    budget: int = BUDGET,
    done: Callable[[], None] = lambda: None,
) -> Tuned:
    """Tune a filter by the likelihood of records, or without records by simulated truth."""
    of_type(Machine, machine=machine)
    get_kind(kind)
    logs = all_of_type(Record, records=records)
    validate = all_of_type(Record, validate=validate)
    magnet = learned_magnet(kind, machine) if magnet is None else magnet
    candidate = candidate_of_kind(kind, machine, magnet, all_noise=True)
    task = (
        LikelihoodObjective(machine, logs, validate)
        if logs
        else SimulationObjective(machine, seeds)
    )
    loop = LoopBuilder(machine, controller)
    trials = _Trials(candidate, task, loop, max_sensitivity)
    task.check(trials.build(), kind)
    chosen = _chosen(candidate, task.usual(candidate) if free is None else tuple(free))
    gives_estimate = tells(trials.build())
    if max_sensitivity is not None:
        loop.check(trials.build(), max_sensitivity)
    optimum = search(chosen, trials.cost, budget, seeds.start, done)
    evaluated = [Costed(p.values, c) for p, c in zip(optimum.points, trials.costs, strict=True)]
    peaks = tuple(trials.peaks)
    untuned = trials.untuned_peak(evaluated, kind) if gives_estimate else math.nan
    limit = math.inf if max_sensitivity is None else max_sensitivity
    if max_sensitivity is not None and min(peaks) >= max_sensitivity:
        limit = NEARLY * min(peaks)  # errors decide among those close to the minimum
    beyond = [peak >= limit for peak in peaks or (0.0,) * len(evaluated)]
    within = [item for item, far in zip(evaluated, beyond, strict=True) if not far]
    best = task.best(within, chosen, trials.cost, trials.build)
    before = task.figures(trials.build)
    after = task.figures(lambda: trials.build(best.values))
    use_tuned = (
        bool(best.values) and best is not evaluated[0]
        and (after[task.judge] < before[task.judge] or beyond[0])
    )  # fmt: skip
    estimator = trials.build(best.values if use_tuned else {})
    if inputs is not None:
        estimator.inputs = inputs
    if use_tuned:
        estimator.origin = task.origin(best.values, source)
    warnings = [*_at_an_end(chosen, best.values), *task.warnings(estimator, use_tuned, after)]
    warnings += stop_notes(machine, estimator.name)
    if use_tuned and gives_estimate:
        warnings += _in_the_loop(loop.peak(estimator), untuned, max_sensitivity)
    validation = {name: (before[name], after[name]) for name in before}
    own = loop.machine.single and controller is None
    tuned = Tuned(
        estimator, kind, task.by, chosen, tuple(evaluated), best.values, validation, use_tuned,
        peaks, magnet, max_sensitivity,
        loop.control.completed(loop.isolated[0]).fed_by("measurement") if own else controller,
        tuple(warnings),
    )  # fmt: skip
    if max_sensitivity is not None and limit > max_sensitivity:
        raise InfeasibleError(
            f"of {len(evaluated)} {kind} filters that were evaluated none keeps the peak of |S| "
            f"below {max_sensitivity:g}, the least is {min(peaks):.4g}: allow more, or take "
            "another controller",
            tuned,
        )
    return tuned


class _Trials:
    """The filter of each trial, its cost, and its peak of |S| if that has a limit."""

    def __init__(
        self,
        candidate: Candidate,
        task: LikelihoodObjective | SimulationObjective,
        loop: LoopBuilder,
        max_sensitivity: float | None,
    ) -> None:
        self.candidate, self.task, self.loop = candidate, task, loop
        self.max_sensitivity = max_sensitivity
        self.peaks: list[float] = []
        self.costs: list[float] = []

    def build(self, values: Mapping[str, float] = MappingProxyType({})) -> Estimator:
        """Return the filter with given values; by default the untuned one."""
        made: Estimator = self.candidate.build(**values)
        return made

    def cost(self, values: Mapping[str, float]) -> float:
        """Return the cost, which rises with the peak beyond its limit."""
        made = self.build(values)
        over = 0.0
        if self.max_sensitivity is not None:
            self.peaks.append(self.loop.peak(made))
            over = min(self.peaks[-1] / self.max_sensitivity, FARTHEST)
        # Few runs suffice if the peak dominates.
        self.costs.append(self.task.cost(lambda: made, few=over > 1))
        return self.costs[-1] + (BEYOND * math.log(over) if over > 1 else 0.0)

    def untuned_peak(self, evaluated: Sequence[Costed], kind: str) -> float:
        """Return the peak of |S| with the untuned filter; raises if none stabilises the loop."""
        peaks = self.peaks or [self.loop.peak(self.build())]
        if not math.isinf(peaks[0]):  # spares the search over all others
            return peaks[0]
        if not any(
            math.isfinite(peak)
            for peak in self.peaks or (self.loop.peak(self.build(t.values)) for t in evaluated)
        ):
            raise AmbkitError(
                f"{self.loop.machine.name}: the loop is unstable with each of the {len(evaluated)} "
                f"{kind} filters that were tried; "
                f"{self.loop.choice(True) or 'give another controller'}"
            )
        return peaks[0]


def _chosen(candidate: Candidate, names: tuple[str, ...]) -> tuple[Range, ...]:
    known = {item.name: item for item in candidate.tunable}
    for name in names:
        if name not in known:
            raise AmbkitError(
                f'the {candidate.name} filter has no tunable "{name}"; it has: {", ".join(known)}'
            )
    return tuple(known[name] for name in names)


def _in_the_loop(peak: float, untuned: float, peak_limit: float | None) -> Iterator[str]:
    """Warn if the filter preferred by the data costs much of the margin of the loop."""
    if peak_limit is None and (peak > MUCH_WORSE * untuned or zone_of(peak) > zone_of(untuned)):
        yield (
            f"in the loop the peak of |S| is {peak:.2f}, zone {zone_of(peak)}, with the untuned "
            f"filter {untuned:.2f}, zone {zone_of(untuned)}: the tuning does not consider the "
            "loop; max_sensitivity sets a limit"
        )


def _at_an_end(free: Sequence[Range], values: Mapping[str, float]) -> Iterable[str]:
    """Return the values at the ends of their ranges."""
    for item in free:
        if item.name not in values:
            continue
        share = math.log(values[item.name] / item.low) / math.log(item.high / item.low)
        if not AT_THE_END < share < 1 - AT_THE_END:
            bound = item.low if share < 0.5 else item.high
            yield f"{item.name} ran into the end of its range, {bound:.3g} {item.unit}"
