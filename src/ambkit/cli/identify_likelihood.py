"""``ambkit identify RECORD...``: a bearing with its uncertainty, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.base.units import interval
from ambkit.cli import output
from ambkit.cli.belonging import check_belongs
from ambkit.cli.options import arguments_of_the_user
from ambkit.cli.output import value

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.identification.forces.map import ForceMap
    from ambkit.identification.maximum_likelihood.estimate import MaximumLikelihood
    from ambkit.identification.maximum_likelihood.validation import Validation
    from ambkit.machine.bearing import Bearing


@dataclass(frozen=True)
class Asked:
    """What the user asked for."""

    records: Sequence[Path]
    validate: Sequence[Path]
    rest: Path | None
    rest_map: Path | None
    channel_map: Path | None
    begin: float | None
    end: float | None
    free: str | None
    load_std: float | None
    out: Path | None
    force_map: Path | None
    force_map_nodes: tuple[int, int] | None
    report: Path | None
    plot: Path | None
    json: bool


def by_likelihood(asked: Asked, known: Bearing) -> None:
    """Identify, validate, and deliver."""
    import math
    import os

    from ambkit.identification.forces.map import force_map
    from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
    from ambkit.identification.maximum_likelihood.loop_model import LoopModel
    from ambkit.identification.maximum_likelihood.parameters import named, usual
    from ambkit.identification.maximum_likelihood.validation import validate
    from ambkit.show.pages.maximum_likelihood import (
        annotated_toml,
        carried_over,
        write_identification,
    )
    from ambkit.show.plots.maximum_likelihood import identified_figure

    rest = {} if asked.rest is None else _at_rest(asked.rest, asked.rest_map)
    if "variance" in rest.get("y", {}):
        known = known.replace(sensor__noise_variance=rest["y"]["variance"])
    start = LoopModel(known, load_std=math.nan if asked.load_std is None else asked.load_std)
    free = usual(start) if asked.free is None else tuple(asked.free.replace(" ", "").split(","))
    named(free)
    # Not Path.resolve, which raises where links go in a loop; reading the record says so.
    read = {os.path.realpath(path) for path in asked.records}
    same = read & {os.path.realpath(path) for path in asked.validate}
    if same:
        raise AmbkitError(
            f"{Path(next(iter(same))).name} is to be identified from and validated on: a model is "
            "judged on a record that it has not seen"
        )
    records = [_load(path, asked) for path in asked.records]
    others = [_load(path, asked) for path in asked.validate]
    for path, record in zip([*asked.records, *asked.validate], records + others, strict=True):
        check_belongs(path, record, known)
    with arguments_of_the_user(), output.progress("identifying") as done:
        found = maximum_likelihood(records, start, free, note=done)
        checks = [
            validate(
                found.model, record, start=found.start, settling=found.settling, name=path.name
            )
            for record, path in zip(others or records, asked.validate or asked.records, strict=True)
        ]
        mapped = None
        if asked.force_map is not None:
            mapped = force_map(
                found.model,
                records,
                nodes=asked.force_map_nodes,
                settling=found.settling,
                note=done,
            )
    data = found.to_dict() | {
        "bearing": known.name,
        "magnet_constant": found["magnet_constant"],
        "stiffness": _stiffness(found, records),
        "work_points": _work_points(found),
        "rest": rest,
        "validated_on_other_records": bool(others),
        "validation": [check.to_dict() for check in checks],
    }
    from ambkit.base import files
    from ambkit.show import plots

    shown = [*_rest_table(rest), *_tables(found, data["stiffness"], checks, bool(others))]
    if mapped is not None:
        data["force_map"] = {
            "nodes": mapped.force.shape[::-1],
            "written": int(mapped.told.sum()),
            "assumed": mapped.assumed,
        }
        shown.append(_map_said(mapped))
    output.deliver(
        data,
        shown,
        [
            (asked.out, lambda path: files.write_text(path, annotated_toml(found))),
            (asked.force_map, lambda path: None if mapped is None else mapped.save(path)),
            (asked.report, lambda path: write_identification(path, found, checks,
                                                             (others or records)[0])),
            (asked.plot, lambda path: plots.save_figure(identified_figure(found, checks), path)),
        ],
        as_json=asked.json,
    )  # fmt: skip
    carried = carried_over(found.model, delay=not found.delay_counts)
    if asked.out is not None and any("[signals." in line for line in carried):
        output.note(
            f"{asked.out} says what to put into the channel map before filtering such a log"
        )
    if not found.converged:
        output.note("the search did not end at a maximum: take a closer start, or free less")
    if not others:
        output.note("judged on what it was identified from: --validate OTHER.csv would tell more")


def _map_said(mapped: ForceMap) -> str:
    along, across = mapped.force.shape
    return (
        f"Force map: {across}x{along} nodes; the records tell of {int(mapped.told.sum())}, which "
        f"are written: there the force is known to less than half of the "
        f"{value(mapped.assumed, 'N', 3)} by which the law may be wrong."
    )


def _at_rest(path: Path, channel_map: Path | None) -> dict[str, dict[str, Any]]:
    """Noise of each signal of a record at rest, or why it cannot be seen."""
    from ambkit.base.errors import RecordError
    from ambkit.data.reading import load
    from ambkit.identification.noise import measurement_noise

    record = load(path, channel_map)
    found: dict[str, dict[str, Any]] = {}
    for name in record:
        try:
            noise = measurement_noise(record, name)
        except RecordError as error:
            found[name] = {"problem": str(error)}
            continue
        found[name] = {
            "variance": noise.variance,
            "standard_deviation": noise.standard_deviation,
            "unit": noise.unit,
            "samples": noise.samples,
            "colour": noise.colour,
            "correlation": list(noise.correlation),
        }
    return found


def _rest_table(rest: dict[str, dict[str, Any]]) -> list[Any]:
    rows = [
        [name, "–", noise["problem"]]
        if "problem" in noise
        else [name, f"{value(noise['standard_deviation'], noise['unit'])} rms", noise["colour"]]
        for name, noise in rest.items()
    ]
    return [output.table("At rest", ["", "noise", "colour"], rows, wide=True)] if rows else []


def _load(path: Path, asked: Asked) -> Record:
    from ambkit.data.reading import load

    record = load(path, asked.channel_map)
    if asked.begin is None and asked.end is None:
        return record
    return record.between(asked.begin, asked.end)


def _stiffness(found: MaximumLikelihood, records: Sequence[Record]) -> dict[str, Any]:
    """Stiffnesses about the mean of the records, where they tell most."""
    iu, x = found.model.mean_point(records)
    at = found.stiffness(iu, x)
    return {"current": iu, "displacement": x} | {
        name: {"value": v, "standard_error": e} for name, (v, e) in at.items()
    }


def _work_points(found: MaximumLikelihood) -> dict[str, Any]:
    """Stiffnesses at the paper's 25 work points, rows over the displacement."""
    from ambkit.machine.stiffness import work_points

    current, displacement = work_points(found.bearing)
    return {"current": current.tolist(), "displacement": displacement.tolist()} | {
        name: {"value": values.tolist(), "standard_error": errors.tolist()}
        for name, (values, errors) in found.stiffness_map(current, displacement).items()
    }


def _tables(
    found: MaximumLikelihood,
    stiffness: dict[str, Any],
    checks: Sequence[Validation],
    others: bool,
) -> list[Any]:
    rows = []
    for p in found.parameters:
        at = found[p.name]
        rows.append(
            [
                p.name.replace("_", " "),
                value(p.of(found.start), p.unit, like=at),
                value(at, p.unit),
                value(found.standard_error(p.name), p.unit, 2, like=at),
                interval(*found.interval(p.name), p.unit, 4, like=at),
            ]
        )
    where = f"{value(stiffness['current'], 'A', 2)}, {value(stiffness['displacement'], 'm', 2)}"
    for name, unit in (("k_i", "N/A"), ("k_s", "N/m")):
        tangent = stiffness[name]["value"]
        error = value(stiffness[name]["standard_error"], unit, 2, like=tangent)
        rows.append([f"{name} at {where}", "", value(tangent, unit), error, ""])
    shown = [
        output.table(
            f"{found.bearing.name}: identified from {found.samples} measurements",
            ["", "start", "found", "std. error", "95 % interval"],
            rows,
        )
    ]
    if found.held:
        held = [[name.replace("_", " "), why] for name, why in found.held.items()]
        shown.append(output.table("Not found", ["", ""], held, wide=True))
    close = [
        [
            f"{a.name} and {b.name}".replace("_", " "),
            f"correlation {found.correlation[i, j]:+.2f}: their combination is known better than "
            "each",
        ]
        for i, a in enumerate(found.parameters)
        for j, b in enumerate(found.parameters[:i])
        if abs(found.correlation[i, j]) > 0.9
    ]
    if close:
        shown.append(output.table("Known together", ["", ""], close, wide=True))
    where = "" if others else ", which it was identified from"
    return [*shown, *(f"{check.name}{where}: {check.verdict}" for check in checks)]
