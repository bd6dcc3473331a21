"""From logs to the filter to fly: identified, trained, tuned, judged, exported; resumable."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base import files
from ambkit.base.asked import names_in, of_type
from ambkit.base.errors import AmbkitError
from ambkit.base.showing import Shown
from ambkit.base.threads import one_thread
from ambkit.data.channelmap import ChannelMap, inputs_of
from ambkit.data.reading import load_filled
from ambkit.data.rig_units import Inputs
from ambkit.estimate.base import Estimator
from ambkit.estimate.registry import KINDS, kind_called
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.training import train
from ambkit.judge.adequacy import sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.evaluation import evaluate
from ambkit.judge.loop.loop_of import ZONE_A
from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine, short_form
from ambkit.show.pages.design import write_design
from ambkit.show.pages.maximum_likelihood import annotated_toml
from ambkit.show.plots.filters import filter_figure
from ambkit.workflow.design_candidates import (
    Candidate,
    adequacy_of,
    best_of,
    candidate_in,
    exported_filter,
    judged,
    objections_to,
    of_tuning,
    tuned_within,
    why_fly,
)
from ambkit.workflow.designing_machine import MachineDesign, design_machine
from ambkit.workflow.identifying import identified_filter, identify
from ambkit.workflow.stages import Stages, read_json, write_json
from ambkit.workflow.tuned_filter import BUDGET, RUNS
from ambkit.workflow.tuning_tasks import AHEAD, JUDGED

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.export.c import CExport

KINDS_TRIED = ("linear", "extended", "adaptive")
"""Who is tried where nobody says it: without, with the exact, and with a learned stiffness."""


@dataclass(frozen=True)
class Design(Shown):
    """A filter to fly, and why."""

    folder: Path  #: Where all of it lies.
    candidates: tuple[Candidate, ...]  #: Who was tried.
    chosen: Candidate  #: Who is to fly.
    raw: float  #: What the sensor errs by in the same simulated runs [m].
    why: str  #: Which filter to fly and why, in a sentence.
    objections: tuple[str, ...]  #: What speaks against flying it; empty if nothing does.
    exported: CExport | None  #: The C; None where objections kept it from being written.
    made: Mapping[str, str]  #: Its files in the folder, and what they are.
    notes: tuple[str, ...] = ()  #: What is to be known of what was identified.
    adequacy: tuple[Finding, ...] = ()  #: Whether the chosen filter may fly.

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        return {
            "folder": str(self.folder),
            "chosen": self.chosen.kind,
            "why": self.why,
            "objections": list(self.objections),
            "adequacy": [each.to_dict() for each in self.adequacy],
            "notes": list(self.notes),
            "raw_sensor": self.raw,
            "exported": self.exported is not None,
            "files": list(self.made),
            "candidates": [
                {"kind": c.kind, "file": str(c.file), "kept": c.kept, "unseen": dict(c.unseen),
                 "errors": dict(c.errors), "efficiency": c.efficiency, "peak": c.peak,
                 "load": c.load}
                for c in self.candidates
            ],
        }  # fmt: skip


@one_thread()
def design(
    bearing: Bearing | Machine,
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
) -> Design | MachineDesign:
    """Go from what is known of a machine, and its logs, to what flies, as C.

    Of one axis the bearing is identified and a filter chosen. Each stage writes its files into the
    folder and is not repeated while what it was made from stays as it was: ``found.toml`` and
    ``identified.toml``, ``expert.json``, a filter of each kind, ``filter.toml``, ``c/``,
    ``design.html``. Of several axes controllers and filter are chosen, see `design_machine`.

    Parameters
    ----------
    bearing : Bearing or Machine
        What is known already.
    logs : sequence of path
        Records of the loop; of several axes there may be none.
    folder : path
        Where all of it goes.
    channels : path, optional
        Channel map of the logs; the exported C takes the log's own numbers.
    validate : sequence of path, optional
        Logs to judge by; without them the second half of each log.
    kinds : sequence of str, optional
        Estimators that are tried; by default `KINDS_TRIED`, of several axes linear and extended.
    free : sequence of str, optional
        What is identified; by default what a record usually tells.
    max_sensitivity : float, optional
        What the peak of abs(S) in the loop is to stay below [1], see `ambkit.tune`; by default the
        end of zone A of ISO 14839-3, None for no limit. A kind that cannot be held to it is tuned
        without.
    precision, prefix : str
        Of the exported C.
    anyway : bool
        Export also what is worse than the raw sensor, far from the bound, or out of zone A.
    seed, runs, budget : int
        Of all that is drawn; simulated runs and evaluations of each kind, see `ambkit.tune`.
    note : callable
        Told what is done next.

    Returns
    -------
    Design or MachineDesign
        What was chosen, and why.

    Raises
    ------
    AmbkitError
        A log cannot be read, a kind is unknown, no controller was found that holds the rotor, or
        the folder cannot be written.
    """
    of_type(Bearing, Machine, bearing=bearing)
    bearing = short_form(bearing)
    if isinstance(bearing, Machine):
        if free is not None:
            raise AmbkitError(
                f"what is identified is of one axis, and {bearing.name} has {len(bearing.axes)}: "
                "'ambkit identify --axis' does it first"
            )
        return design_machine(
            bearing, logs, folder, channels=channels, validate=validate, kinds=kinds,
            max_sensitivity=max_sensitivity, precision=precision, prefix=prefix, anyway=anyway,
            seed=seed, runs=runs, budget=budget, note=note,
        )  # fmt: skip
    if not logs:
        raise AmbkitError("a machine with one axis is designed from its logs: give at least one")
    kinds = KINDS_TRIED if kinds is None else names_in(kinds=kinds)
    for kind in kinds:
        kind_called(kind)
    place = files.make_folder(folder)
    stages = Stages(place)
    read = [*map(Path, logs), *map(Path, validate)]
    sources = [files.sha256(path) for path in read] + ([files.sha256(channels)] if channels else [])
    note("identifying")
    stages.make(
        "identify",
        [bearing.to_toml(), sorted(free or []), [p.name for p in read], *sources],
        ("found.toml", "identified.toml", "identified.json"),
        lambda: _identified(bearing, logs, channels, free, place),
    )
    identified = Estimator.load(place / "identified.toml")
    found, inputs = identified.bearing, identified.inputs
    if "adaptive" in kinds:
        note("training the expert")
        stages.make(
            "train", [found.to_toml()], ("expert.json",),
            lambda: train(found, weights=True).save(place / "expert.json"),
        )  # fmt: skip
    by_inputs = None if channels is None else ChannelMap.load(channels).with_inputs(inputs)
    records: list[Record] = []
    others: list[Record] = []
    candidates = []
    for kind in kinds:
        note(f"tuning the {kind} filter")
        name = f"candidates/{kind}.toml"

        def make(kind: str = kind, name: str = name) -> None:
            if not records:
                records.extend(load_filled(path, by_inputs) for path in logs)
                others.extend(load_filled(path, by_inputs) for path in validate)
            expert = place / "expert.json" if kind == "adaptive" else None
            magnet = None if expert is None else Expert.load(expert)

            tuned = tuned_within(
                max_sensitivity, found, records, kind, validate=others, inputs=inputs, seed=seed,
                magnet=magnet, runs=runs, budget=budget,
                source=", ".join(Path(path).name for path in logs),
            )  # fmt: skip
            files.make_folder(place / "candidates")
            tuned.save(place / name, bearing=place / "found.toml", magnet=expert)
            write_json(place / f"candidates/{kind}.json", of_tuning(tuned))

        made_from = [found.to_toml(), kind, seed, files.sha256(place / "identified.toml"), *sources]
        made_from.append(max_sensitivity)
        if kind == "adaptive":
            made_from.append(files.sha256(place / "expert.json"))
        stages.make(f"tune {kind}", made_from, (name, f"candidates/{kind}.json"), make)
        note(f"judging the {kind} filter")
        told = f"candidates/{kind}.judged.json"
        stages.make(
            f"judge {kind}", [files.sha256(place / name), seed, "under a load"], (told,),
            lambda name=name, told=told: write_json(  # type: ignore[misc]
                place / told, judged(place / name, seed)
            ),
        )  # fmt: skip
        candidates.append(candidate_in(place, kind))
    chosen = best_of(candidates)
    raw = read_json(place / f"candidates/{chosen.kind}.judged.json")["raw"]
    adequacy = tuple(adequacy_of(chosen))
    fatal = sentences([each for each in adequacy if each.fatal])
    objections = (*objections_to(chosen, raw), *fatal)
    notes = tuple(read_json(place / "identified.json")["notes"])
    notes += tuple(sentences([each for each in adequacy if not each.fatal]))
    why = why_fly(chosen, candidates, raw)
    Estimator.load(chosen.file).save(
        place / "filter.toml",
        bearing=place / "found.toml",
        magnet=place / "expert.json" if chosen.kind == "adaptive" else None,
    )
    exported = None
    if anyway or not objections:
        note("exporting")
        exported = exported_filter(found, place, precision, prefix)
    made = {name: what for name, what in FILES.items() if (place / name).exists()}
    note("drawing")
    record = records[-1] if records else load_filled(logs[-1], by_inputs)
    _report(place, found.name, why, (objections, notes), candidates, record, made)
    made["design.html"] = FILES["design.html"]
    return Design(
        place, tuple(candidates), chosen, raw, why, objections, exported, made, notes, adequacy
    )


FILES = {
    "found.toml": "the bearing, as the records tell it, with standard errors",
    "identified.toml": "the filter of what was identified, with the offsets of the log",
    "expert.json": "the fuzzy expert, trained from the bearing that was found",
    "candidates": "the filters that were tried, tuned, and their figures",
    "filter.toml": "the filter to fly",
    "c": "the same as C, for the controller",
    "design.html": "the report",
}


def _report(
    place: Path,
    name: str,
    why: str,
    said: tuple[Sequence[str], Sequence[str]],
    candidates: Sequence[Candidate],
    record: Record,
    made: Mapping[str, str],
) -> None:
    headers = [
        "log likelihood a sample",
        "mean NIS",
        "1 step ahead [µm]",
        "10 steps [µm]",
        "error of $x$ [µm]",
        "of $v$ [mm/s]",
        "of $F_{St}$ [N]",
        "bound over error of $x$",
        "peak of |S|",
    ]
    rows = {
        KINDS[c.kind].label: [
            -c.unseen[JUDGED["likelihood"]], c.unseen["nis"],
            1e6 * c.unseen[AHEAD[1]], 1e6 * c.unseen[AHEAD[10]],
            1e6 * c.errors["x"], 1e3 * c.errors["v"], c.errors["f_d"], c.efficiency, c.peak,
        ]
        for c in candidates
    }  # fmt: skip
    evaluated = {KINDS[c.kind].name: evaluate(Estimator.load(c.file), record) for c in candidates}
    write_design(
        place / "design.html", name, why, *said, rows, headers,
        filter_figure(record, evaluated), {**made, "design.html": FILES["design.html"]},
    )  # fmt: skip


def _identified(
    bearing: Bearing,
    logs: Sequence[str | os.PathLike[str]],
    channels: str | os.PathLike[str] | None,
    free: Sequence[str] | None,
    place: Path,
) -> None:
    records = [load_filled(path, channels) for path in logs]
    found = identify(bearing, records, free=free)
    inputs = Inputs() if channels is None else inputs_of(ChannelMap.load(channels))
    files.write_text(place / "found.toml", annotated_toml(found.likelihood, place))
    source = ", ".join(Path(path).name for path in logs)
    write_json(place / "identified.json", {"notes": found.of_the_zeros})
    identified_filter(found, inputs, source).save(
        place / "identified.toml", bearing=place / "found.toml"
    )
