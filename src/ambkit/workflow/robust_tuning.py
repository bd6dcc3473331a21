"""Controller and filter tuned over the tolerances: a search over whole batches of machines."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError, library
from ambkit.base.escaping import markdown
from ambkit.base.units import engineering
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.study import Study, load
from ambkit.campaigns.worker import fly
from ambkit.control.control import Control
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.tuning import Range, candidate_of_kind
from ambkit.judge.loop.loop_of import ZONE_A
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.scenario import Scenario

EVALUATIONS = 60  #: Where nobody says it.
QUANTILE = 0.95  #: Of the machines: so many are no worse than what is made small.

VALIDATION = 1 << 32  #: Between the study's seed and that of the machines that judge.

GAINS = {"controller.kp": "A/m", "controller.ki": "A/(m s)", "controller.kd": "A s/m"}
"""Gains that the search may change, and their units."""

FACTOR = 2.5  #: How far from the tuned controller it looks, either way.
RULES = "expert.rules"  #: Size of an expert: rules along current and along displacement.

SIZES = (3, 5, 7)

WORST = 1e3  #: In place of an infinite peak, and of an infinite error over the usual one's.


class Tried(NamedTuple):
    """A controller with its filter."""

    values: Mapping[str, float]  #: What was changed, by name, in SI.
    error: float  #: Quantile of the error of the disturbance force, rms [N].
    peak: float  #: Quantile of the peak of abs(S) [1].
    touched: float  #: Share of the machines that touch a stop, or cannot be [1].
    allowed: bool
    """Whether it keeps the peak below its ceiling, and enough rotors away from their stops."""


@dataclass(frozen=True, eq=False, repr=False)
class Robust(Result):
    """A search over controllers and filters, each flown with all machines of a study."""

    plan: Plan  #: The study.
    kind: str  #: Of the filter.
    #: Which quantile over the machines was made small; what that of the peak stays below.
    quantile: float
    max_sensitivity: float
    free: tuple[Range, ...]  #: What was changed, and within which bounds.
    tried: tuple[Tried, ...]  #: All of it, in its order; the first is as it was without tuning.
    taken: int  #: Which was taken: the one with the least error among those that are allowed.
    estimator: Estimator  #: Its filter, which knows the nominal bearing.
    controller: Control | None  #: Its controller; several axes have those of the scenario.
    #: Untuned and tuned on as many other machines; empty of a grid.
    validation: tuple[Tried, ...] = ()

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether the filter may fly, with its controller, on the nominal bearing or machine."""
        scenario: Any = self.plan.scenario
        if self.controller is not None:
            scenario = scenario.model_copy(update={"controller": self.controller})
        return judge_adequacy(self.estimator, None, scenario)

    @property
    def front(self) -> NDArray[np.bool_]:
        """Whether nothing that was tried is better in both error and peak (n,)."""
        return pareto([(item.error, item.peak) for item in self.tried])

    @property
    def _ends(self) -> tuple[Tried, Tried]:
        """The design without tuning, and the one that is taken."""
        return self.tried[0], self.tried[self.taken]

    @property
    def title(self) -> str:
        return f"{self.kind} for {self.plan.study.name}: {100 * self.quantile:g} % are no worse"

    @property
    def finding(self) -> str:
        before, after = self.validation or self._ends
        where = "on validation machines, " if self.validation else ""
        return (
            f"{self.title}: {where}error of f_d {engineering(before.error, 'N', 3)} untuned, "
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
                *(Row(item.name, item.name, float(one.values.get(item.name, item.default)),
                      item.unit) for item in self.free),
                Row("error", "error of f_d", one.error, "N"), *validation[:1],
                Row("peak", "peak of |S|", one.peak, "|S|", below=self.max_sensitivity),
                *validation[1:],
            ], section=("values",), of=of)  # fmt: skip
        best = [one for one, on in zip(self.tried, self.front, strict=True) if on]
        for place, one in enumerate(sorted(best, key=lambda entry: entry.peak), 1):
            results += put([
                Row("peak", "peak of |S|", one.peak, "|S|"),
                Row("error", "error of f_d", one.error, "N"),
                Row("allowed", "allowed", one.allowed),
            ], section=("front",), of=str(place))  # fmt: skip
        return results

    SECTIONS = {
        ("values",): Section("{0.title}"),
        ("front",): Section("Pareto front", across=True),
    }

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
                      for item, on in zip(self.tried, self.front, strict=True)],
        }  # fmt: skip

    @property
    def notes(self) -> list[str]:
        return [*sentences(self.adequacy), *self._overfitted()]

    def _overfitted(self) -> Iterator[str]:
        """Yield what does not hold on validation machines."""
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
            [item.error for item in self.tried], [item.peak for item in self.tried], self.front,
            np.array([item.allowed for item in self.tried]), self.max_sensitivity, self.taken,
        )]  # fmt: skip

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        study = self.plan.study
        self.estimator.save(path, machine=study.machine)
        if self.controller is not None:
            Scenario(controller=self.controller).save(self.beside(path))

    @staticmethod
    def beside(path: str | os.PathLike[str]) -> Path:
        """Return where the controller of a filter in a file is written."""
        return Path(path).with_suffix(".scenario.toml")


def tune_robust(
    study: Study | str | os.PathLike[str],
    *,
    quantile: float = QUANTILE,
    max_sensitivity: float = ZONE_A,
    free: Sequence[str] | None = None,
    budget: int = EVALUATIONS,
    storage: str | os.PathLike[str] | None = None,
    seed: int = 0,
    done: Callable[..., None] = lambda text="", steps=1: None,
) -> Robust:
    """Tune controller and filter over the machines of a study."""
    optuna = library("optuna", "tune robust", "campaign")
    plan = Plan(load(study))
    plan.check()
    task = _Task(plan, quantile, max_sensitivity)
    ranges = task.chosen(free)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    search = _opened(optuna, storage, task, ranges, seed)
    for number in range(len(search.trials), budget):
        trial = search.ask()
        if number == 0:  # as it is without tuning
            values = {range_.name: range_.default for range_ in ranges}
            trial.set_user_attr("values", values)
        else:
            values = {
                of.name: float(
                    trial.suggest_categorical(of.name, list(SIZES)) if of.name == RULES
                    else trial.suggest_float(of.name, of.low, of.high, log=True)
                )
                for of in ranges
            }  # fmt: skip
        result = task.evaluate(values)
        trial.set_constraint("peak", result.peak - max_sensitivity)
        trial.set_constraint("touched", result.touched - (1 - quantile))
        trial.set_user_attr("tried", [result.error, result.peak, result.touched, result.allowed])
        search.tell(trial, [result.error, result.peak])
        done()
    trials = tuple(
        Tried(item.user_attrs.get("values", item.params), *item.user_attrs["tried"])
        for item in search.trials if "tried" in item.user_attrs
    )  # fmt: skip
    errors = [item.error if item.allowed else math.inf for item in trials]
    chosen_index = int(np.argmin(errors))
    if not trials[chosen_index].allowed:
        least = min(item.peak for item in trials)
        raise AmbkitError(
            f"of {len(trials)} that were tried none keeps {100 * quantile:g} % of the machines "
            f"below a peak of {max_sensitivity:g} and away from their stops; the least peak is "
            f"{least:.3g}"
        )
    estimator, controller = task.design(trials[chosen_index].values)
    return Robust(
        plan, task.kind, quantile, max_sensitivity, ranges, trials, chosen_index, estimator,
        controller, task.judged((trials[0].values, trials[chosen_index].values)),
    )  # fmt: skip


def pareto(points: Sequence[tuple[float, float]]) -> NDArray[np.bool_]:
    """Return which points (n, 2) no other is better than in both (n,)."""
    result = np.zeros(len(points), bool)
    least = math.inf
    for at in sorted(range(len(points)), key=lambda k: points[k]):
        if points[at][1] < least:
            result[at], least = True, points[at][1]
    return result


def _opened(optuna: Any, storage: Any, task: _Task, free: Sequence[Range], seed: int) -> Any:
    """Return Optuna's study, with what the storage has of it already."""
    of = "|".join([task.plan.fingerprint, task.kind, f"{task.quantile:g}",
                   f"{task.ceiling:g}", *(item.name for item in free)])  # fmt: skip
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
            f"{storage}: is of another search: study, quantile, ceiling or what is free has "
            "changed; give another file"
        )
    search.set_user_attr("of", of)
    for trial in search.trials:
        if not trial.state.is_finished():  # it was interrupted
            search.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    # A search that is gone on with draws on, rather than again what it drew first.
    search.sampler = optuna.samplers.TPESampler(seed=seed + len(search.trials))
    return search


class _Task:
    """Machines, and what is made of them by a controller and a filter."""

    def __init__(self, plan: Plan, quantile: float, peak_limit: float) -> None:
        study = plan.study
        if not 0 < quantile < 1:
            raise AmbkitError(f"quantile must be between 0 and 1, is {quantile:g}")
        if not study.record.margins:
            raise AmbkitError(f"{study.name}: the search needs record.margins = true")
        if study.estimator not in KINDS:
            raise AmbkitError(
                f"{study.name}: the filter that is tuned must be a kind, {', '.join(KINDS)}, is "
                f"{study.estimator}"
            )
        for what in ("estimator", "controller"):
            if what in plan.names:
                raise AmbkitError(f"{study.name}: {what} varies, and is what is to be tuned")
        if any(name.startswith("scenario.control") for name in plan.names):
            raise AmbkitError(f"{study.name}: gains vary, and are what is to be tuned")
        self.plan, self.kind, self.several = plan, study.estimator, plan.several
        self.quantile, self.ceiling = quantile, peak_limit
        if study.synchronous:
            raise AmbkitError(f"{study.name}: synchronous does not go with the search for a filter")
        self.points, self.noise = plan.points(0, plan.runs), plan.noise(0, plan.runs)
        self._magnets = lru_cache(maxsize=None)(self._magnet)

    def chosen(self, free: Sequence[str] | None) -> tuple[Range, ...]:
        """Return what may change, and how far."""
        known = {}
        for name, unit in {} if self.several else GAINS.items():
            gain = getattr(self.plan.scenario.controller, name.partition(".")[2])
            if gain > 0:
                known[name] = Range(name, unit, gain, gain / FACTOR, gain * FACTOR)
        candidate = candidate_of_kind(self.kind, self.plan.nominal, self._magnets(5))
        known |= {item.name: item for item in candidate.tunable}
        if self.kind == "adaptive" and not self.several:
            known[RULES] = Range(RULES, "1", 5.0, float(SIZES[0]), float(SIZES[-1]))
        for name in free or ():
            if self.several and name in GAINS:
                raise AmbkitError(
                    f"free: {name} is of a bearing; a machine's controllers are those that its "
                    "scenario says, made for the nominal machine: the search is for the filter"
                )
            if name not in known:
                raise AmbkitError(f"free: there is no {name}; there are {', '.join(known)}")
        return tuple(known[name] for name in (free or known))

    def _magnet(self, rules: int) -> Any:
        """Return what the filter asks of its magnet: an expert of so many rules, or its kind's."""
        if self.kind != "adaptive" or self.several:
            return learned_magnet(self.kind, self.plan.nominal)
        from ambkit.workflow.training import train_on_law

        return train_on_law(self.plan.nominal, (rules, rules)).expert

    def design(self, values: Mapping[str, float]) -> tuple[Estimator, Control | None]:
        """Return filter and controller with values; no controller of a machine."""
        magnet = self._magnets(int(values.get(RULES, 5)))
        of_filter = {
            name: value for name, value in values.items() if name not in GAINS and name != RULES
        }
        estimator = candidate_of_kind(self.kind, self.plan.nominal, magnet).build(**of_filter)
        if self.several:
            return estimator, None
        gains = {name.partition(".")[2]: values[name] for name in values if name in GAINS}
        return estimator, self.plan.scenario.controller.model_copy(update=gains)

    def judged(self, several: Sequence[Mapping[str, float]]) -> tuple[Tried, ...]:
        """Simulate as many other machines; a grid has none."""
        study = self.plan.study
        if study.sampling == "grid":
            return ()
        other = Plan(study.model_copy(update={"seed": (study.seed + VALIDATION) % 2**63}))
        self.points, self.noise = other.points(0, other.runs), other.noise(0, other.runs)
        return tuple(map(self.evaluate, several))

    def evaluate(self, values: Mapping[str, float]) -> Tried:
        """Fly all machines with a controller and a filter."""
        estimator, controller = self.design(values)
        designed = self.plan.with_design(estimator, controller)
        result = fly(designed, self.points, self.noise).columns
        error = min(_quantile(result["f_d_rms"], self.quantile), WORST)
        peak = min(_quantile(result["peak_S"], self.quantile), WORST)
        touched = float(np.mean(~(np.asarray(result["touched"]) == 0)))
        allowed = peak < self.ceiling and touched <= 1 - self.quantile
        return Tried(dict(values), error, peak, touched, allowed)


def _quantile(values: Any, share: float) -> float:
    """Return the least value that a share of the machines is at or below; of none infinity."""
    at = np.sort(np.where(np.isnan(values), np.inf, values))
    return float(at[min(max(math.ceil(share * at.size) - 1, 0), at.size - 1)])
