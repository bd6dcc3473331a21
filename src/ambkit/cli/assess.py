"""``ambkit assess``: stability margins of a loop, with the filter in it, linear or measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.assess_sweep import deliver_sweep
from ambkit.cli.kinds import NAMES, known
from ambkit.cli.loop_query import LoopQuery, read_query
from ambkit.cli.options import (
    ExpertFile,
    From,
    Json,
    MapFile,
    Plot,
    Synchronous,
    To,
    Verbose,
    file_option,
    quantity,
    read_quantities,
)

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.workflow.over_speed import OverSpeed


def assess(
    target: Annotated[
        str,
        typer.Argument(
            metavar="MACHINE|LOG",
            help="A preset's name, or a TOML file: of a machine or a filter. Or a record of a loop "
            "with an injected signal.",
        ),
    ],
    estimator: Annotated[
        str | None,
        typer.Option(
            "--estimator",
            "--filter",
            callback=lambda text: text if text in (None, "none") else known(text),
            metavar="NAMES",
            help="Whose estimate feeds the controller: none, or one or several of "
            f"{', '.join(NAMES)}; all; or filters' files (.toml).",
            show_default="the filter whose file is given, or linear",
        ),
    ] = None,
    expert: ExpertFile = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            "--scenario",
            "--controller",
            metavar="FILE.toml|NAME",
            help="Whose [controller], or [control] of several axes, is assessed; or decentralised, "
            "'translation and tilt' or lqg. Controller settings that the file omits are tuned "
            "automatically.",
        ),
    ] = None,
    synchronous: Synchronous = None,
    x: Annotated[
        float | None,
        typer.Option(
            "--position", parser=quantity("m"), metavar="LENGTH", help="Where the rotor is held."
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"), metavar="FORCE", help="Constant load there, on the first axis."
        ),
    ] = None,
    orbit: Annotated[
        str | None,
        typer.Option(
            metavar="own|LENGTH",
            help="Linearise along the orbit that the machine's own unbalance makes at its speed, "
            "or along one of this half axis, with the mean stiffnesses of a turn.",
        ),
    ] = None,
    lqg: Annotated[
        bool,
        typer.Option(
            "--lqg", help="Beside them, the linear-quadratic-Gaussian controller of least control."
        ),
    ] = False,
    hinf: Annotated[
        bool,
        typer.Option(
            "--hinf",
            help="Beside them, the H-infinity controller of mixed sensitivities, of a machine one "
            "an axis; it needs slycot (pip install ambkit[hinf]).",
        ),
    ] = False,
    amplitudes: Annotated[
        str | None,
        typer.Option(
            "--sweep",
            metavar="LENGTHS",
            help='Sweep the simulated loop too, with signals of these amplitudes: "1 um,20 um".',
        ),
    ] = None,
    stepped: Annotated[
        bool, typer.Option("--stepped-sine", help="Sweep by one sine after the other.")
    ] = False,
    axis: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Which axis is swept.",
            show_default="that which decides its zone",
        ),
    ] = None,
    fastest: Annotated[
        float | None,
        typer.Option(
            "--over-speed",
            parser=quantity("rad/s"),
            metavar="SPEED",
            help="Look at a machine's loop over its speed, up to there.",
        ),
    ] = None,
    bearing: Annotated[
        str | None,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="Of a log: the bearing or machine whose model is laid over, or a filter's file.",
        ),
    ] = None,
    channel_map: MapFile = None,
    before: Annotated[
        bool,
        typer.Option(
            "--logged-before",
            help="y of the log was taken before the signal was added to it, not after.",
        ),
    ] = False,
    begin: From = None,
    end: To = None,
    report: Annotated[
        Path | None,
        file_option(
            "Write the verdict on the loop as a page to be signed off: .html.",
            (".html",),
            "--report",
        ),
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Say how far the loop is from the limit of stability, with the filter in it.

    Sensitivity at the measurement as ISO 14839-3 looks at it, with its zones: of the linear loop as
    it is, sampled, with dead time, amplifier, sensor, controller and estimator, beside the same
    controller on the measurement; of the simulated one; or of a record in which a signal was added
    to the measurement, with its confidence. Of several axes each with all others closed, at the
    machine's speed, or over speed.

    For example:
      ambkit assess zittau_axial --estimator linear,observer --plot margins.png
      ambkit assess my.toml --filter filter.toml --sweep "1 um,20 um"
      ambkit assess tum_mlps --filter linear --report verdict.html
      ambkit assess injected.csv --bearing my.toml --plot measured.png
    """
    of_log = Path(target).suffix not in ("", ".toml")
    for_logs = {"--bearing": bearing, "--channels": channel_map, "--logged-before": before or None,
                "--from": begin, "--to": end}  # fmt: skip
    for option, given in for_logs.items():
        if given is not None and not of_log:
            raise AmbkitError(f"{option} is for records, and {target} is none")
    linear = {"--lqg": lqg, "--hinf": hinf, "--report": report, "--over-speed": fastest}
    for option, of_loop in linear.items():
        if of_loop and (of_log or amplitudes is not None):
            raise AmbkitError(f"{option} is of a machine's linear loop, without --sweep")
    if of_log and (amplitudes is not None or orbit is not None):
        option = "--orbit" if amplitudes is None else "--sweep"
        raise AmbkitError(f"{option} is of a machine's model, and {target} is a record")
    for option, swept in (("--stepped-sine", stepped), ("--axis", axis)):
        if swept and amplitudes is None:
            raise AmbkitError(f"{option} says how to --sweep: give its amplitudes")
    along = _along(orbit)
    if fastest is not None and not isinstance(along, bool):
        raise AmbkitError("--over-speed makes the orbit of each speed: give --orbit own")
    of_model = (estimator, expert, scenario, x, load)
    if of_log and bearing is None and any(given is not None for given in of_model):
        raise AmbkitError("--bearing says what controller and filter of the model are of")
    query = None
    if not of_log or bearing is not None:
        query = read_query(str(bearing) if of_log else target, estimator, expert, scenario,
                       synchronous or (), x, load)  # fmt: skip
    if query is None or of_log:
        from ambkit.cli.logs import load_log

        record = load_log(Path(target), channel_map, begin, end)
        _deliver_log(record, query, before, plot, json, verbose)
    elif amplitudes is not None:
        deliver_sweep(query, amplitudes, stepped, plot, json, axis=axis, orbit=along)
    elif fastest is not None and report is None:
        _deliver_over_speed(query, fastest, along, plot, json, verbose)
    else:
        _deliver_loops(query, fastest, plot, report, json, verbose, orbit=along, lqg=lqg, hinf=hinf)


def _along(orbit: str | None) -> bool | float:
    """Return whether a loop is linearised along its orbit, or of which half axis that is [m]."""
    if orbit in (None, "own"):
        return orbit is not None
    return read_quantities(str(orbit), "m", "--orbit", count=1)[0]


def _over_speed(query: LoopQuery, fastest: float | None, orbit: bool | float) -> OverSpeed:
    from ambkit.cli import output
    from ambkit.workflow.over_speed import assess_over_speed

    with output.progress("looking at one speed after the other"):
        return assess_over_speed(
            query.machine, query.filters, query.controller, fastest=fastest, load=query.load,
            orbit=orbit is True,
        )  # fmt: skip


def _deliver_over_speed(
    query: LoopQuery,
    fastest: float,
    orbit: bool | float,
    plot: Path | None,
    json: bool,
    verbose: bool,
) -> None:
    from ambkit.cli import output

    query.check_one("--over-speed")
    over = _over_speed(query, fastest, orbit)
    output.deliver_result(over, as_json=json, verbose=verbose, plot=plot)


def _deliver_loops(
    query: LoopQuery, fastest: float | None, plot: Path | None, report: Path | None, json: bool,
    verbose: bool, **options: Any,
) -> None:  # fmt: skip
    from ambkit.cli import output
    from ambkit.result.page import write_result
    from ambkit.workflow.assessing import assess as assessed

    over: list[OverSpeed] = []
    if report is not None:
        query.check_one("--report")
        if query.machine.rotor.type != "mass":
            over = [_over_speed(query, fastest, options["orbit"])]
    found = assessed(
        query.machine, query.filters, query.controller, x=query.x, load=query.load, **options
    )
    output.deliver_result(
        found,
        [(report, lambda path: write_result([found, *over], path, signed=True))],
        as_json=json,
        verbose=verbose,
        plot=plot,
    )


def _deliver_log(
    record: Record,
    query: LoopQuery | None,
    before: bool,
    plot: Path | None,
    json: bool,
    verbose: bool,
) -> None:
    from ambkit.cli import output
    from ambkit.workflow.assessing_log import assess_log

    model: dict[str, Any] = {}
    if query is not None:
        model = {"bearing": query.machine, "filter": query.filters, "controller": query.controller,
                 "x": query.x, "load": query.load}  # fmt: skip
    found = assess_log(record, logged="before" if before else "after", **model)
    output.deliver_result(found, as_json=json, verbose=verbose, plot=plot)
