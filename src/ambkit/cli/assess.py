"""``ambkit assess``: stability margins of a loop, with the filter in it, linear or measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.assess_machine import assess_machine
from ambkit.cli.assess_sweep import deliver_sweep
from ambkit.cli.assess_tables import said, tables, tables_of_shares, tables_of_unstable
from ambkit.cli.kinds import NAMES, is_filter, known, machine_of, names
from ambkit.cli.options import (
    ExpertFile,
    From,
    Json,
    MapFile,
    Plot,
    Synchronous,
    To,
    file_option,
    find_bearing,
    find_machine,
    quantity,
    read_quantities,
    refuse_of_one_axis,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine
    from ambkit.simulation.scenario import PID
    from ambkit.workflow.assessing_log import AssessedLog


def assess(
    target: Annotated[
        str,
        typer.Argument(
            metavar="BEARING|MACHINE|LOG",
            help="A preset's name, or a TOML file: of a bearing, a whole machine, or a filter. Or "
            "a record of a loop with an injected signal.",
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
            help="Whose [controller] is assessed; what it does not say, all of it without one, is "
            "tuned for the bearing. Of a whole machine also a flight, whose [control] it is, or "
            "decentralised, 'translation and tilt' or lqg.",
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
        typer.Option(parser=quantity("N"), metavar="FORCE", help="Constant load there."),
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
            help="Of a machine, which axis is swept.",
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
    json: Json = False,
) -> None:
    """Say how far the loop is from the limit of stability, with the filter in it.

    Sensitivity at the measurement as ISO 14839-3 looks at it, with its zones: of the linear loop as
    it is, sampled, with dead time, amplifier, sensor, controller and estimator, beside the same
    controller on the measurement; of the simulated one; or of a record in which a signal was added
    to the measurement, with its confidence. Of a whole machine each axis with all others closed, at
    its speed, or over speed.

    For example:
      ambkit assess zittau_axial --estimator linear,observer --plot margins.png
      ambkit assess my.toml --filter filter.toml --sweep "1 um,20 um"
      ambkit assess tum_mlps --filter linear --report verdict.html
      ambkit assess injected.csv --bearing my.toml --plot measured.png
    """
    from ambkit.simulation.scenario import Scenario

    whole = find_machine(target)
    if whole is None and (whole := machine_of(target)) is not None:
        if estimator is not None:
            raise AmbkitError(f"{target} is a filter already: leave out --estimator")
        estimator = target
    controller: PID | None = None
    if whole is None and scenario is not None:
        controller = Scenario.load(scenario).controller
    of_log = Path(target).suffix not in ("", ".toml")
    for_logs = {"--bearing": bearing, "--channels": channel_map, "--logged-before": before or None,
                "--from": begin, "--to": end}  # fmt: skip
    for option, given in for_logs.items():
        if given is not None and not of_log:
            raise AmbkitError(f"{option} is for records, and {target} is none")
    if of_log and amplitudes is not None:
        raise AmbkitError("--sweep is for bearings, not for records")
    for option, beside in (("--lqg", lqg), ("--hinf", hinf)):
        if beside and (of_log or amplitudes is not None):
            raise AmbkitError(f"{option} is of a bearing's linear loop, without --sweep")
    if report is not None and (of_log or amplitudes is not None):
        raise AmbkitError("--report is of a bearing's linear loop, without --sweep")
    if orbit is not None and of_log:
        raise AmbkitError("--orbit is of a model, and a record has its own")
    along = _along(orbit)
    if stepped and amplitudes is None:
        raise AmbkitError("--stepped-sine says how to --sweep: give its amplitudes")
    of_model = (estimator, expert, scenario, x, load)
    if of_log and bearing is None and any(given is not None for given in of_model):
        raise AmbkitError("--bearing says what controller and filter of the model are of")
    if of_log:
        from ambkit.cli.logs import load_log

        record = load_log(Path(target), channel_map, begin, end)
        _deliver_log(record, bearing, estimator, expert, controller, before, x, load, plot, json)
        return
    if whole is not None:
        assess_machine(
            whole, estimator, scenario, synchronous or (), (lqg, hinf), amplitudes, stepped, axis,
            fastest, along, report, plot, json, {"expert": expert, "position": x, "load": load},
        )  # fmt: skip
        return
    of_machines: dict[str, Any] = {
        "--over-speed": fastest,
        "--axis": axis,
        "--synchronous": synchronous,
    }
    for option, said_of_it in of_machines.items():
        if said_of_it is not None:
            raise AmbkitError(f"{option} is of a whole machine, and {target} is none")
    plant, filters = _asked(target, estimator, expert)
    if amplitudes is None:
        if report is not None and len(filters) > 1:
            raise AmbkitError(f"--report is of one loop: give one --filter, not {len(filters)}")
        _deliver_loops(
            plant, filters, controller, plot, report, json,
            x=x or 0.0, load=load or 0.0, orbit=along, lqg=lqg, hinf=hinf,
        )  # fmt: skip
    else:
        deliver_sweep(plant, filters, controller, amplitudes, stepped, plot, json, x=x, load=load,
                      orbit=along)  # fmt: skip


def _along(orbit: str | None) -> bool | float:
    """Return whether a loop is linearised along its orbit, or of which half axis that is [m]."""
    if orbit in (None, "own"):
        return orbit is not None
    return read_quantities(str(orbit), "m", "--orbit", count=1)[0]


def _deliver_loops(
    plant: Bearing, filters: Mapping[str, Estimator], controller: PID | None, plot: Path | None,
    report: Path | None, json: bool, **options: Any,
) -> None:  # fmt: skip
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.assessing import assess as assessed
    from ambkit.workflow.verdict import write_verdict

    found = assessed(plant, filters, controller, **options)
    output.deliver(
        found.to_dict(),
        [*tables(found), *tables_of_unstable(found), *tables_of_shares(found), *said(found)],
        [
            (plot, lambda path: plots.save_figure(found.figure(), path)),
            (report, lambda path: write_verdict(found, path)),
        ],
        as_json=json,
    )


def _deliver_log(
    record: Record, bearing: str | None, estimator: str | None, expert: Path | None,
    controller: PID | None, before: bool, x: float | None, load: float | None, plot: Path | None,
    json: bool,
) -> None:  # fmt: skip
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.assessing_log import BASIS, assess_log

    plant: Bearing | Machine | None = None
    filters: Any = {}
    if bearing is not None:
        plant = find_machine(bearing)
        if plant is None and (plant := machine_of(bearing)) is not None:
            if estimator is not None:
                raise AmbkitError(f"{bearing} is a filter already: leave out --estimator")
            estimator = bearing
        if plant is None:
            plant, filters = _asked(bearing, estimator, expert)
        else:
            refuse_of_one_axis(plant, {"expert": expert, "position": x, "load": load})
            filters = [] if estimator == "none" else names(estimator or "linear")
    found = assess_log(
        record, plant, filters, controller, logged="before" if before else "after",
        x=x or 0.0, load=load or 0.0,
    )  # fmt: skip
    output.deliver(
        found.to_dict(),
        [*_of_log(found), BASIS],
        [(plot, lambda path: plots.save_figure(found.figure(), path))],
        as_json=json,
    )


def _of_log(found: AssessedLog) -> list[Any]:
    """Return tables of what a record told, and of how the models meet it."""
    from ambkit.cli.output import table, value

    m, (low, high) = found.measured, found.interval
    rows = [
        ["zone of ISO 14839-3", found.zone],
        [f"  peak of |S| to {value(found.top, 'Hz')}", f"{found.peak:.3f}"],
        ["  at", value(found.peak_frequency, "Hz")],
        ["  at all frequencies together, 95 %", f"{low:.3f} to {high:.3f}"],
        ["frequencies", f"{len(m.frequency)}, {value(m.frequency[0], 'Hz', 3)} to "
                        f"{value(m.frequency[-1], 'Hz', 3)}"],
        ["periods", f"{m.periods}" if m.periods > 1 else "none: local polynomials"],
        ["coherence, least", f"{m.coherence.min():.3f}"],
    ]  # fmt: skip
    shown = [table("Measured sensitivity", ["", ""], rows)]
    if found.model is not None:
        met = [
            [name, each.zone, f"{each.peak:.3f}" if each.stable else "–",
             f"{100 * found.deviation[name]:.2g} %", f"{100 * found.within[name]:.0f} %"]
            for name, each in found.model.loops.items()
        ]  # fmt: skip
        heads = ["controller fed by", "zone", "peak of |S|", "median distance",
                 "within the 95 % intervals"]  # fmt: skip
        shown.append(table(f"Models of {found.name}", heads, met))
    return shown


def _asked(
    target: str, estimator: str | None, expert: Path | None
) -> tuple[Bearing, dict[str, Estimator]]:
    """Return the plant, and who is in the loop: where a filter's file is the target, both."""
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.simulation.linear.settled import tells

    if is_filter(target):
        if estimator is not None:
            raise AmbkitError(f"{target} is a filter already: leave out --estimator")
        plant, estimator = FilterFile.load(target).plant, target
    else:
        plant, estimator = find_bearing(target), estimator or "linear"
    built = factories([] if estimator == "none" else names(estimator), plant, expert)
    filters = {name: make() for name, make in built.items()}
    if "all" in names(estimator):
        for name in [name for name, each in filters.items() if not tells(each)]:
            output.note(f"{name} is left out: it does not settle to a gain")
            del filters[name]
    return plant, filters
