"""``ambkit filter``: estimators along a record, evaluated."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.base.units import percent
from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.parameters import (
    RECORDS,
    ExpertFile,
    From,
    Json,
    MapFile,
    Plot,
    Synchronous,
    To,
    Verbose,
    arguments_of_the_user,
    file_option,
    find_machine,
    quantity,
)
from ambkit.estimate.registry import FILTER_SUFFIX

if TYPE_CHECKING:
    from collections.abc import Mapping

    from ambkit.data.channel_map import ChannelMap
    from ambkit.data.record import Record
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.workflow.filter import Filtered, Filtering, Stretch
    from ambkit.workflow.warnings import OutsideOperatingRange


def filter_record(
    record: Annotated[
        Path,
        typer.Argument(metavar="RECORD", help="The recording: a record, or with --channels a log."),
    ],
    bearing: Annotated[
        str | None,
        typer.Option(
            "--bearing",
            metavar="MACHINE",
            help="A preset's name, or a TOML file.",
            show_default="that of the first filter's file",
        ),
    ] = None,
    channel_map: MapFile = None,
    estimator: Annotated[
        str,
        typer.Option(
            "--estimator",
            "--filter",
            callback=known,
            metavar="NAMES",
            help=f"One or several of {', '.join(NAMES)}; all; or filters' files (.toml), whose "
            "inputs say what y and u of the log are.",
        ),
    ] = "linear,adaptive,closed-law",
    expert: ExpertFile = None,
    begin: From = None,
    end: To = None,
    settling: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            metavar="TIME",
            help="Time at the start that does not count in the table.",
        ),
    ] = None,
    noise_y: Annotated[
        float | None,
        typer.Option(
            "--measurement-noise",
            parser=quantity("m^2"),
            metavar="VARIANCE",
            help='R, such as "225 µm^2", if not the bearing\'s.',
        ),
    ] = None,
    noise_d: Annotated[
        float | None,
        typer.Option(
            "--disturbance-noise",
            parser=quantity("N^2/s"),
            metavar="VARIANCE",
            help='How fast the load wanders, such as "1 N^2/s"; see --tune.',
        ),
    ] = None,
    tune: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"),
            metavar="TIME",
            help="Find how fast the load wanders, as the first TIME of the record makes most "
            "likely; that time does not count in the table. Default with a measured record: its "
            "second quarter (the first is often a start), judged on the second half, and kept "
            "only if it fits that better than the untuned. With a simulated record nothing is "
            "tuned, and it is (2 m g)^2 a second.",
        ),
    ] = None,
    smooth: Annotated[
        bool,
        typer.Option(
            "--smooth",
            help="Also estimate each sample from the whole record, not only from what came before.",
        ),
    ] = False,
    synchronous: Synchronous = None,
    out: Annotated[
        Path | None, file_option("Write the estimates: .csv or .parquet.", RECORDS, "--out")
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Run filters along a record.

    And judge them: by their innovations, the load that they see, and against the truth if known.

    Without truth the judge is how well the measured position is predicted, beside holding its last
    value and beside what the rig logged itself (x_logged, v_logged).

    For example:
      ambkit filter run.csv --bearing zittau_axial --out estimates.csv --plot estimates.html
    """
    from ambkit.cli import printing
    from ambkit.cli.kinds import factories
    from ambkit.cli.plausibility import say_what_is_odd
    from ambkit.cli.record_arguments import load_log
    from ambkit.estimate.filter_file import FilterFile
    from ambkit.estimate.noise_model import FilterNoise
    from ambkit.workflow.filter import filter as filtered
    from ambkit.workflow.filter import stretch_to_tune_on

    if tune is not None and noise_d is not None:
        raise AmbkitError("--tune finds what --disturbance-noise gives: use one of them")
    if tune is not None and not tune > 0:
        raise AmbkitError(f"--tune must be greater than 0 s, is {tune:g} s")
    chosen = names(estimator)
    files = {name: FilterFile.load(name) for name in chosen if name.endswith(FILTER_SUFFIX)}
    if bearing is None and not files:
        raise AmbkitError("--bearing is missing: a preset's name, or a TOML file")
    machine = next(iter(files.values())).plant if bearing is None else find_machine(bearing)
    log = load_log(record, _channels(files, channel_map), begin, end)
    say_what_is_odd(record, log, machine)
    if noise_d is None:
        with arguments_of_the_user("--"):
            _say_what_is_tuned_on(stretch_to_tune_on(log, tune), log)
    built = factories(chosen, machine, expert, synchronous or ())
    with arguments_of_the_user(), printing.progress("filtering", len(built)) as done:

        def tell(one: Filtered) -> None:
            _say_how_it_was_tuned(one)
            done()

        result = filtered(
            machine,
            log,
            built,
            noise=FilterNoise(measurement=noise_y, disturbance=noise_d),
            tune=tune,
            settling=settling or 0.0,
            smooth=smooth,
            done=tell,
        )
    _warn(result, len(log))
    adequacy = {name: _adequacy(name, one, built[name], machine)
                for name, one in result.estimators.items()}  # fmt: skip

    printing.deliver_result(
        result,
        [(out, lambda path: result.to_record().save(path))],
        as_json=json,
        verbose=verbose,
        plot=plot,
        more={"record": str(record), "adequacy": adequacy},
    )


def _channels(files: Mapping[str, FilterFile], channel_map: Path | None) -> ChannelMap | None:
    """Return the map of the log, with y and u as the filters' files have them."""
    from ambkit.data.channel_map import ChannelMap

    if channel_map is None:
        return None
    channels = ChannelMap.load(channel_map)
    inputs = {name: file.inputs for name, file in files.items() if not file.inputs.in_si}
    if not inputs:
        return channels
    first, *others = inputs
    for name in others:
        if inputs[name] != inputs[first]:
            raise AmbkitError(f"{first} and {name} read other inputs: filter by one at a time")
    return channels.with_inputs(inputs[first])


def _say_what_is_tuned_on(stretch: Stretch | None, log: Record) -> None:
    """Say it where nobody asked for it."""
    from ambkit.cli import printing

    if stretch is not None and stretch.by_itself:
        start, stop = (log.t[0] + end for end in (stretch.start, stretch.stop))
        printing.note(f"tuned from {start:.3g} to {stop:.3g} s, judged on the rest")


def _say_how_it_was_tuned(one: Filtered) -> None:
    """Say what the stretch does not tell, and whether the rest of the record speaks against it."""
    from ambkit.cli import printing

    tuning = one.tuning
    if tuning is None:
        return
    if tuning.why:
        printing.note(f"{one.name}: {tuning.why}")
    if tuning.worse:
        then = (
            "so the tuning is the first suspect"
            if tuning.kept
            else "so the untuned one is used, chosen by what it is judged on"
        )
        printing.note(
            f"{one.name}: tuned load noise, {tuning.found.disturbance:.3g} N^2/s, fits the rest of "
            f"the record worse than the untuned, {tuning.untuned.disturbance:.3g} N^2/s (the load "
            f"moved otherwise there), {then}; --disturbance-noise sets it, --tune another stretch"
        )


def _adequacy(name: str, one: Filtered, build: Any, machine: Any) -> list[dict[str, Any]]:
    """Say whether a filter from a file may fly on a machine; of any other what NIS says."""
    from ambkit.cli import printing
    from ambkit.estimate.named import FromFile
    from ambkit.judge.adequacy import judge_adequacy

    saved = build() if isinstance(build, FromFile) else None
    return printing.say_adequacy(judge_adequacy(saved, machine, nis=one.evaluation.nis), name)


def _warn(result: Filtering, samples: int) -> None:
    """Say so where filter and record do not belong together, or what was asked is not known."""
    from ambkit.cli import printing
    from ambkit.data.signals import each_of
    from ambkit.workflow.warnings import missing_control

    left = samples - len(result.record)
    if left:
        printing.note(
            f"{left} samples are left out, in which magnets have no current by the record's mode"
        )
    lost, in_a_row = missing_control(result.record)
    if lost:
        printing.note(
            f"the control signal is missing in {lost} of {len(result.record)} samples, at most "
            f"{in_a_row} in a row: the filters hold the last one, and are less sure for a while "
            "than they say"
        )
    gap = max(placed.magnet.air_gap for placed in result.machine.bearings)
    for name, one in result.estimators.items():
        if any(max(each_of(e)) > gap for e in one.evaluation.prediction.values()):
            printing.note(
                f"{name}: predicts beyond the air gap, {printing.value(gap, 'm', 4)}: over so long "
                "a time the rotor does not move as this machine says; it lies or is held in a part "
                "of the record, or the record is of another rig ('ambkit check' with --bearing)"
            )
        for axis, outside in one.outside.items():
            printing.note(_of_the_box(f"{name}, axis {axis}" if axis else name, outside))


def _of_the_box(name: str, outside: OutsideOperatingRange) -> str:
    """Say that the expert was asked beyond the box that it was trained for."""
    from ambkit.cli.printing import value

    current, displacement = (
        f"{value(low, unit, 3)} to {value(high, unit, 3)} ({percent(share)})"
        for (low, high, share), unit in ((outside.current, "A"), (outside.displacement, "m"))
    )
    return (
        f"{name}: {percent(outside.share)} of the samples lie outside of the expert's box, "
        f"current {current}, displacement {displacement}; there it answers as at the edge: "
        "train it on a larger one ('ambkit train --reach')"
    )
