"""Filters that a user names, compared."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ambkit.assessment.arguments import arguments_of_the_user
from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import names_in, of_type
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_saving import NoFile, made_by, origin_of, preset_of
from ambkit.estimate.named import AT, EXPERTS, experts, factories
from ambkit.estimate.registry import KINDS
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.comparison.cases import Case
from ambkit.judge.comparison.comparison import TRAINING
from ambkit.judge.comparison.score import Benches
from ambkit.judge.comparison.study import Study
from ambkit.judge.comparison.tuning import expand, suited
from ambkit.machine.forces.force_map import surface_in
from ambkit.machine.machine import Machine
from ambkit.workflow.compare_steps import (
    LoopScores,
    compare_in_case,
    compare_in_loops,
    loop_cases,
)

NOTES = logging.getLogger("ambkit")


def tuned_filters(result: Study) -> dict[str, Estimator]:
    """Return the filters that a comparison tuned, each with where its numbers are from."""
    bench = result.bench
    if not bench.tuned:
        raise AmbkitError("nothing was tuned: budget must be greater than 0")
    origin = made_by(
        "compare",
        f"errors in {TRAINING} simulated runs of {bench.bearing.name}, case {bench.case.name}",
    )
    made = {}
    for name, score in bench.tuned.items():
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
    """Return by kind whether the filters that a comparison tuned may fly."""
    if not result.bench.tuned:
        return {}
    return {
        name: judge_adequacy(made, nis=result.bench.tuned[name].mean("nis"))
        for name, made in tuned_filters(result).items()
    }


def save_filters(result: Study, folder: str | os.PathLike[str]) -> dict[str, str]:
    """Write the filters that a comparison tuned, a file for each kind: ``FOLDER/KIND.toml``."""
    made, known, bearing = tuned_filters(result), result.bench.bearing, result.machine_file
    place = files.make_folder(folder)
    if bearing is None and preset_of(known) is None:
        bearing = place / "bearing.toml"
        known.save(bearing)
    left_out = {}
    for name, estimator in made.items():
        try:
            magnet = result.magnet_files.get(name)
            estimator.save(place / f"{name}.toml", bearing=bearing, magnet=magnet)
        except NoFile as error:
            left_out[name] = str(error)
            NOTES.warning("note: %s", error)
    for kind, findings in adequacy_of(result).items():
        for text in sentences(findings):
            NOTES.warning("%s: %s", kind, text)
    return left_out


Done = Callable[[str], None]


def in_case(
    machine: Machine, filter: Any, case: Any, *, plant: Any, spread: Any, budget: int, seeds: range,
    whole: bool, source: Any, done: Done,
) -> Study | Benches:  # fmt: skip
    """Compare filters in a case, or in all of them."""
    of_type(str, Case, case=case)
    mapping = isinstance(filter, Mapping)
    several = [] if mapping else names_in(Estimator, type, filter=filter)
    texts = [item for item in several if isinstance(item, str | os.PathLike)]
    own = factories(filter if mapping else [i for i in several if i not in texts], machine)
    names, files = _with_files(texts)
    if not names and not own:
        expand("")
    names = suited(names, machine)
    with arguments_of_the_user():
        if case == "all" and whole:
            raise AmbkitError("whole needs one case, not all")
        result = compare_in_case(
            machine, case, names, whole=whole, runs=len(seeds), budget=budget, seed=seeds.start,
            spread=spread, plant=_true_magnet(plant, machine), custom=own, done=done,
            magnets={kind: experts(Path(file), machine) for kind, file in files.items()},
        )  # fmt: skip
    if isinstance(result, Benches):
        return result
    known = source if isinstance(source, str | os.PathLike) else None
    return replace(
        result, machine_file=known, magnet_files=files, save_filters=save_filters,
        judge=adequacy_of,
    )  # fmt: skip


def in_loops(
    machine: Machine, filter: Any, scenario: Any, *, steps: Any, load: Any, duration: Any,
    plant: Any, seeds: range, done: Done,
) -> LoopScores:  # fmt: skip
    """Compare filters, each in its own loop."""
    heights = None if steps is None else names_in(float, int, steps=steps)
    name = os.fspath(scenario) if isinstance(scenario, str | os.PathLike) else "scenario"
    what = loop_cases(machine, scenario, steps=heights, load=load, duration=duration, name=name)
    return compare_in_loops(
        machine, what, filter, seeds=seeds, plant=_true_magnet(plant, machine),
        done=lambda: done(""),
    )  # fmt: skip


def _with_files(filter: Sequence[Any]) -> tuple[list[str], dict[str, str]]:
    """Return the names of kinds and classes, and the files that kinds ask of their magnet."""
    names: list[str] = []
    files: dict[str, str] = {}
    for item in map(os.fspath, filter):
        kind, _, file = item.partition(AT)
        if item.endswith(EXPERTS):
            kind, file = (kind, file) if file else ("adaptive", item)
            files[kind] = file
        names += expand(kind if item.endswith(EXPERTS) else item)
    return list(dict.fromkeys(names)), files


def _true_magnet(plant: Any, machine: Machine) -> Any:
    """Return the plant's true magnet."""
    if plant is None:
        return None
    if not machine.single:
        count = len(machine.axes)
        raise AmbkitError(f"plant is the magnet of one axis, and {machine.name} has {count}")
    if isinstance(plant, str | os.PathLike):
        return surface_in(plant, machine.isolated_axis(""))
    return plant
