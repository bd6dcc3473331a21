"""``ambkit tune``: a filter tuned on records, or on simulated runs of a bearing."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import NAMES, is_a_name
from ambkit.cli.options import (
    From,
    Json,
    MapFile,
    Plot,
    To,
    file_option,
    find_machine,
)
from ambkit.cli.tune_robust import tune_robust

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.data.rig_units import Inputs


def tune(
    target: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG|BEARING|STUDY",
            help="Records of the loop, with --bearing; a bearing, to be simulated; with --robust a "
            "study.",
        ),
    ],
    bearing: Annotated[
        str | None,
        typer.Option(
            "--bearing", metavar="BEARING", help="Of the records: a preset's name, or a TOML file."
        ),
    ] = None,
    channel_map: MapFile = None,
    robust: Annotated[
        bool,
        typer.Option(
            "--robust",
            help="Tune controller and filter over the machines of a study: its filter, a quantile "
            "of the force's error small, that of the peak of |S| below --max-sensitivity.",
        ),
    ] = False,
    quantile: Annotated[
        float, typer.Option(min=0.01, max=0.999, metavar="SHARE", help="Of the machines.")
    ] = 0.95,
    storage: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Keeps what --robust tried, to be interrupted and gone on with."
        ),
    ] = None,
    estimator: Annotated[
        str, typer.Option(callback=is_a_name, metavar="NAME", help=f"One of {', '.join(NAMES)}.")
    ] = "extended",
    expert: Annotated[
        Path | None,
        typer.Option(
            "--expert",
            metavar="FILE",
            help="What the filter asks of its magnet: an expert from 'ambkit train', or a force "
            "map (.csv). Without it, what its kind does.",
        ),
    ] = None,
    free: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What may change: noise.measurement, noise.control, noise.disturbance, and what "
            "only this kind has.",
            show_default="what records tell; with simulated runs all",
        ),
    ] = None,
    validate: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="LOG",
            help="Judge by this record; again for more. Without it, by the second half of each.",
        ),
    ] = None,
    max_sensitivity: Annotated[
        float | None,
        typer.Option(
            "--max-sensitivity",
            metavar="PEAK",
            help="What the peak of |S| in the loop with this filter must stay below, as 'ambkit "
            "assess' has it; 3 is the end of zone A.",
        ),
    ] = None,
    ceilings: Annotated[
        str | None,
        typer.Option(
            "--trade-off",
            metavar="PEAKS",
            help="Tune below each of these peaks, such as 1.8,2,2.5, and show what the margin "
            "costs; no filter is written.",
        ),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Whose controllers the loop has; what it does not say is tuned for the machine.",
        ),
    ] = None,
    begin: From = None,
    end: To = None,
    evaluations: Annotated[
        int, typer.Option("--evaluations", min=1, metavar="N", help="How many are made.")
    ] = 60,
    runs: Annotated[
        int, typer.Option(min=1, metavar="N", help="Simulated runs to tune on, and to judge by.")
    ] = 8,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of all that is drawn.")] = 0,
    out: Annotated[Path | None, file_option("Write the filter.", (".toml",), "--out")] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Tune a filter, and say what that gained on data that it did not see.

    By the likelihood of records; or, of a bearing without records, by the errors against simulated
    truth. The filter's file goes into filter, simulate, compare, torture and export.

    For example:
      ambkit tune zittau_axial --estimator linear --out filter.toml
      ambkit tune run.csv --bearing my.toml --validate other.csv --out filter.toml --plot tune.png
      ambkit tune run.csv --bearing my.toml --max-sensitivity 2.5 --out filter.toml
      ambkit tune tolerances.toml --robust --storage search.log --out filter.toml
      ambkit tune tum_mlps --estimator linear --trade-off 1.7,2,2.5 --plot trade.png
      ambkit export c filter.toml --out out/
    """
    from ambkit.cli import output
    from ambkit.cli.options import arguments_of_the_user
    from ambkit.estimate.experts import experts
    from ambkit.workflow.given import given_controller
    from ambkit.workflow.trading_off import trade_off
    from ambkit.workflow.tuned_filter import tune as tuned

    if robust:
        refused = {"--bearing": bearing, "--channels": channel_map, "--expert": expert,
                   "--validate": validate or None, "--trade-off": ceilings, "--from": begin,
                   "--to": end, "--scenario": scenario}  # fmt: skip
        for option, taken in refused.items():
            if taken is not None:
                raise AmbkitError(f"{option} does not go with --robust: the study says all")
        if len(target) > 1:
            raise AmbkitError(f"one study is tuned over, {len(target)} are given")
        tune_robust(
            target[0], quantile=quantile, ceiling=max_sensitivity, free=free, storage=storage,
            evaluations=evaluations, seed=seed, out=out, plot=plot, json=json,
        )  # fmt: skip
        return
    if storage is not None:
        raise AmbkitError("--storage is for --robust")
    simulated = bearing is None
    if simulated and any(Path(name).suffix not in ("", ".toml") for name in target):
        raise AmbkitError(f"{target[0]} is a record: --bearing says what it is of")
    if simulated and len(target) > 1:
        raise AmbkitError(f"one bearing is tuned for, {len(target)} are given")
    for_records = {
        "--channels": channel_map,
        "--validate": validate or None,
        "--from": begin,
        "--to": end,
    }
    for option, given in for_records.items():
        if simulated and given is not None:
            raise AmbkitError(f"{option} is for records, and there is none")
    name = target[0] if bearing is None else bearing
    known = find_machine(name)
    magnet = None if expert is None else experts(expert, known)
    records = [] if simulated else [_load(Path(p), channel_map, known, begin, end) for p in target]
    others = [_load(path, channel_map, known, None, None) for path in validate or ()]
    inputs = None if channel_map is None else _inputs(channel_map)
    span = "" if begin is None and end is None else f", {_shown(begin)} to {_shown(end)}"
    pid = given_controller(known.long, scenario)[0]
    if ceilings is not None:
        alone = {"--max-sensitivity": max_sensitivity, "--out": out, "--free": free,
                 "--validate": validate or None}  # fmt: skip
        for option, taken in alone.items():
            if taken is not None:
                raise AmbkitError(f"{option} does not go with --trade-off")
        peaks = _peaks(ceilings)
        with output.progress("tuning", evaluations * len(peaks)) as done:
            traded = trade_off(
                known, peaks, records, estimator, controller=pid, magnet=magnet, runs=runs,
                budget=evaluations, seed=seed, done=done,
            )  # fmt: skip
        output.deliver_result(traded, as_json=json, plot=plot)
        return
    with arguments_of_the_user(), output.progress("tuning", evaluations) as done:
        found = tuned(
            known, records, estimator, validate=others, max_sensitivity=max_sensitivity,
            controller=pid,
            free=None if free is None else free.replace(" ", "").split(","),
            magnet=magnet, inputs=inputs,
            source="" if simulated else ", ".join(Path(p).name for p in target) + span,
            runs=runs, budget=evaluations, seed=seed, done=done,
        )  # fmt: skip
    output.deliver_result(
        found,
        [(out, lambda path: found.save(path, bearing=name, magnet=expert))],
        as_json=json,
        plot=plot,
    )
    output.say_adequacy(found.adequacy)


def _peaks(text: str) -> list[float]:
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise AmbkitError(f"--trade-off takes numbers with commas, is {text!r}") from None


def _load(
    path: Path, channel_map: Path | None, machine: Any, begin: float | None, end: float | None
) -> Record:
    from ambkit.cli.belonging import say_what_is_odd
    from ambkit.cli.logs import load_log

    record = load_log(path, channel_map, begin, end)
    say_what_is_odd(path, record, machine)
    return record


def _inputs(channel_map: Path) -> Inputs:
    """Return what the controller reads: the same numbers as the log has."""
    from ambkit.data.channelmap import ChannelMap, inputs_of

    return inputs_of(ChannelMap.load(channel_map))


def _shown(time: float | None) -> str:
    from ambkit.base.units import engineering

    return "its end" if time is None else engineering(time, "s")
