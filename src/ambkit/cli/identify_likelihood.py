"""``ambkit identify RECORD...``: a bearing with its uncertainty, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.base.units import interval
from ambkit.cli import output
from ambkit.cli.belonging import say_what_is_odd
from ambkit.cli.logs import load_log
from ambkit.cli.options import arguments_of_the_user
from ambkit.cli.output import value

if TYPE_CHECKING:
    from ambkit.data.rig_units import Inputs
    from ambkit.identification.forces.map import ForceMap
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine
    from ambkit.workflow.identifying import Identified


@dataclass(frozen=True)
class Options:
    """What the user asked for."""

    axis: str | None
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
    filter: Path | None
    force_map: Path | None
    force_map_nodes: tuple[int, int] | None
    report: Path | None
    plot: Path | None
    json: bool


def refuse_parts(options: Options) -> None:
    """Refuse what is not for many logs, which are judged by each other."""
    for option, given in {
        "--validate": options.validate or None, "--save-force-map": options.force_map,
    }.items():  # fmt: skip
        if given is not None:
            raise AmbkitError(f"{option} is for one or two RECORDs, or --together")


def by_likelihood(options: Options, known: Bearing | Machine) -> None:
    """Identify, validate, and deliver."""
    import os

    from ambkit.base import files
    from ambkit.data.reading import load
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.show import plots
    from ambkit.show.pages.maximum_likelihood import (
        annotated_toml,
        carried_over,
        write_identification,
    )
    from ambkit.show.plots.maximum_likelihood import identified_figure
    from ambkit.workflow.identifying import (
        RAISED,
        identified_filter,
        identify,
        noise_at_rest,
        parameters_to_find,
        records_of,
        starting_model,
    )

    rest = {} if options.rest is None else noise_at_rest(load(options.rest, options.rest_map))
    start = starting_model(known, options.axis, rest=rest, load_std=options.load_std)
    given = None if options.free is None else options.free.replace(" ", "").split(",")
    free = parameters_to_find(start, given)
    # Not Path.resolve, which raises where links go in a loop; reading the record says so.
    read = {os.path.realpath(path) for path in options.records}
    same = read & {os.path.realpath(path) for path in options.validate}
    if same:
        raise AmbkitError(
            f"{Path(next(iter(same))).name} is to be identified from and validated on: a model is "
            "judged on a record that it has not seen"
        )
    records, others = (
        [load_log(path, options.channel_map, options.begin, options.end) for path in paths]
        for paths in (options.records, options.validate)
    )
    for path, record in zip([*options.records, *options.validate], records + others, strict=True):
        say_what_is_odd(path, record, known)
    records, others = (records_of(start, each) for each in (records, others))
    with arguments_of_the_user(), output.progress("identifying") as done:
        found = identify(
            known,
            records,
            options.axis,
            others=others,
            names=[path.name for path in options.validate or options.records],
            rest=rest,
            free=free,
            load_std=options.load_std,
            map_forces=options.force_map is not None,
            nodes=options.force_map_nodes,
            note=done,
        )
    inputs = None if options.channel_map is None else _inputs(options.channel_map)
    source = ", ".join(record.name for record in options.records)
    made = identified_filter(found, inputs, source)
    likelihood, checks, forces = found.likelihood, found.validation, found.forces
    data = found.to_dict()
    data["adequacy"] = output.say_adequacy(judge_adequacy(made))
    shown = [*_rest_table(data["rest"]), *_tables(found)]
    if forces is not None:
        shown.append(_map_said(forces))
    output.deliver(
        data,
        shown,
        [
            (options.out, lambda path: files.write_text(path,
                                                          annotated_toml(likelihood, path.parent,
                                                                         found.machine))),
            (options.filter, lambda path: made.save(path, bearing=options.out)),
            (options.force_map, lambda path: None if forces is None else forces.save(path)),
            (options.report, lambda path: write_identification(path, likelihood, checks,
                                                             (others or records)[0])),
            (options.plot, lambda path: plots.save_figure(identified_figure(likelihood, checks),
                                                        path)),
        ],
        as_json=options.json,
    )  # fmt: skip
    carried = carried_over(
        likelihood.model, delay=not likelihood.delay_counts, offsets=likelihood.offsets_count
    )
    if options.out is not None and any("[signals." in line for line in carried):
        output.note(
            f"{options.out} says what to put into the channel map before filtering such a log"
        )
    if options.filter is not None and RAISED in made.origin.values():
        output.note(
            f"noise.disturbance of {options.filter} is {made.variances.disturbance:.3g} N^2/s: the "
            f"records would have {likelihood.model.load_growth:.3g} N^2/s, with which a load is "
            "followed too slowly"
        )
    for said in (*found.of_the_zeros, *likelihood.touched, *likelihood.remarks):
        output.note(said)
    if not likelihood.converged:
        output.note("the search did not end at a maximum: take a closer start, or free less")
    if not others:
        output.note("judged on what it was identified from: --validate OTHER.csv would tell more")


def _inputs(channel_map: Path) -> Inputs:
    """Return what the controller reads: the same numbers as the log has."""
    from ambkit.data.channelmap import ChannelMap, inputs_of

    return inputs_of(ChannelMap.load(channel_map))


def _map_said(mapped: ForceMap) -> str:
    along, across = mapped.force.shape
    return (
        f"Force map: {across}x{along} nodes; the records tell of {int(mapped.observed.sum())}, "
        f"which are written: there the force is known to less than half of the "
        f"{value(mapped.assumed, 'N', 3)} by which the law may be wrong."
    )


def _rest_table(rest: dict[str, dict[str, Any]]) -> list[Any]:
    rows = [
        [name, "–", noise["problem"]]
        if "problem" in noise
        else [name, f"{value(noise['standard_deviation'], noise['unit'])} rms", noise["colour"]]
        for name, noise in rest.items()
    ]
    return [output.table("At rest", ["", "noise", "colour"], rows, wide=True)] if rows else []


def _tables(identified: Identified) -> list[Any]:
    found, stiffness = identified.likelihood, identified.stiffness
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
    shown: list[Any] = [
        output.table(
            f"{found.bearing.name}: identified from {found.samples} measurements",
            ["", "start", "found", "std. error", "95 % interval"],
            rows,
        )
    ]
    known = [
        [
            p.name.replace("_", " "),
            f"{value(found.model.known[p.name][0], p.unit)} ± "
            f"{value(found.model.known[p.name][1], p.unit, 2)}: the records tell "
            f"{100 * found.told[i]:.0f} % of what the found value rests on",
        ]
        for i, p in enumerate(found.parameters)
        if p.name in found.model.known
    ]
    if known:
        shown.append(output.table("Taken to be known beforehand", ["", ""], known, wide=True))
    if found.profiles:
        names = ", ".join(found.profiles).replace("_", " ")
        shown.append(
            f"Not near to quadratic over {names}: intervals by the profile of the likelihood, "
            "1.96 standard errors would mislead."
        )
    shown += [
        f"A line at {value(line.frequency, 'Hz')} in the position, of "
        f"{value(line.amplitude, 'm', 2)}: taken in as an oscillator of the sensor, which filters "
        "of the bearing carry."
        for line in found.lines
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
    where = "" if identified.on_others else ", which it was identified from"
    return [*shown, *(f"{c.name}{where}: {c.verdict}" for c in identified.validation)]
