"""Comparison of filters."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.arguments import arguments_of_the_user
from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import is_class
from ambkit.base.quantity_arguments import QuantityLike, in_si, names_in, of_type
from ambkit.base.units import engineering
from ambkit.data.files.tables import Table
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_saving import NotSaveable, made_by, origin_of, preset_of
from ambkit.estimate.named import EXPERTS, experts, factories
from ambkit.estimate.registry import AT, KINDS
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.cases import CASES, Case
from ambkit.judge.comparison.comparison import TRAINING
from ambkit.judge.comparison.conditions import Spread
from ambkit.judge.comparison.criteria import EVALUATED
from ambkit.judge.comparison.score import ComparisonSet, Score, least
from ambkit.judge.comparison.seeds import compare, comparison_figure
from ambkit.judge.comparison.study import Study, across, study
from ambkit.judge.comparison.tuning import expand, suited
from ambkit.machine.axes import isolated_axes
from ambkit.machine.forces.force_map import true_magnet
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.simulate import scenario_for, with_plant

NOTES = logging.getLogger("ambkit")


def tuned_filters(result: Study) -> dict[str, Estimator]:
    """Return the filters tuned by a comparison, each with the origin of its parameters."""
    if not result.tuned:
        raise AmbkitError("nothing was tuned: budget must be greater than 0")
    origin = made_by(
        "compare",
        f"errors in {TRAINING} simulated runs of {result.machine.name}, case {result.case.name}",
    )
    made = {}
    for name, score in result.tuned.items():
        tuning = score.tuning
        if name not in KINDS or tuning is None:
            continue
        better = tuning.objective < tuning.default
        estimator: Estimator = result.field[name].build(**(tuning.values if better else {}))
        if better:
            estimator.origin = origin_of(tuning.values, origin)
        made[name] = estimator
    return made


def adequacy_of(result: Study) -> dict[str, list[Finding]]:
    """Return by kind whether the filters tuned by a comparison are adequate."""
    if not result.tuned:
        return {}
    return {
        name: judge_adequacy(made, nis=result.tuned[name].mean("nis"))
        for name, made in tuned_filters(result).items()
    }


def save_filters(result: Study, folder: str | os.PathLike[str]) -> dict[str, str]:
    """Write the filters tuned by a comparison, one file per kind: ``FOLDER/KIND.toml``."""
    made, known, machine = tuned_filters(result), result.machine, result.machine_file
    place = files.make_folder(folder)
    if machine is None and preset_of(known) is None:
        machine = place / "bearing.toml"
        known.save(machine)
    left_out = {}
    for name, estimator in made.items():
        try:
            magnet = result.magnet_files.get(name)
            estimator.save(place / f"{name}.toml", machine=machine, magnet=magnet)
        except NotSaveable as error:
            left_out[name] = str(error)
            NOTES.warning("note: %s", error)
    for kind, findings in adequacy_of(result).items():
        for text in sentences(findings):
            NOTES.warning("%s: %s", kind, text)
    return left_out


Done = Callable[[str], None]


def in_case(
    machine: Machine, filter: Any, case: Any, *, plant: Any, spread: Any, budget: int, seeds: range,
    robustness: bool, source: Any, done: Done,
) -> Study | ComparisonSet:  # fmt: skip
    """Compare filters in one case, or in all."""
    cases = _cases(machine, case, plant, in_si("spread", spread, "1"))
    mapping = isinstance(filter, Mapping)
    several = [] if mapping else names_in(Estimator, type, filter=filter)
    texts = [item for item in several if isinstance(item, str | os.PathLike)]
    own = factories(filter if mapping else [i for i in several if i not in texts], machine)
    names, files = _with_files(texts)
    if not names and not own:
        expand("")
    names = suited(names, machine)
    if case == "all" and robustness:
        raise AmbkitError("robustness needs one case, not all")
    how: Any = {
        "custom": own, "runs": len(seeds), "budget": budget, "seed": seeds.start, "done": done,
        "magnets": {kind: experts(Path(file), machine) for kind, file in files.items()},
    }  # fmt: skip
    with arguments_of_the_user():
        if case == "all":
            return across(machine, cases, names, **how)
        (chosen,) = cases.values()
        result = study(machine, chosen, names, robustness=robustness, **how)
    return replace(
        result, machine_file=source if isinstance(source, str | os.PathLike) else None,
        magnet_files=files, save_filters=save_filters, judge=adequacy_of,
    )  # fmt: skip


def _cases(machine: Machine, case: Any, plant: Any, spread: float | None) -> dict[str, Case]:
    """Return one case or all, by name, with the user's plant and tolerances."""
    of_type(str, Case, case=case)
    if isinstance(case, Case):
        cases = {case.name: case}
    elif case not in (*CASES, "all"):
        raise AmbkitError(f'there is no case "{case}"; known: {", ".join(CASES)}, all')
    else:
        cases = dict(CASES) if case == "all" else {case: CASES[case]}
        if spread is not None:
            if not 0 <= spread < 1:
                raise AmbkitError(f"spread must be from 0 to below 100 %, is {100 * spread:g} %")
            cases = {name: replace(of, spread=Spread.all(spread)) for name, of in cases.items()}
    if plant is None:
        return cases
    own = {"plant": plant} if is_class(plant) else {"magnet": true_magnet(plant, machine)}
    return {name: replace(of, **own) for name, of in cases.items()}


def in_loops(
    machine: Machine, filter: Any, scenario: Any, *, steps: Any, load: Any, duration: Any,
    plant: Any, seeds: range, done: Done,
) -> LoopScores:  # fmt: skip
    """Compare filters, each in its own loop."""
    heights = None if steps is None else names_in(float, int, steps=steps)
    name = os.fspath(scenario) if isinstance(scenario, str | os.PathLike) else "scenario"
    what = loop_cases(machine, scenario, steps=heights, load=load, duration=duration, name=name)
    built, scores = factories(filter, machine), {}
    for name, of in what.items():
        run, magnet = with_plant(of.scenario, plant, machine)
        scores[name] = compare(machine, run, built, seeds, magnet=magnet, done=lambda: done(""))
    return LoopScores(machine, what, scores, seeds)


def _with_files(filter: Sequence[Any]) -> tuple[list[str], dict[str, str]]:
    """Return the names of kinds and classes, and the files that kinds need for their magnet."""
    names: list[str] = []
    files: dict[str, str] = {}
    for item in map(os.fspath, filter):
        kind, _, file = item.partition(AT)
        if item.endswith(EXPERTS):
            kind, file = (kind, file) if file else ("adaptive", item)
            files[kind] = file
        names += expand(kind if item.endswith(EXPERTS) else item)
    return list(dict.fromkeys(names)), files


HEIGHTS = (0.1, 0.3, 0.5)
"""Default steps of the reference, over the clearance."""


@dataclass(frozen=True)
class LoopCase:
    """Scenario of a closed-loop comparison."""

    scenario: Scenario  #: Scenario, without its seed.
    #: Step of the reference [m]; None for a scenario of the user.
    step: float | None = None
    #: Step of the disturbance force at half of the run [N], if there is one.
    load: float | None = None


def loop_cases(
    machine: Machine,
    scenario: Scenario | str | os.PathLike[str] | None = None,
    *,
    steps: Iterable[QuantityLike] | None = None,
    load: QuantityLike | None = None,
    duration: QuantityLike | None = None,
    name: str = "scenario",
) -> dict[str, LoopCase]:
    """Return the cases by name: the user's scenario, or a step of each height."""
    load = in_si("load", load, "N")
    heights: list[float | None] = [None]
    if steps is not None:
        heights = [in_si("steps", height, "m") for height in steps]
    elif scenario is None:
        heights = [share * isolated_axes(machine)[0].clearance for share in HEIGHTS]
    results = {}
    for height in heights:
        run = scenario_for(machine, scenario, duration=duration, step=height, load=load)
        if run.feedback is None:  # each filter closes its own loop
            run = run.fed("estimate")
        at = name if height is None else engineering(height, "m", digits=4)
        results[at] = LoopCase(run, height, load)
    return results


@dataclass(frozen=True, repr=False)
class LoopScores(Result):
    """Scores of estimators, each in its own loop, over the same seeds."""

    machine: Machine  #: Plant, and prior of the estimators.
    loop_cases: Mapping[str, LoopCase]  #: The cases by name.
    #: Scores by case and estimator.
    scores: Mapping[str, Mapping[str, Score]]
    seeds: range  #: Seeds of the runs.

    @property
    def steps(self) -> list[float] | None:
        """Step height of each case [m]; None for a scenario of the user."""
        heights = [of.step for of in self.loop_cases.values() if of.step is not None]
        return heights if len(heights) == len(self.loop_cases) else None

    @property
    def title(self) -> str:
        return f"{self.machine.name}, each in its own loop, {len(self.seeds)} seeds"

    @property
    def finding(self) -> str:
        case = list(self.scores)[-1]
        rows = [row for row in self.rows if row.section == ("cases", case)]
        return f"{self.title}: at {case} {least(rows)}."

    @property
    def rows(self) -> list[Row]:
        return [
            row
            for case, scores in self.scores.items()
            for name, score in scores.items()
            for row in put(score.rows(), section=("cases", case), of=name)
        ]

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        by = "step " if self.steps else ""
        return {("cases", case): Section(f"{by}{case}", across=True)
                for case in self.scores}  # fmt: skip

    @property
    def notes(self) -> list[str]:
        return [
            f"{case}, {name}: contact with the stop in {lost:.0f} of {len(self.seeds)} runs."
            for case, scores in self.scores.items()
            for name, score in scores.items()
            if (lost := score.figures["lost"].sum())
        ]

    @property
    def series(self) -> dict[str, Any]:
        return {
            "machine": self.machine.name,
            "seeds": [self.seeds[0], self.seeds[-1]],
            "load": next(iter(self.loop_cases.values())).load if self.loop_cases else None,
        }

    def file(self) -> Table:
        scores, count = self.scores, len(self.seeds)
        columns: dict[str, Any] = {"case": np.repeat(np.arange(len(scores), dtype=float), count)}
        units = {"case": "1", "step": "m", "seed": "1"}
        if self.steps is not None:
            columns["step"] = np.repeat(np.array(self.steps, dtype=float), count)
        columns["seed"] = np.tile(np.array(self.seeds, dtype=float), len(scores))
        for name in next(iter(scores.values())):
            for signal, unit in (EVALUATED | {"nis": "1"}).items():
                of_cases = [case[name].figures[signal] for case in scores.values()]
                units[f"{name}_{signal}"], columns[f"{name}_{signal}"] = unit, np.hstack(of_cases)
        return Table(columns, {k: units[k] for k in columns}, {"cases": list(scores)})

    def figures(self) -> list[Figure]:
        return [comparison_figure(self.scores, "scenario" if self.steps is None else "step")]
