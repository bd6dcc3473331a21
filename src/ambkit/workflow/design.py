"""From a machine and its logs to exported C: identify, tune, assess, export; resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from ambkit.arguments import inputs_argument, loop_arguments, record_arguments
from ambkit.assessment.assess import assess
from ambkit.assessment.assessment import Assessment
from ambkit.assessment.loop import AssessedLoop
from ambkit.assessment.speed_sweep import assess_over_speed
from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import names_in, of_type
from ambkit.base.threads import one_thread
from ambkit.control.control import Control
from ambkit.control.default_control import default_control, settled
from ambkit.control.held_loop import overshoot
from ambkit.control.pid import GAINS, PID
from ambkit.data.channel_map import ChannelMap
from ambkit.data.input_scaling import Inputs
from ambkit.data.reading import load_with_gaps
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.registry import get_kind
from ambkit.judge.adequacy import sentences
from ambkit.judge.loop.loop_builder import ZONE_A, LoopBuilder, zone_of
from ambkit.machine.axes import slowest_time
from ambkit.machine.machine import Machine
from ambkit.result.page import write_result
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.design_candidates import (
    Stages,
    adequacy_of,
    best_of,
    candidate_in,
    exported_filter,
    failed_criteria,
    judged,
    of_tuning,
    read_json,
    tuned_within,
    write_json,
)
from ambkit.workflow.designed import Design
from ambkit.workflow.identified import identified_filter
from ambkit.workflow.identified_toml import annotated_toml
from ambkit.workflow.identify import identify
from ambkit.workflow.tune import BUDGET, RUNS

DIGITS = 3  #: Significant digits of the gains in the scenario file.


def control_for(machine: Machine) -> Control:
    """Return the default controllers for estimate feedback, rounded as in the scenario file."""
    result = default_control(machine, "estimate")
    if not result.held:
        raise AmbkitError(result.summary)
    control = result.chosen.control
    plain = control.type == "decentralised" and not control.pid
    estimator = KalmanFilter(machine)
    parts = LoopBuilder(machine, None if plain else control).pids(estimator)
    pids = {
        name: PID(**{key: float(f"{getattr(pid, key):.{DIGITS}g}") for key in GAINS})  # type: ignore[arg-type]
        for name, pid in parts.items()
    }
    written = control.model_copy(update={"pid": pids, "feedback": "estimate"})
    return settled(machine, written, "estimate")


def objections_to_loop(loop: AssessedLoop, peak_limit: float | None) -> Sequence[str]:
    """Return the reasons against using a loop."""
    if not loop.stable:
        return ["the loop is not stable"]
    if zone_of(loop.peak) != "A":
        return [f"the peak of |S| is {loop.peak:.3g}, zone {zone_of(loop.peak)} of ISO 14839-3"]
    if peak_limit is not None and loop.peak >= peak_limit:
        return [f"the peak of |S| is {loop.peak:.3g}, not below {peak_limit:g}"]
    return []


KINDS_TRIED = ("linear", "extended", "adaptive")
"""Default kinds: constant, exact and learned stiffness."""


@one_thread()
def design(
    machine: Machine,
    logs: Sequence[str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    *,
    channels: str | os.PathLike[str] | None = None,
    validate: Sequence[str | os.PathLike[str]] = (),
    kinds: Sequence[str] | None = None,
    free: Sequence[str] | None = None,
    max_sensitivity: float | None = ZONE_A,
    precision: str = "float",
    prefix: str | None = None,
    anyway: bool = False,
    seed: int = 0,
    runs: int = RUNS,
    budget: int = BUDGET,
    note: Callable[[str], None] = lambda _text: None,
) -> Design:
    """Design controllers and a filter for a machine from its logs, and export them as C."""
    of_type(Machine, machine=machine)
    if free is not None and not (logs and machine.single):
        raise AmbkitError(
            f"a design identifies a machine with one axis from its logs; {machine.name} has "
            f"{len(machine.axes)}, and there are {len(logs)} logs: see 'ambkit identify --axis'"
        )
    kinds = KINDS_TRIED if kinds is None else names_in(kinds=kinds)
    for kind in kinds:
        get_kind(kind)
    work = _Work(machine, logs, validate, channels, files.make_folder(folder), note)
    work.identify(free)
    control = work.choose_controllers()
    for kind in kinds:
        work.tune(
            kind, control, max_sensitivity=max_sensitivity, seed=seed, runs=runs, budget=budget
        )
        work.judge(kind, seed)
    place, result = work.place, work.machine
    candidates = [candidate_in(place, kind) for kind in kinds]
    chosen = best_of(candidates)
    estimator = Estimator.load(chosen.file)
    estimator.save(place / "filter.toml", machine=place / "machine.toml")
    note("assessing the loop")
    assessed = _assessed(result, chosen.kind, estimator, control, place, note)
    loop = assessed.loops[chosen.kind]
    run = Scenario(controller=control)
    adequacy = tuple(adequacy_of(chosen, run))
    fatal = [item for item in adequacy if item.fatal and item.name != "peak of |S|"]
    objections = (
        *objections_to_loop(loop, max_sensitivity), *failed_criteria(chosen), *sentences(fatal)
    )  # fmt: skip
    exported = None
    if anyway or not objections:
        note("exporting")
        exported = exported_filter(result, place, "c", precision, prefix)
        exported_filter(result, place, "controller", precision, prefix, run)
    made = {name: what for name, what in FILES.items() if (place / name).exists()}
    made["design.html"] = FILES["design.html"]
    notes = (*work.notes, *sentences([item for item in adequacy if not item.fatal]))
    step = overshoot(loop.loop, slowest_time(result), len(result.axes))
    design = Design(
        place, result, control, tuple(candidates), chosen, assessed, step,
        objections, exported, made, notes, adequacy, work.records[0][-1] if work.logs else None,
    )  # fmt: skip
    note("drawing")
    design.page(place / "design.html")
    return design


def _assessed(
    machine: Machine, kind: str, filter: Estimator, control: Control, place: Path,
    note: Callable[[str], None],
) -> Assessment:  # fmt: skip
    """Assess a loop; write the verdict of a stable one, over the speed range if the rotor spins."""
    loop = loop_arguments(machine, {kind: filter}, control)
    assessed = assess(loop)
    if not assessed.loops[kind].stable:
        return assessed
    pages: list[Any] = [assessed]
    if machine.rotor.type != "mass":
        note("looking at one speed after the other")
        pages.append(assess_over_speed(loop, apart=assessed.separations))
    write_result(pages, place / "verdict.html")
    return assessed


FILES = {
    "machine.toml": "the machine, identified if there are records",
    "identified.toml": "the filter of the identified machine, with the offsets of the log",
    "scenario.toml": "the controllers, with all their gains",
    "candidates": "the filters that were tried, tuned, and their figures",
    "filter.toml": "the filter to use",
    "verdict.html": "the assessment of the loop, for signature",
    "c": "the filter as C, for the controller",
    "controller": "filter and controllers as C, from readings to currents",
    "design.html": "the report",
}


class _Work:
    """The stages of a design and their results."""

    def __init__(
        self, machine: Machine, logs: Sequence[Any], validate: Sequence[Any], channels: Any,
        place: Path, note: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.described = self.machine = machine
        self.logs, self.validate, self.channels = logs, validate, channels
        self.place, self.note, self.stages = place, note, Stages(place)
        self.inputs: Inputs | None = None
        self.notes: tuple[str, ...] = ()
        read = [*map(Path, logs), *map(Path, validate), *([channels] if channels else [])]
        self.sources = [files.sha256(path) for path in read]

    def identify(self, free: Sequence[str] | None) -> None:
        """Identify an isolated axis from its logs; machines of several axes stay as described."""
        if not (self.logs and self.described.single):
            self.described.save(self.place / "machine.toml")
            return
        self.note("identifying")
        place = self.place

        def make() -> None:
            records = record_arguments(self.logs, self.described, self.channels)
            result = identify(self.described, records, free=free, note=self.note)
            files.write_text(place / "machine.toml", annotated_toml(result.likelihood, place))
            source = ", ".join(Path(path).name for path in self.logs)
            write_json(place / "identified.json", {"notes": result.of_the_zeros})
            made = identified_filter(result, inputs_argument(self.channels), source)
            made.save(place / "identified.toml", machine=place / "machine.toml")

        names = [Path(path).name for path in (*self.logs, *self.validate)]
        self.stages.make(
            "identify", [self.described.to_toml(), sorted(free or []), names, *self.sources],
            ("machine.toml", "identified.toml", "identified.json"), make,
        )  # fmt: skip
        identified = Estimator.load(self.place / "identified.toml")
        self.machine, self.inputs = identified.machine, identified.inputs
        self.notes = tuple(read_json(self.place / "identified.json")["notes"])

    def choose_controllers(self) -> Control:
        """Return the controllers, after writing them to the folder."""
        self.note("choosing the controllers")
        path = self.place / "scenario.toml"
        self.stages.make(
            "control", [self.machine.to_toml()], (path.name,),
            lambda: Scenario(controller=control_for(self.machine)).save(path),
        )  # fmt: skip
        return Scenario.load(path).controller

    @cached_property
    def records(self) -> tuple[list[Record], list[Record]]:
        """The logs for tuning, and those for validation."""
        channels = self.channels
        if channels is not None and self.inputs is not None:
            channels = ChannelMap.load(channels).with_inputs(self.inputs)
        logs, others = (
            [load_with_gaps(path, channels) for path in of] for of in (self.logs, self.validate)
        )
        return logs, others

    def tune(self, kind: str, control: Control, **options: Any) -> None:
        """Tune a kind in the loop and write its file."""
        self.note(f"tuning the {kind} filter")
        name, place = f"candidates/{kind}.toml", self.place

        def make() -> None:
            logs, others = self.records
            tuned = tuned_within(
                options["max_sensitivity"], self.machine, logs, kind, validate=others,
                controller=control, inputs=self.inputs,
                seeds=range(options["seed"], options["seed"] + options["runs"]),
                budget=options["budget"],
                source=", ".join(Path(path).name for path in self.logs),
            )  # fmt: skip
            files.make_folder(place / "candidates")
            tuned.named(machine=place / "machine.toml").save(place / name)
            write_json(place / f"candidates/{kind}.json", of_tuning(tuned))

        known = [place / item for item in ("machine.toml", "scenario.toml", "identified.toml")]
        made_from = [files.sha256(path) for path in known if path.exists()]
        self.stages.make(
            f"tune {kind}", [kind, options, *made_from, *self.sources],
            (name, f"candidates/{kind}.json"), make,
        )  # fmt: skip

    def judge(self, kind: str, seed: int) -> None:
        """Judge a filter that was tuned on records in simulation."""
        place, name = self.place, f"candidates/{kind}.judged.json"
        if not self.logs:
            return
        self.note(f"judging the {kind} filter")
        file = place / f"candidates/{kind}.toml"
        self.stages.make(
            f"judge {kind}", [files.sha256(file), seed, "under a load"], (name,),
            lambda: write_json(place / name, judged(file, seed)),
        )  # fmt: skip
