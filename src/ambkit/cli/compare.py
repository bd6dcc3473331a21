"""``ambkit compare``: estimators in a case, or each in its own loop over many seeds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.cli.kinds import known, names
from ambkit.cli.parameters import (
    RECORDS,
    BearingName,
    ExpertFile,
    Json,
    Plot,
    Verbose,
    file_option,
    find_axis,
    find_machine,
    quantity,
    read_quantities,
)

if TYPE_CHECKING:
    from ambkit.machine.forces.force_surface import ForceSurface
    from ambkit.machine.machine import Machine
    from ambkit.workflow.compare_steps import LoopScores

CASES = (
    "paper", "uncertain", "wrong-k", "saturating", "coloured-noise", "step", "unbalance", "model",
    "all",
)  # fmt: skip


def known_case(name: str | None) -> str | None:
    """Check the name of a case, as the callback of an option."""
    if name is not None and name not in CASES:
        raise typer.BadParameter(f'there is no case "{name}"; known: {", ".join(CASES)}')
    return name


def compare(
    bearing: BearingName,
    case: Annotated[
        str | None,
        typer.Option(
            callback=known_case,
            metavar="NAME",
            help=f"What happens: {', '.join(CASES)}. Default paper.",
        ),
    ] = None,
    estimators: Annotated[
        str | None,
        typer.Option(
            "--estimators",
            "--estimator",
            metavar="NAMES",
            help="Who takes part: all, or some kinds (those of 'ambkit filter' and more); "
            "your own as my.py:MyFilter, a class with step(y, u).",
        ),
    ] = None,
    tune: Annotated[
        int, typer.Option(min=0, metavar="N", help="Evaluations to tune each with; 0: defaults.")
    ] = 0,
    runs: Annotated[
        int, typer.Option("--runs", "--seeds", min=1, metavar="N", help="How many runs.")
    ] = 20,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of the first of them.")] = 0,
    spread: Annotated[
        float | None,
        typer.Option(
            parser=quantity("1"),
            metavar="SHARE",
            help='How far the plant is off at most, such as "20 %": magnet constant, mass, air '
            "gap, sensor and load. Default what the case says.",
        ),
    ] = None,
    expert: ExpertFile = None,
    force_map: Annotated[
        Path | None,
        typer.Option(
            "--force-map",
            metavar="FILE.csv",
            help="Force map of the true magnet, points of iu, x and f_mag: your own iron, which "
            "the estimators do not know; table and adaptive learn it, or ask --expert.",
        ),
    ] = None,
    scenario: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Your own run in place of a case.")
    ] = None,
    steps: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTHS",
            help="In place of a case: steps of the first axis's reference, such as "
            '"0.1 mm,0.3 mm".',
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"),
            metavar="FORCE",
            help="In place of a case: load on the first axis after half of the run.",
        ),
    ] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            parser=quantity("s"), metavar="TIME", help="In place of a case: length of the run."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        file_option("Write the figures of each run: .csv or .parquet.", RECORDS, "--out"),
    ] = None,
    save_filters: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="With --tune, of one case: write the tuned filters, DIR/KIND.toml each.",
        ),
    ] = None,
    plot: Plot = None,
    report: Annotated[
        Path | None,
        file_option(
            "Write the whole comparison with pictures: .html; of a --case only, not with --steps, "
            "--load, --duration or --scenario.",
            (".html",),
            "--report",
        ),
    ] = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Compare filters by error, consistency, delay and cost.

    In a case, all run along the same records from the same start, and each in the loop, beside the
    raw sensors; where the limit of any estimator is known, it is told. Of several axes a case
    happens to each, and errors are those of all axes together.

    With --steps, --load, --duration or --scenario the errors of each in its own loop are compared,
    without tuning, --spread and --report.

    For example:
      ambkit compare zittau_axial --case paper --plot matrix.png --report comparison.html
      ambkit compare my.toml --estimators linear,extended --tune 40 --save-filters filters/
      ambkit compare tum_mlps --case model --estimators linear,extended
      ambkit compare tum_mlps --estimators linear,extended --steps "20 um,40 um"
      ambkit compare zittau_axial --steps "0.1 mm,0.3 mm,0.5 mm" --load "3 N" --plot bars.png
    """
    own = {"--scenario": scenario, "--steps": steps, "--load": load, "--duration": duration}
    loop_options = [name for name, value in own.items() if value is not None]
    if not loop_options:
        from ambkit.cli.compare_case import Wanted, in_case

        if save_filters is not None and (not tune or case == "all"):
            what = "of one case, not of all" if tune else "of tuned filters: give --tune too"
            raise AmbkitError(f"--save-filters is {what}")
        request = Wanted(
            runs, tune, seed, spread, expert, force_map, out, plot, report, save_filters, json,
            verbose,
        )  # fmt: skip
        chosen = "all" if estimators is None else estimators
        in_case(bearing, case or "paper", chosen, request)
        return
    unwanted = {"--case": case, "--tune": tune or None, "--spread": spread,
                "--save-filters": save_filters, "--report": report}  # fmt: skip
    clash = [name for name, value in unwanted.items() if value is not None]
    if clash:
        hint = "; --out and --plot do" if clash[0] == "--report" else ""
        raise AmbkitError(
            f"{loop_options[0]} is in place of a case, and does not go with {clash[0]}{hint}"
        )
    from ambkit.machine.forces.force_map import surface_in

    chosen = "linear,adaptive,closed-law" if estimators is None else estimators
    _in_own_loops(
        find_machine(bearing),
        names(known(chosen)),
        scenario_file=scenario,
        expert=expert,
        true=None if force_map is None else surface_in(force_map, find_axis(bearing)),
        steps=steps,
        load=load,
        duration=duration,
        seeds=runs,
        seed=seed,
        files=(out, plot),
        as_json=json,
        verbose=verbose,
    )


def _in_own_loops(
    plant: Machine,
    chosen: list[str],
    *,
    scenario_file: Path | None,
    expert: Path | None,
    true: ForceSurface | None,
    steps: str | None,
    load: float | None,
    duration: float | None,
    seeds: int,
    seed: int,
    files: tuple[Path | None, Path | None],
    as_json: bool,
    verbose: bool,
) -> None:
    """Each closes its own loop, against the same noise, with the same Q and R."""
    from ambkit.cli import printing
    from ambkit.cli.kinds import factories
    from ambkit.workflow.compare_steps import compare_in_loops, loop_cases

    what = loop_cases(
        plant,
        scenario_file,
        steps=None if steps is None else read_quantities(steps, "m", "--steps"),
        load=load,
        duration=duration,
        name=str(scenario_file),
    )
    built = factories(chosen, plant, expert)
    with printing.progress("comparing", len(what) * len(built) * seeds) as done:
        result = compare_in_loops(plant, what, built, runs=seeds, seed=seed, plant=true, done=done)
    out, plot = files
    rows = (out, lambda path: _save(path, result))
    printing.deliver_result(result, [rows], as_json=as_json, verbose=verbose, plot=plot)


def _save(path: Path, result: LoopScores) -> None:
    """Write the error of each run: a row for each case and seed."""
    import numpy as np

    from ambkit.data.files.tables import Table, write_table
    from ambkit.judge.comparison.criteria import EVALUATED

    scores, count = result.scores, len(result.seeds)
    columns: dict[str, Any] = {}
    units = {"case": "1", "step": "m", "seed": "1"}
    columns["case"] = np.repeat(np.arange(len(scores), dtype=float), count)
    if result.steps is not None:
        columns["step"] = np.repeat(np.array(result.steps, dtype=float), count)
    columns["seed"] = np.tile(np.array(result.seeds, dtype=float), len(scores))
    for name in next(iter(scores.values())):
        for signal, unit in EVALUATED.items():
            key = f"{name}_{signal}"
            units[key] = unit
            columns[key] = np.concatenate([case[name].rmse[signal] for case in scores.values()])
        units[f"{name}_nis"] = "1"
        columns[f"{name}_nis"] = np.concatenate([case[name].nis for case in scores.values()])
    write_table(path, Table(columns, {k: units[k] for k in columns}, {"cases": list(scores)}))
