"""``ambkit identify``: a bearing, from records of the loop or from lift-off points."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import (
    CONSTANT,
    AxisName,
    From,
    Json,
    MapFile,
    Plot,
    To,
    file_option,
    find_machine,
    isolated,
    quantity,
)


class Method(StrEnum):
    """How a record is learned from."""

    likelihood = "likelihood"
    adaline = "adaline"
    rls = "rls"
    augmented = "augmented"
    online = "online"


def identify(
    bearing: Annotated[
        str,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="What is known already: a preset's name, or a TOML file.",
        ),
    ],
    record: Annotated[
        list[Path] | None,
        typer.Argument(metavar="RECORD", help="Runs in closed loop: .csv, .parquet or .mat."),
    ] = None,
    channel_map: MapFile = None,
    method: Annotated[
        Method | None,
        typer.Option(
            help="Maximum likelihood, for all parameters with their errors; or the magnet constant "
            "as a controller would learn it, by ADALINE, recursive least squares, or the extended "
            "Kalman filter with k. These show the others beside them; online shows all three and "
            "prefers none.",
            show_default="likelihood; adaline with --start or --disturbance",
        ),
    ] = None,
    free: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What to look for: magnet_constant or mass, air_gap, sensor_lag, delay, "
            "current_lag, position_offset, current_offset, sensor_gain, amplifier_gain, "
            "measurement_noise, position_noise, control_noise, disturbance_noise.",
            show_default="what a record usually tells",
        ),
    ] = None,
    load_std: Annotated[
        float | None,
        typer.Option(
            "--load-at-start",
            parser=quantity("N"),
            metavar="FORCE",
            help="How far from zero the load may be at the start of a record. Default: the weight.",
        ),
    ] = None,
    rest: Annotated[
        Path | None,
        typer.Option(metavar="RECORD", help="A record at rest: noise and its colour, each signal."),
    ] = None,
    rest_map: Annotated[
        Path | None,
        typer.Option(
            "--rest-channels",
            metavar="MAP.toml",
            help="Channel map of --rest.",
            show_default="that of the records, --channels",
        ),
    ] = None,
    axis: AxisName = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(metavar="RECORD", help="Judge the result on this record; again for more."),
    ] = None,
    together: Annotated[
        bool,
        typer.Option(
            "--together",
            help="Three RECORDs or more: take them for one sample. Else each is identified alone, "
            "they are pooled with a scatter between them, and each is judged by the others.",
        ),
    ] = False,
    begin: From = None,
    end: To = None,
    start: Annotated[
        float | None,
        typer.Option(
            parser=quantity(CONSTANT),
            metavar="CONSTANT",
            help="Learning: magnet constant to start from, if not the bearing's.",
        ),
    ] = None,
    disturbance: Annotated[
        str | None,
        typer.Option(
            metavar="FORCE",
            help='Learning: load that is known, "3 N", or a signal of the record, f_d.',
        ),
    ] = None,
    lift_off: Annotated[
        Path | None,
        typer.Option(
            metavar="POINTS.csv", help="Fit the law to lift-off points, instead of a RECORD."
        ),
    ] = None,
    lifting_off: Annotated[
        bool,
        typer.Option(
            "--lifting-off",
            help="The RECORDs are of a rotor that lifts off, one each, as the current rises; "
            "--channels names distance z and coil current i.",
        ),
    ] = False,
    coil: Annotated[
        bool,
        typer.Option(
            "--coil",
            help="The RECORDs are of a coil whose control signal steps, the rotor held; --channels "
            "names control u, coil current i and distance z.",
        ),
    ] = False,
    gap_range: Annotated[
        str | None,
        typer.Option(metavar="FROM,TO", help='Of lift-off points, fit those within: "4 mm,16 mm".'),
    ] = None,
    operating_point: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="LENGTH",
            help="With lift-off points: distance at x = 0; gives air gap and bias current. With "
            "--coil the lag there.",
        ),
    ] = None,
    out: Annotated[
        Path | None, file_option("Write the bearing that was found.", (".toml",), "--out")
    ] = None,
    filter_file: Annotated[
        Path | None,
        file_option(
            "Write the extended filter of what was found, with the log's offsets, for filter, "
            "simulate, compare and export.",
            (".toml",),
            "--save-filter",
        ),
    ] = None,
    force_map: Annotated[
        Path | None,
        file_option(
            "Write the force at nodes of a grid, as far as the records tell, for "
            "'ambkit train --force-map'.",
            (".csv", ".parquet"),
            "--save-force-map",
        ),
    ] = None,
    force_map_nodes: Annotated[
        str | None,
        typer.Option(
            metavar="NxM",
            help="Nodes of --save-force-map along current and displacement.",
            show_default="5x5 to 9x9, as the records fill them",
        ),
    ] = None,
    report: Annotated[
        Path | None, file_option("Write a report with pictures.", (".html",), "--report")
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Identify the parameters of a machine, with their standard errors.

    From records of the closed loop, or from the points at which a rotor lifts off. What a record
    cannot tell is named, and stays as it was.

    For example:
      ambkit identify run.csv --bearing my.toml --out found.toml --save-filter filter.toml
      ambkit identify logs/*.mat --channels rig.toml --bearing my.toml --report rig.html
      ambkit identify run.csv --bearing my.toml --method online --plot online.png
      ambkit identify --lift-off points.csv --bearing inteco_ml --operating-point "10 mm"
      ambkit identify --coil steps/*.mat --channels coil.toml --bearing inteco_ml
    """
    from ambkit.cli.identify_corpus import LEAST, by_corpus
    from ambkit.cli.identify_lift_off import by_lift_off
    from ambkit.cli.identify_likelihood import Options, by_likelihood
    from ambkit.cli.identify_online import learn_online
    from ambkit.cli.plausibility import say_what_is_odd
    from ambkit.cli.record_arguments import load_log

    if coil:
        _for_a_coil(
            record,
            {
                "--lift-off": lift_off, "--lifting-off": lifting_off or None,
                "--gap-range": gap_range, "--method": method, "--free": free,
                "--load-at-start": load_std, "--rest": rest, "--validate": validate or None,
                "--start": start, "--disturbance": disturbance, "--save-filter": filter_file,
                "--save-force-map": force_map, "--report": report,
            },
        )  # fmt: skip
        from ambkit.cli.identify_coil import by_coil

        by_coil(record or [], channel_map, begin, end, isolated(find_machine(bearing), axis),
                operating_point, out, plot, json)  # fmt: skip
        return
    if bool(record) == (lift_off is not None):
        raise AmbkitError("give either a RECORD or --lift-off POINTS.csv")
    if lifting_off and not record:
        raise AmbkitError("--lifting-off needs RECORDs of a rotor that lifts off")
    online = {"--start": start, "--disturbance": disturbance}
    for_likelihood = {
        "--free": free, "--load-at-start": load_std, "--validate": validate or None,
        "--save-filter": filter_file, "--rest": rest, "--rest-channels": rest_map,
        "--report": report, "--save-force-map": force_map,
        "--force-map-nodes": force_map_nodes,
    }  # fmt: skip
    chosen = method
    if method is None:
        online_only = record and any(value is not None for value in online.values())
        method = Method.adaline if online_only else Method.likelihood
    if record:
        others = online if method is Method.likelihood else for_likelihood
        for option, value in others.items():
            if value is not None:
                other = "adaline" if method is Method.likelihood else "likelihood"
                raise AmbkitError(f"{option} is for --method {other}")
    if rest_map is not None and rest is None:
        raise AmbkitError("--rest-channels needs --rest RECORD")
    if force_map_nodes is not None and force_map is None:
        raise AmbkitError("--force-map-nodes needs --save-force-map FILE")
    if start is not None and not start > 0:
        raise AmbkitError(f"--start must be greater than 0, is {start:g} {CONSTANT}")
    for_points = {"--gap-range": gap_range, "--operating-point": operating_point}
    for_a_record = {"--from": begin, "--to": end, "--method": chosen} | online | for_likelihood
    for_a_log = {} if lifting_off else {"--channels": channel_map}
    of_the_loop = record and not lifting_off
    for option, value in (for_points if of_the_loop else for_a_record | for_a_log).items():
        if value is not None:
            what = "--lift-off" if of_the_loop else "a RECORD of the loop"
            raise AmbkitError(f"{option} is for {what}")
    plant = find_machine(bearing)
    known = isolated(plant, axis)
    if not of_the_loop:
        points = [lift_off] if lift_off is not None else record or []
        by_lift_off(points, lifting_off, channel_map, known, gap_range, operating_point, out, plot,
                    json)  # fmt: skip
        return
    assert record
    if method is Method.likelihood:
        options = Options(
            axis, record, validate or [], rest, rest_map or channel_map, channel_map, begin, end,
            free, load_std, out, filter_file, force_map, _nodes(force_map_nodes), report, plot,
            json,
        )  # fmt: skip
        if len(record) < LEAST or together:
            by_likelihood(options, plant)
        elif known is plant:
            by_corpus(options, known)
        else:
            raise AmbkitError(
                f"logs of a machine with several axes are identified from --together, {len(record)}"
                " are given"
            )
        return
    if known is not plant:
        raise AmbkitError(
            f"--method {method} learns of a machine with one axis: {plant.name} has several, whose "
            "forces it would take for the disturbance force of this one"
        )
    if len(record) > 1:
        raise AmbkitError(f"--method {method} learns along one record, {len(record)} are given")
    log = load_log(record[0], channel_map, begin, end)
    say_what_is_odd(record[0], log, known)
    learn_online(log, known, method, start, disturbance, out, plot, json)


def _for_a_coil(record: list[Path] | None, others: dict[str, object]) -> None:
    """Refuse what is not asked of a coil's logs."""
    if not record:
        raise AmbkitError("--coil needs RECORDs of a coil whose control signal steps")
    for option, value in others.items():
        if value is not None:
            raise AmbkitError(f"{option} is not for --coil")


def _nodes(text: str | None) -> tuple[int, int] | None:
    """Nodes along current and displacement, from ``"9x7"``, or ``"9"`` for both."""
    if text is None:
        return None
    sides = text.lower().split("x")
    if len(sides) > 2 or not all(side.isdecimal() and 4 <= int(side) <= 33 for side in sides):
        raise typer.BadParameter(
            f"must be nodes along current and displacement such as 9x7, 4 to 33 each, is {text!r}",
            param_hint="--force-map-nodes",
        )
    return int(sides[0]), int(sides[-1])
