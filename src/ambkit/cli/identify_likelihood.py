"""``ambkit identify RECORD...``: a bearing with its uncertainty, by maximum likelihood."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.cli import printing
from ambkit.cli.parameters import arguments_of_the_user
from ambkit.cli.plausibility import say_what_is_odd
from ambkit.cli.record_arguments import load_log

if TYPE_CHECKING:
    from ambkit.data.input_scaling import Inputs
    from ambkit.machine.machine import Machine


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
    for option, value in {
        "--validate": options.validate or None, "--save-force-map": options.force_map,
    }.items():  # fmt: skip
        if value is not None:
            raise AmbkitError(f"{option} is for one or two RECORDs, or --together")


def by_likelihood(options: Options, known: Machine) -> None:
    """Identify, validate, and deliver."""
    import os

    from ambkit.base import files
    from ambkit.data.reading import load
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.workflow.identified_toml import annotated_toml, carried_over
    from ambkit.workflow.identify import (
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
    free_names = None if options.free is None else options.free.replace(" ", "").split(",")
    free = parameters_to_find(start, free_names)
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
    records, others = (records_of(start, item) for item in (records, others))
    with arguments_of_the_user(), printing.progress("identifying") as done:
        result = identify(
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
    made = identified_filter(result, inputs, source)
    likelihood, forces = result.likelihood, result.forces
    printing.deliver_result(
        result,
        [
            (options.out, lambda path: files.write_text(path,
                                                          annotated_toml(likelihood, path.parent,
                                                                         result.machine))),
            (options.filter, lambda path: made.save(path, bearing=options.out)),
            (options.force_map, lambda path: None if forces is None else forces.save(path)),
        ],
        as_json=options.json,
        plot=options.plot,
        report=options.report,
        more={"adequacy": printing.say_adequacy(judge_adequacy(made))},
    )  # fmt: skip
    carried = carried_over(
        likelihood.model, delay=not likelihood.delay_counts, offsets=likelihood.offsets_count
    )
    if options.out is not None and any("[signals." in line for line in carried):
        printing.note(
            f"{options.out} says what to put into the channel map before filtering such a log"
        )
    if options.filter is not None and RAISED in made.origin.values():
        printing.note(
            f"noise.disturbance of {options.filter} is {made.variances.disturbance:.3g} N^2/s: the "
            f"records would have {likelihood.model.disturbance_noise:.3g} N^2/s, with which a "
            "disturbance force is followed too slowly"
        )


def _inputs(channel_map: Path) -> Inputs:
    """Return what the controller reads: the same numbers as the log has."""
    from ambkit.data.channel_map import ChannelMap, inputs_of

    return inputs_of(ChannelMap.load(channel_map))
