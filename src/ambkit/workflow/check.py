"""Recognition and checking of files, and the presets."""

from __future__ import annotations

import os
import shutil
import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ambkit.base import files
from ambkit.base.config import toml_text
from ambkit.base.config.problems import fields_of
from ambkit.base.errors import AmbkitError, ConfigError, RecordError, shortened
from ambkit.base.units import engineering
from ambkit.data.channel_map import ChannelMap
from ambkit.data.files.tables import ENDINGS, read_log, read_table
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.registry import default_filter
from ambkit.machine import presets
from ambkit.machine.forces.force_points import COLUMNS, NAMES, ForceChannels, load_force_points
from ambkit.machine.loading import load_machine
from ambkit.machine.machine import Machine
from ambkit.machine.short_form import TABLES
from ambkit.models.plant_parts import in_words
from ambkit.result.result import Document
from ambkit.simulation.scenario import Scenario, by_axis

STUDIED = 2  #: Simulated runs on which the default filter of a machine is judged.
SHORT = {"map": "channel map", "force": "channels of a force map"}  #: Short names of kinds.


def load(
    path: str | os.PathLike[str], channel_map: ChannelMap | str | os.PathLike[str] | None = None
) -> Any:
    """Load a machine, a filter, an expert, a record, or any other file of ambkit.

    Parameters
    ----------
    path : path
        ``.toml`` is a machine, filter, scenario, study or channel map, depending on its keys;
        ``.json`` is an expert; everything else is a record with an even clock. `read` also accepts
        logs with defects.
    channel_map : ChannelMap or path, optional
        The meaning of the columns of a log: signal, unit, scale, sign and offset.

    Returns
    -------
    Machine, Estimator, Expert, Record, Scenario, Study or ChannelMap

    Raises
    ------
    ConfigError
        A TOML file is not valid; each problem names file and line.
    RecordError
        A log cannot be read, or its clock is not even.
    AmbkitError
        The file has an unknown type.
    """
    from ambkit.data.reading.reader import load as load_record
    from ambkit.fuzzy.expert import Expert

    match Path(path).suffix.lower():
        case ".toml":
            document = documents()[kind_of_toml(path)].load(path)
            return document.make() if hasattr(document, "make") else document
        case ".json":
            return Expert.load(path)
        case _:
            return load_record(path, channel_map)


def documents() -> dict[str, Any]:
    """Return the classes of the TOML files, by kind."""
    from ambkit.campaigns.study import Study
    from ambkit.machine.magnetostatics.drawing import Drawing

    return {
        "machine": Machine, "scenario": Scenario, "drawing": Drawing,
        "channel map": ChannelMap, "filter": FilterFile, SHORT["force"]: ForceChannels,
        "study": Study,
    }  # fmt: skip


def kind_of_toml(path: str | os.PathLike[str]) -> str:
    """Return the kind of document that shares most keys with a file."""
    toml = toml_text.parse(files.read_text(path))
    if toml.data is None:
        problems = [f"{path}:{line}: {what}" for line, what in toml.problems]
        raise ConfigError(shortened(problems), str(path))
    signals = toml.data.get("signals")
    if isinstance(signals, dict) and "f_mag" in signals and "t" not in signals:
        return SHORT["force"]
    keys = {kind: {*fields_of(model)} for kind, model in documents().items()}
    keys["machine"] |= {*TABLES[""]}
    shared = {kind: len(known & toml.data.keys()) for kind, known in keys.items()}
    best = max(shared, key=lambda kind: shared[kind])
    if shared[best] == 0:
        raise AmbkitError(
            f"{path}: is neither a machine, nor a drawing, nor a scenario, nor a study, nor a "
            "channel map, nor a filter: none of its keys is known in those "
            f"({', '.join(toml.data) or 'it is empty'})"
        )
    return best


@dataclass(frozen=True)
class Inspection:
    """The kind of a file, and its problems."""

    about: str  #: Summary of its content; empty if it is invalid.
    problems: tuple[str, ...] = ()  #: All errors, each with its place.
    remarks: tuple[str, ...] = ()  #: Anomalies of a record that may be legitimate.
    path: Path = Path()  #: The file.
    #: ``"machine"``, ``"scenario"``, ``"study"``, ``"filter"``, ``"channel map"``, ``"expert"``,
    #: ``"record"``, ``"lift-off points"``, ``"measured force"``; ``"file"`` if it is not
    #: recognised.
    kind: str = "file"

    @property
    def ok(self) -> bool:
        """Whether there are no problems."""
        return not self.problems


def schema_of(kind: str) -> dict[str, Any]:
    """Return the JSON schema of a TOML file, by `Inspection.kind` or its short form in `SHORT`."""
    return dict(documents()[SHORT.get(kind, kind)].json_schema())


def checked(
    paths: Sequence[str | os.PathLike[str]],
    channel_map: str | os.PathLike[str] | None = None,
    machine: Machine | None = None,
) -> Document:
    """Check files, and report the kind and all problems of each."""
    results = [inspect(path, channel_map, machine) for path in paths]
    data = [
        {"file": str(item.path), "kind": item.kind, "ok": item.ok, "about": item.about,
         "problems": list(item.problems), "remarks": list(item.remarks)}
        for item in results
    ]  # fmt: skip
    lines = [f"{item.path}: ok, {item.kind}: {item.about}\n" for item in results if item.ok]
    notes = [
        text
        for item in results
        for text in (*item.problems, *(f"{item.path}: note: {remark}" for remark in item.remarks))
    ]
    return Document("".join(lines), data, notes, 0 if all(item.ok for item in results) else 2)


def inspect(
    path: str | os.PathLike[str],
    channel_map: str | os.PathLike[str] | None = None,
    machine: Machine | None = None,
) -> Inspection:
    """Recognise a file by its content and check it; the name of a preset stands for its file."""
    path = presets.path(str(path)) if str(path) in presets.names() else Path(path)
    kind = "file"
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise AmbkitError(f"{path}: is no file but a device or a pipe, which may never end")
        kind, describe = _recognise(path, channel_map, machine)
        return replace(describe(path), path=path, kind=kind)
    except AmbkitError as error:
        return Inspection("", getattr(error, "problems", (str(error),)), (), path, kind)


def _recognise(
    path: Path, channel_map: str | os.PathLike[str] | None, machine: Machine | None
) -> tuple[str, Callable[[Path], Inspection]]:
    match path.suffix.lower():
        case ".toml":
            kind = kind_of_toml(path)
            return kind, lambda p: _describe_document(kind, p, machine)
        case ".json":
            return "expert", _describe_expert
        case ".csv" | ".parquet" if channel_map is None:
            return _kind_of_table(path, machine)
        case ending if ending in ENDINGS:
            if channel_map is not None and kind_of_toml(Path(channel_map)) == SHORT["force"]:
                return "measured force", lambda p: _describe_force(p, channel_map)
            return "record", lambda p: _describe_record(p, channel_map, machine)
        case _:
            return "file", _unknown


def _unknown(path: Path) -> Inspection:
    if not path.exists():
        load_machine(path)  # raises, and lists the presets
    known = f".toml, .json, {', '.join(ENDINGS[:-1])} and {ENDINGS[-1]}"
    raise AmbkitError(f"{path}: unknown kind of file; known: {known}")


def _describe_document(kind: str, path: Path, machine: Machine | None) -> Inspection:
    from ambkit.campaigns.plan import Plan
    from ambkit.judge.adequacy import judge_adequacy, sentences
    from ambkit.judge.adequacy_criteria import of_machine
    from ambkit.judge.contact import stop_notes
    from ambkit.rotordynamics import machine_report

    result = documents()[kind].load(path)
    if kind in SHORT.values():
        return Inspection(f"signals {', '.join(result.signals)}")
    if kind == "drawing":
        result.check(str(path))
        return Inspection(f"{result.name}, {result.geometry.type}")
    if kind == "filter":
        made = result.make()  # building it reveals errors of starts, options and the magnet's file
        judged = judge_adequacy(made, machine)
        fatal = sentences([item for item in judged if item.fatal])
        others = [text for text in sentences(judged) if text not in fatal]
        others += stop_notes(result.plant, made.name)
        problems = tuple(
            f"{path}: not exported, the filter is inadequate: {text}" for text in fatal
        )
        return Inspection(f"{result.kind}, for {result.plant.name}", problems, tuple(others))
    if kind == "machine" and not result.single:
        about, remarks = machine_report.described(result)
        lines = toml_text.parse(files.read_text(path))
        notes = (
            f"line {lines.line(remark.path)}: {remark.text}" if remark.path else remark.text
            for remark in remarks
        )
        row, objections = _default_filter(result)
        implausible = sentences(list(of_machine(result)))
        return Inspection(f"{about}; {row}", (), (*notes, *implausible, *objections))
    if kind == "study":
        plan = Plan(result)
        plan.check()
        of, varies = f"{plan.runs} machines of {plan.nominal.name}", ", ".join(plan.names)
        return Inspection(f"{of}, {result.sampling}; what varies: {varies or 'nothing'}")
    if kind == "scenario":
        return Inspection(f"{engineering(result.duration, 's')}, {_of_signals(result)}")
    mass = engineering(result.rotor.mass, "kg")
    parts = [f"{result.name}, {result.magnet.type}, {mass}", *in_words(result)]
    row, objections = _default_filter(result)
    adequacy = sentences(judge_adequacy(default_filter(result)))
    return Inspection("; ".join([*parts, row]), (), (*adequacy, *objections))


def _default_filter(machine: Machine) -> tuple[str, tuple[str, ...]]:
    """Return the performance of the default filter in simulation, and objections to it."""
    from ambkit.judge.comparison.default_study import score_defaults

    try:
        score = score_defaults(machine, runs=STUDIED)
    except AmbkitError as error:
        return "default filter not judged", (f"the default filter is not judged: {error}",)
    return f"default filter {score.row()}", tuple(score.objections())


def _of_signals(scenario: Any) -> str:
    """Return the types of a scenario's signals."""
    descriptions = [
        f"{what} {item.type} {axis}".strip()
        for what in ("reference", "disturbance") for axis, item in by_axis(scenario, what, "")
    ]  # fmt: skip
    speed = [] if scenario.speed is None else [f"speed {scenario.speed.type}"]
    return ", ".join([*descriptions, *speed]) or "nothing demanded"


def _describe_expert(path: Path) -> Inspection:
    from ambkit.fuzzy.expert import Expert

    expert = Expert.load(path)
    return Inspection(f"{len(expert.rules)} rules for {expert.source}")


def _kind_of_table(path: Path, machine: Machine | None) -> tuple[str, Callable[[Path], Inspection]]:
    from ambkit.identification.forces import lift_off

    try:
        columns = set(read_table(path).columns)
    except RecordError as error:
        raise RecordError([*error.problems, *_perhaps_a_force(path)]) from None
    if "t" not in columns and columns >= set(lift_off.COLUMNS):
        return "lift-off points", _describe_points
    if "t" not in columns and columns >= set(COLUMNS):
        return "measured force", _describe_force
    if "t" not in columns and (hint := _perhaps_a_force(path)):
        raise RecordError([f"{path}: has no column t [s]; it has {', '.join(columns)}", *hint])
    return "record", lambda p: _describe_record(p, None, machine)


def _perhaps_a_force(path: Path) -> list[str]:
    """Suggest the measured-force format for a table of three or four columns without time."""
    import numpy as np

    try:
        columns = read_log(path).arrays
    except RecordError:
        return []
    runs_on = any(np.all(np.diff(values) > 0) for values in columns.values())
    if runs_on or not 3 <= len(columns) <= 4:
        return []
    return [f"{path}: {NAMES}"]


def _describe_points(path: Path) -> Inspection:
    from ambkit.identification.forces.lift_off import load_points

    points = load_points(path)
    usable = sum(not p.problem for p in points)
    return Inspection(f"{len(points)} runs, {usable} of them usable")


def _describe_force(path: Path, channels: str | os.PathLike[str] | None = None) -> Inspection:
    points = load_force_points(path, channels)
    (low, high), (left, right) = (
        [engineering(end, unit, digits=3) for end in (values.min(), values.max())]
        for values, unit in ((points.current, "A"), (points.displacement, "m"))
    )
    known = "" if points.standard_error is not None else ", without standard errors"
    return Inspection(f"{len(points)} points, {low} to {high}, {left} to {right}{known}")


def _lost(missing: Mapping[str, int]) -> str:
    """Return the number of missing samples per signal, as one number if it is the same for all."""
    counts = set(missing.values())
    if len(counts) == 1 and len(missing) > 1:
        (count,) = counts
        return f", {count} missing in each signal" if count else ""
    signal_counts = ", ".join(f"{count} of {name}" for name, count in missing.items() if count)
    return f", missing {signal_counts}" if signal_counts else ""


def _describe_record(
    path: Path, channel_map: str | os.PathLike[str] | None, machine: Machine | None
) -> Inspection:
    import numpy as np

    from ambkit.data.reading import load
    from ambkit.data.reading.faults import account, find
    from ambkit.data.reading.plausibility import suspects
    from ambkit.judge.plausibility import evaluate_record

    record = load(path, channel_map)
    kinds = {name.partition("_")[0] for name in record}  # of several axes with their names
    lacking = [name for name in ("y", "u") if name not in kinds]
    unfit = f"; without {' and '.join(lacking)}, so nothing to filter" if lacking else ""
    lost = _lost({name: int(np.isnan(record[name]).sum()) for name in record})
    about = (
        f"{len(record)} samples of {', '.join(record)} every "
        f"{engineering(record.sampling_time, 's')}{lost}{unfit}"
    )
    measured = [name for name in ("y", "u") if name in record]
    faults = [
        fault
        for name in measured
        for fault in find(name, record[name], record.t, record.units[name])
        if fault.kind != "missing"
    ]
    remarks = account(faults, record.sampling_time)
    if machine is None:
        return Inspection(about, (), (*remarks, *suspects(record.t, record.signals, record.units)))
    verdict = evaluate_record(record, machine)
    return Inspection(
        about, tuple(f"{path}: {p}" for p in verdict.problems), (*remarks, *verdict.remarks)
    )


def preset_listing() -> Document:
    """Return the names of all presets, each with a description."""
    machines = map(Machine.preset, presets.names())
    data: list[dict[str, Any]] = [
        {"name": item.name, "description": item.description, "source": item.source,
         "axes": item.axis_names}
        for item in machines
    ]  # fmt: skip
    column = max(len(item["name"]) for item in data) + 2
    columns = min(shutil.get_terminal_size().columns, 100)
    lines = (
        textwrap.fill(item["description"], columns, initial_indent=item["name"].ljust(column),
                      subsequent_indent=" " * column)
        for item in data
    )  # fmt: skip
    return Document("".join(f"{line}\n" for line in lines), data)


def preset_document(name: str) -> Document:
    """Return a preset as TOML, and as data."""
    toml, machine = presets.text(name), Machine.preset(name)
    return Document(toml, {"name": name, "machine": machine.model_dump(), "toml": toml})
