"""``ambkit assess``: stability margins of a loop, with the filter in it, linear or measured."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, is_filter, known, names
from ambkit.cli.options import (
    ExpertFile,
    From,
    Json,
    MapFile,
    Plot,
    To,
    file_option,
    find_bearing,
    quantity,
    read_quantities,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from ambkit.data.record import Record
    from ambkit.estimate.base import Estimator
    from ambkit.judge.loop.demands import Demands
    from ambkit.judge.loop.margins import Margins
    from ambkit.machine.bearing import Bearing
    from ambkit.simulation.scenario import PID
    from ambkit.workflow.assessing import AssessedLoop, Assessment
    from ambkit.workflow.assessing_log import AssessedLog


def assess(
    target: Annotated[
        str,
        typer.Argument(
            metavar="BEARING|LOG",
            help="A preset's name, or a TOML file: of a bearing, or of a filter. Or a record of a "
            "loop with an injected signal.",
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
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Whose [controller] is assessed; what it does not say, all of it without one, is "
            "tuned for the bearing.",
        ),
    ] = None,
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
    lqg: Annotated[
        bool,
        typer.Option(
            "--lqg", help="Beside them, the linear-quadratic-Gaussian controller of least control."
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
    bearing: Annotated[
        str | None,
        typer.Option(
            "--bearing",
            metavar="BEARING",
            help="Of a log: the bearing whose model is laid over, or the file of a filter.",
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
    to the measurement, with its confidence.

    For example:
      ambkit assess zittau_axial --estimator linear,observer --plot margins.png
      ambkit assess my.toml --filter filter.toml --sweep "1 um,20 um"
      ambkit assess injected.csv --bearing my.toml --plot measured.png
    """
    from ambkit.simulation.scenario import Scenario

    controller = None if scenario is None else Scenario.load(scenario).controller
    of_log = Path(target).suffix not in ("", ".toml")
    for_logs = {"--bearing": bearing, "--channels": channel_map, "--logged-before": before or None,
                "--from": begin, "--to": end}  # fmt: skip
    for option, given in for_logs.items():
        if given is not None and not of_log:
            raise AmbkitError(f"{option} is for records, and {target} is none")
    if of_log and amplitudes is not None:
        raise AmbkitError("--sweep is for bearings, not for records")
    if lqg and (of_log or amplitudes is not None):
        raise AmbkitError("--lqg is of a bearing's linear loop, without --sweep")
    if report is not None and (of_log or amplitudes is not None):
        raise AmbkitError("--report is of a bearing's linear loop, without --sweep")
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
    plant, filters = _asked(target, estimator, expert)
    if amplitudes is None:
        if report is not None and len(filters) > 1:
            raise AmbkitError(f"--report is of one loop: give one --filter, not {len(filters)}")
        _deliver_loops(plant, filters, controller, x, load, lqg, plot, report, json)
    else:
        sizes = read_quantities(amplitudes, "m", "--sweep")
        _deliver_sweep(plant, filters, controller, sizes, stepped, x, load, plot, json)


def _deliver_loops(
    plant: Bearing, filters: Mapping[str, Estimator], controller: PID | None, x: float | None,
    load: float | None, lqg: bool, plot: Path | None, report: Path | None, json: bool,
) -> None:  # fmt: skip
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.assessing import assess as assessed
    from ambkit.workflow.verdict import write_verdict

    found = assessed(plant, filters, controller, x=x or 0.0, load=load or 0.0, lqg=lqg)
    output.deliver(
        found.to_dict(),
        [*_tables(found), *_said(found)],
        [
            (plot, lambda path: plots.save_figure(found.figure(), path)),
            (report, lambda path: write_verdict(found, path)),
        ],
        as_json=json,
    )


def _deliver_sweep(
    plant: Bearing, filters: Mapping[str, Estimator], controller: PID | None, sizes: list[float],
    stepped: bool, x: float | None, load: float | None, plot: Path | None, json: bool,
) -> None:  # fmt: skip
    from ambkit.cli import output
    from ambkit.show import plots
    from ambkit.workflow.loop_of import zone_of
    from ambkit.workflow.sweeping import sweep

    if len(filters) > 1:
        raise AmbkitError(f"--sweep is of one loop: give one --filter, not {len(filters)}")
    with output.progress("sweeping"):
        found = sweep(
            plant, filters, controller, amplitudes=sizes,
            kind="stepped-sine" if stepped else "multisine", x=x or 0.0, load=load or 0.0,
        )  # fmt: skip
    rows = [
        [output.value(each.amplitude, "m"), f"{each.peak:.3f}", zone_of(each.peak),
         f"{100 * each.deviation:.2g} %", "yes" if each.limited else "no"]
        for each in found.swept
    ]  # fmt: skip
    rows.append(["linear model", f"{found.loop.peak:.3f}", found.loop.zone, "–", "–"])
    heads = ["amplitude", "peak of |S|", "zone", "from the model, at most", "at a limit"]
    title = f"{plant.name}, controller fed by {found.loop.name}: {found.kind} of the simulated loop"
    output.deliver(
        found.to_dict(),
        [output.table(title, heads, rows)],
        [(plot, lambda path: plots.save_figure(found.figure(), path))],
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

    plant, filters = None, dict[str, Any]()
    if bearing is not None:
        plant, filters = _asked(bearing, estimator, expert)
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
    tables = [table("Measured sensitivity", ["", ""], rows)]
    if found.model is not None:
        met = [
            [name, each.zone, f"{each.peak:.3f}" if each.stable else "–",
             f"{100 * found.deviation[name]:.2g} %", f"{100 * found.within[name]:.0f} %"]
            for name, each in found.model.loops.items()
        ]  # fmt: skip
        heads = ["controller fed by", "zone", "peak of |S|", "median distance",
                 "within the 95 % intervals"]  # fmt: skip
        tables.append(table(f"Models of {found.model.bearing.name}", heads, met))
    return tables


def _asked(
    target: str, estimator: str | None, expert: Path | None
) -> tuple[Bearing, dict[str, Estimator]]:
    """Return the plant, and who is in the loop: where a filter's file is the target, both."""
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.simulation.linear.pieces import tells

    if is_filter(target):
        if estimator is not None:
            raise AmbkitError(f"{target} is a filter already: leave out --estimator")
        plant, estimator = FilterFile.load(target).bearing.bearing, target
    else:
        plant, estimator = find_bearing(target), estimator or "linear"
    built = factories([] if estimator == "none" else names(estimator), plant, expert)
    filters = {name: make() for name, make in built.items()}
    if "all" in names(estimator):
        for name in [name for name, each in filters.items() if not tells(each)]:
            output.note(f"{name} is left out: it does not settle to a gain")
            del filters[name]
    return plant, filters


BESIDE = 5
"""Loops beside each other in one table."""


def _tables(found: Assessment) -> list[Any]:
    """Return tables with a row for each figure, a column for each loop."""
    from ambkit.cli.output import table, value

    top = value(found.top, "Hz")

    def margin(said: Callable[[Margins], str]) -> Callable[[AssessedLoop], str]:
        return lambda each: "–" if each.margins is None else said(each.margins)

    def asked(said: Callable[[Demands], str]) -> Callable[[AssessedLoop], str]:
        return lambda each: "–" if each.demands is None else said(each.demands)

    rows: list[tuple[str, Callable[[AssessedLoop], str]]] = [
        ("zone of ISO 14839-3", lambda e: e.zone),
        (f"  peak of |S| to {top}", lambda e: f"{e.peak:.3f}" if e.stable else "–"),
        ("  at", lambda e: value(e.peak_frequency, "Hz")),
        ("peak of |S| to half the sampling rate", margin(lambda m: f"{m.peak:.3f}")),
        ("peak of |T|", margin(lambda m: f"{m.complementary_peak:.3f}")),
        ("gain margin up, down", margin(lambda m: _decibels(m.gain_up, m.gain_down))),
        ("phase margin", margin(lambda m: f"{math.degrees(m.phase):.1f} deg")),
        ("delay margin", margin(lambda m: value(m.delay, "s", 3))),
        ("disk margin: gain, both ways", margin(lambda m: _decibels(m.disk_gain[1]))),
        ("  phase, both ways", margin(lambda m: f"{math.degrees(m.disk_phase):.1f} deg")),
        ("|S| below -3 dB up to", margin(lambda m: value(m.bandwidth, "Hz", 3))),
        ("highest crossover", margin(lambda m: value(m.crossover, "Hz", 3))),
        ("current by noise, rms", lambda e: value(e.current_noise, "A", 3)),
        ("position by noise, rms", lambda e: value(e.position_noise, "m", 3)),
        ("zone of ISO 14839-2", asked(lambda d: d.zone)),
        ("  greatest displacement, of the clearance",
         asked(lambda d: f"{100 * d.displacement / d.clearance:.2g} %")),
        ("least harmonic load that comes to a limit",
         asked(lambda d: value(d.capacity.least[0], "N", 3))),
        ("  at", asked(lambda d: value(d.capacity.least[1], "Hz", 3))),
        ("check: Bode's integral of ln|S|", lambda e: f"{e.integral.integral:.8f}"),
        ("  ln|p| of the unstable poles", lambda e: f"{e.integral.poles:.8f}"),
    ]  # fmt: skip
    at = f"at {value(found.point.x, 'm')} and {value(found.point.iu, 'A')}"
    title = f"{found.bearing.name} {at}, controller fed by"
    names = list(found.loops)
    return [
        table(
            title,
            ["", *some],
            [[head, *(said(found.loops[name]) for name in some)] for head, said in rows],
        )
        for some in (names[k : k + BESIDE] for k in range(0, len(names), BESIDE))
    ]


def _decibels(*factors: float) -> str:
    def one(factor: float) -> str:
        if not 0 < factor < math.inf:
            return "∞" if factor else "-∞"
        return f"{20 * math.log10(factor):.1f}"

    return f"{', '.join(map(one, factors))} dB"


def _said(found: Assessment) -> list[str]:
    """The bound, the check, and what all of it is."""
    from ambkit.workflow.assessing import BASIS

    said = []
    if found.least[0] > 1:
        said.append(
            f"no linear controller brings the peak of |S| below {found.least[0]:.3f} here, nor "
            f"that of |T| below {found.least[1]:.3f}, for the unstable pole and the dead time"
        )
    wrong = [name for name, each in found.loops.items() if not each.integral.holds]
    if wrong:
        said.append(f"the check does not hold, as in an unstable loop: {', '.join(wrong)}")
    return [*said, BASIS]
