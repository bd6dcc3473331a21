"""``ambkit campaign``: thousands of machines sampled from their tolerances."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import RECORDS, Json, Plot, Verbose, file_option

if TYPE_CHECKING:
    from ambkit.campaigns.run import Status

RUN = "run"
"""The command that is meant where a study follows at once."""


class OfCampaigns(TyperGroup):
    """Commands of which `RUN` is meant where none is named."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put the command in where a study, or an option of it, follows at once."""
        if args and args[0] not in self.commands and args[0] not in ctx.help_option_names:
            args = [RUN, *args]
        return super().parse_args(ctx, args)


FolderName = Annotated[Path, typer.Argument(metavar="FOLDER", help="Of the campaign.")]
StudyName = Annotated[
    Path, typer.Argument(metavar="STUDY.toml", help="What varies, what is asked.")
]
Threads = Annotated[
    int | None,
    typer.Option(min=1, metavar="N", help="Of this process.", show_default="all it may use"),
]


def campaign(context: typer.Context) -> None:
    """Simulate thousands of machines within their tolerances."""
    # Which share is good, which is the worst, and what drives it. 'ambkit campaign STUDY.toml' is
    # short for 'ambkit campaign run STUDY.toml'.
    # For example:
    #   ambkit campaign tolerances.toml --out out --report out.html
    #   ambkit campaign status out
    #   ambkit campaign replay out 417 --plot run-417.png
    if context.invoked_subcommand is None:
        print(context.get_help())


def campaign_run(
    study: StudyName,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Where the rows are kept.",
            show_default="the study's name, here",
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="Dask: local for processes of this machine, the address of a scheduler "
            "(tcp://...), or slurm.",
            show_default="threads of this process",
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Processes, or jobs of slurm, of that cluster."),
    ] = None,
    threads: Threads = None,
    report: Annotated[
        Path | None, file_option("Write a report with pictures.", (".html",), "--report")
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Simulate the machines of a study, or go on where that was interrupted.

    The rows follow from the study alone, to the last bit, whatever computes them and in whatever
    order. They are Parquet, in FOLDER/runs.

    For example:
      ambkit campaign run tolerances.toml --out out --report out.html
      ambkit campaign run tolerances.toml --out out --cluster local
    """
    from ambkit.campaigns.run import begun_in
    from ambkit.campaigns.run import campaign as simulated
    from ambkit.campaigns.study import load
    from ambkit.cli import printing

    known = load(study)
    folder = out or Path(study.with_suffix("").name)
    begun, of = begun_in(known, folder)
    again = f"finished parts are kept in {folder}, the same command goes on"
    with (
        printing.interrupted_says(again),
        printing.progress(known.name, of, unit="runs", begun=begun) as done,
    ):
        result = simulated(
            known, folder, cluster=cluster, workers=workers, threads=threads, done=done
        )
    printing.deliver_result(result, as_json=json, verbose=verbose, plot=plot, report=report)
    printing.note(f"rows in {result.runs}")


def campaign_report(
    folder: FolderName,
    out: Annotated[
        Path | None, file_option("Write a report with pictures.", (".html",), "--out")
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Say what a campaign came to, finished or not.

    For example:
      ambkit campaign report out --out report.html
    """
    from ambkit.campaigns.campaign import Campaign
    from ambkit.cli import printing

    result = Campaign.load(folder)
    printing.deliver_result(result, as_json=json, verbose=verbose, plot=plot, report=out)


def campaign_status(folder: FolderName, json: Json = False) -> None:
    """Say how far a campaign is, also while it is at work.

    For example:
      ambkit campaign status out
    """
    from ambkit.campaigns.run import status
    from ambkit.cli import printing

    result = status(folder)
    data = result._asdict() | {"good": result.good._asdict()}
    printing.deliver(data, [_of_status(result)], as_json=json)


def campaign_replay(
    folder: FolderName,
    run: Annotated[int, typer.Argument(min=0, metavar="RUN", help="Number of the run.")],
    out: Annotated[
        Path | None, file_option("Write the record: .csv or .parquet.", RECORDS, "--out")
    ] = None,
    estimates: Annotated[
        Path | None, file_option("Write the estimates: .csv or .parquet.", RECORDS, "--estimates")
    ] = None,
    machine: Annotated[
        Path | None,
        file_option("Write the bearing, or the machine, that was drawn.", (".toml",), "--drawn"),
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Simulate one run of a campaign again, with every sample.

    For example:
      ambkit campaign replay out 417 --out run-417.csv --plot run-417.png
    """
    from ambkit.campaigns.campaign import Campaign
    from ambkit.cli import printing

    of = Campaign.load(folder)
    result = of.replay(run)
    estimate = result.run.estimate
    if estimates is not None and estimate is None:
        raise AmbkitError(f"run {run} has no estimator, so there are no --estimates")
    printing.deliver_result(
        result,
        [
            (out, result.run.record.save),
            (estimates, lambda path: estimate.save(path) if estimate is not None else None),
            (machine, result.plant.save),
        ],
        as_json=json,
        verbose=verbose,
        plot=plot,
    )


def campaign_rare(
    folder: FolderName,
    figure: Annotated[str, typer.Option(metavar="NAME", help="Figure of a run, such as peak_S.")],
    above: Annotated[
        str, typer.Option(metavar="LIMIT", help='It fails at or above this, such as 5 or "0.8 mm".')
    ],
    runs: Annotated[int, typer.Option(min=20, metavar="N", help="Of each level.")] = 1000,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Random seed.")] = 0,
    threads: Threads = None,
    json: Json = False,
) -> None:
    """Say how likely a failure is that hardly a machine has.

    By subset simulation, with what varies in the campaign's study. The report has it then.

    For example:
      ambkit campaign rare out --figure peak_S --above 5
    """
    from ambkit.base.units import parse
    from ambkit.campaigns.store import Folder
    from ambkit.campaigns.study_tables import UNITS
    from ambkit.campaigns.subset_simulation import keep, rare_failure, sentence
    from ambkit.cli import printing

    plan = Folder.existing(folder).plan
    if figure not in UNITS:
        raise AmbkitError(f"--figure: there is no figure {figure}; there are {', '.join(UNITS)}")
    try:
        limit = parse(above, UNITS[figure])
    except ValueError as error:
        raise AmbkitError(f"--above: {error}") from None
    with printing.progress("levels of rare failures", unit="runs") as done:
        result = rare_failure(plan, figure, limit, runs=runs, seed=seed, threads=threads, done=done)
    keep(folder, figure, limit, result)
    data = {"figure": figure, "above": limit} | result._asdict()
    printing.deliver(data, [sentence(figure, limit, result)], as_json=json)


def campaign_problem(study: StudyName) -> None:
    """Print what varies as SALib's problem dictionary, in JSON and SI.

    For example:
      ambkit campaign problem tolerances.toml > problem.json
    """
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.salib import problem_of
    from ambkit.campaigns.study import load
    from ambkit.cli import printing

    printing.deliver(problem_of(Plan(load(study))), [], as_json=True)


def _of_status(result: Status) -> str:
    state = "finished" if result.complete else "not finished"
    left = "" if result.complete else f" of {result.of:,}"
    return (
        f"{result.name}: {state}, {result.runs:,}{left} runs in {result.parts} parts, "
        f"good {result.good}"
    )
