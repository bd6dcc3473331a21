"""Tuning of controller and filter over tolerances, on all machines of a study at once."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.campaigns.plan import Plan
from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.tuning import Range, check_budget
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.robust_task import Evaluated, Task, suggested

EVALUATIONS = 60  #: Default quantile.


@dataclass(frozen=True, eq=False, repr=False)
class Robust(Result):
    """A search over controllers and filters, evaluated on all machines of a study."""

    plan: Plan  #: The study.
    #: Quantile over the machines that is minimised, and the limit of that of the peak.
    quantile: float
    max_sensitivity: float
    free: tuple[Range, ...]  #: Tunables and their ranges.
    candidates: tuple[Evaluated, ...]  #: All evaluations in order; the first is the untuned design.
    taken: int  #: Selected evaluation: the smallest error among the feasible.
    estimator: Estimator  #: Its filter, designed for the nominal machine.
    #: Its controller; machines of several axes keep those of the scenario.
    controller: Control | None
    #: Untuned and tuned design on as many validation machines; empty for a grid.
    validation: tuple[Evaluated, ...] = ()

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether the filter with its controller is adequate on the nominal machine."""
        scenario: Any = self.plan.scenario
        if self.controller is not None:
            scenario = scenario.model_copy(update={"controller": self.controller})
        return judge_adequacy(self.estimator, None, scenario)

    @property
    def front(self) -> NDArray[np.bool_]:
        """Whether no other evaluation is better in both error and peak (n,)."""
        return pareto([(item.error, item.peak) for item in self.candidates])

    @property
    def _ends(self) -> tuple[Evaluated, Evaluated]:
        """The untuned and the selected design."""
        return self.candidates[0], self.candidates[self.taken]

    @property
    def kind(self) -> str:
        """Kind of the selected filter."""
        return self.candidates[self.taken].kind

    @property
    def title(self) -> str:
        return f"{self.kind} for {self.plan.study.name}: {100 * self.quantile:g} % are no worse"

    @property
    def finding(self) -> str:
        before, after = self.validation or self._ends
        where = "on validation machines, " if self.validation else ""
        return (
            f"{self.title}: {where}error of f_d {engineering(before.error, 'N', 3)} untuned"
            f"{f' ({before.kind})' * (before.kind != self.kind)}, "
            f"{engineering(after.error, 'N', 3)} tuned; peak of |S| {before.peak:.3f} and "
            f"{after.peak:.3f}."
        )

    @property
    def rows(self) -> list[Row]:
        results = []
        judged = self.validation or (None, None)
        for of, one, other in zip(("untuned", "tuned"), self._ends, judged, strict=True):
            validation = () if other is None else (
                Row("validation.error", "error of f_d, validation machines", other.error, "N"),
                Row("validation.peak", "peak of |S|, validation machines", other.peak, "|S|",
                    below=self.max_sensitivity),
            )  # fmt: skip
            results += put([
                Row("filter", "filter", one.kind),
                *(Row(item.name, item.name, one.values.get(item.name), item.unit)
                  for item in self.free),
                Row("error", "error of f_d", one.error, "N"), *validation[:1],
                Row("peak", "peak of |S|", one.peak, "|S|", below=self.max_sensitivity),
                *validation[1:],
            ], section=("values",), of=of)  # fmt: skip
        best = [one for one, on in zip(self.candidates, self.front, strict=True) if on]
        for place, one in enumerate(sorted(best, key=lambda entry: entry.peak), 1):
            results += put([
                Row("peak", "peak of |S|", one.peak, "|S|"),
                Row("error", "error of f_d", one.error, "N"),
                Row("allowed", "allowed", one.allowed), Row("filter", "filter", one.kind),
            ], section=("front",), of=str(place))  # fmt: skip
        return results

    SECTIONS = {("values",): Section("{0.title}"), ("front",): Section("Pareto front", across=True)}

    @property
    def series(self) -> dict[str, Any]:
        return {
            "study": self.plan.study.name,
            "kind": self.kind,
            "quantile": self.quantile,
            "max_sensitivity": self.max_sensitivity,
            "taken": self.taken,
            "validation": [one._asdict() | {"values": dict(one.values)} for one in self.validation],
            "bounds": {r.name: {"low": r.low, "high": r.high, "default": r.default,
                                "unit": r.unit} for r in self.free},
            "tried": [item._asdict() | {"values": dict(item.values), "front": bool(on)}
                      for item, on in zip(self.candidates, self.front, strict=True)],
        }  # fmt: skip

    @property
    def notes(self) -> list[str]:
        return [*sentences(self.adequacy), *self._overfitted()]

    def _overfitted(self) -> Iterator[str]:
        """Yield gains that validation does not confirm."""
        if not self.validation:
            return
        before, after = self.validation
        if not after.allowed:
            yield (
                f"on validation machines the peak of |S| is {after.peak:.3f}, not "
                f"below {self.max_sensitivity:g}, or more of them touch their stops: take more runs"
            )
        if after.error > before.error:
            yield (
                "on validation machines the tuned filter is worse than the untuned: take more runs"
            )

    def figures(self) -> list[Figure]:
        from ambkit.campaigns.figures import front_figure

        return [front_figure(
            f"{markdown(self.plan.study.name)}: {100 * self.quantile:g} % of the machines are no "
            "worse",
            [item.error for item in self.candidates], [item.peak for item in self.candidates],
            self.front,
            np.array([item.allowed for item in self.candidates]), self.max_sensitivity, self.taken,
        )]  # fmt: skip

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        study = self.plan.study
        self.estimator.save(path, machine=study.machine)
        if self.controller is not None:
            Scenario(controller=self.controller).save(self.beside(path))

    @staticmethod
    def beside(path: str | os.PathLike[str]) -> Path:
        """Return the path for the controller of a filter file."""
        return Path(path).with_suffix(".scenario.toml")


def tune_robust(
    task: Task,
    *,
    free: Sequence[str] | None = None,
    budget: int = EVALUATIONS,
    storage: str | os.PathLike[str] | None = None,
    seed: int = 0,
    done: Callable[..., None] = lambda text="", steps=1: None,
) -> Robust:
    """Tune controller and filter over the machines of a study."""
    optuna, plan = task.optuna, task.plan
    quantile, max_sensitivity = task.quantile, task.max_sensitivity
    ranges = task.chosen(free)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    search = _opened(optuna, storage, task, ranges, seed)
    check_budget(budget)
    for number in range(len(search.trials), budget):
        trial = search.ask()
        if number < len(task.kinds):  # the untuned designs, with the study's filter first
            kind = task.kinds[number]
            values = {of.name: of.default for of in ranges[kind]}
        else:
            kind = trial.suggest_categorical("filter", task.kinds)
            values = suggested(trial, kind, ranges[kind])
        result = task.evaluate(kind, values)
        trial.set_constraint("peak", result.peak - max_sensitivity)
        trial.set_constraint("touched", result.touched - (1 - quantile))
        trial.set_user_attr("tried", result._asdict())
        search.tell(trial, [result.error, result.peak])
        done()
    trials = tuple(
        Evaluated(**item.user_attrs["tried"])
        for item in search.trials
        if "tried" in item.user_attrs
    )
    errors = [item.error if item.allowed else math.inf for item in trials]
    chosen_index = int(np.argmin(errors))
    if not trials[chosen_index].allowed:
        least = min(item.peak for item in trials)
        raise AmbkitError(
            f"of {len(trials)} that were tried none keeps {100 * quantile:g} % of the machines "
            f"below a peak of {max_sensitivity:g} and away from their stops; the least peak is "
            f"{least:.3g}"
        )
    taken = trials[chosen_index]
    estimator, controller = task.design(taken.kind, taken.values)
    free_ranges = {of.name: of for several in ranges.values() for of in several}
    return Robust(
        plan, quantile, max_sensitivity, tuple(free_ranges.values()),
        trials, chosen_index, estimator, controller, task.judged((trials[0], taken)),
    )  # fmt: skip


def pareto(points: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which points (n, 2) are Pareto-optimal (n,)."""
    result = np.zeros(len(points), bool)
    least = math.inf
    for at in sorted(range(len(points)), key=lambda k: points[k]):
        if points[at][1] < least:
            result[at], least = True, points[at][1]
    return result


def _opened(
    optuna: Any, storage: Any, task: Task, free: Mapping[str, Sequence[Range]], seed: int
) -> Any:
    """Return Optuna's study, with the evaluations in the storage."""
    of = "|".join([
        task.plan.fingerprint, f"{task.quantile:g}", f"{task.max_sensitivity:g}",
        *(f"{kind} {item.name}" for kind, ranges in free.items() for item in ranges),
    ])  # fmt: skip
    journal = None
    if storage is not None:
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        path = Path(storage)
        if path.is_dir() or not path.parent.is_dir():
            raise AmbkitError(f"{path}: cannot be written: it is a folder, or in none")
        try:
            journal = JournalStorage(JournalFileBackend(str(path)))
        except (OSError, ValueError, KeyError) as error:
            raise AmbkitError(f"{path}: holds no search of Optuna: {error}") from None
    search = optuna.create_study(
        storage=journal,
        study_name="ambkit",
        directions=["minimize", "minimize"],
        load_if_exists=True,
    )
    if search.user_attrs.get("of", of) != of:
        raise AmbkitError(
            f"{storage}: is of another search: study, quantile, limit or free settings "
            "have changed; give another file"
        )
    search.set_user_attr("of", of)
    for trial in search.trials:
        if not trial.state.is_finished():  # interrupted
            search.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    # A resumed search continues the random sequence instead of repeating its start.
    search.sampler = optuna.samplers.TPESampler(seed=seed + len(search.trials))
    return search
