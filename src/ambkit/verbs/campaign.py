"""Campaigns: many machines sampled from tolerances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.base.progress import interrupted_says, progress
from ambkit.verbs.words import Above, Cluster, Folder, Study

if TYPE_CHECKING:
    from ambkit.campaigns.campaign import Campaign, Replayed
    from ambkit.result.result import Document, Statement


def campaign(
    study: Study,
    folder: Folder | None = None,
    *,
    cluster: Cluster | None = None,
    workers: int | None = None,
    threads: int | None = None,
) -> Campaign:
    """Simulate machines sampled from tolerances.

    Reports yield, worst machines and sensitivity indices. A campaign that was interrupted is
    resumed. Results are Parquet files in DIR/runs; they depend on the study only, to the last bit,
    not on threads, order or cluster.

    Parameters
    ----------
    study : Study, str or path
        TOML file of the study: variations and criteria.
    folder : str or path, optional
        Output folder. By default the study's name.
    cluster : str, optional
        Dask cluster: local, slurm, or the address of a scheduler (tcp://...). By default threads of
        this process.
    workers : int, optional
        Processes or slurm jobs of the cluster.
    threads : int, optional
        Threads of this process. By default all available.

    Returns
    -------
    Campaign
        Yield, worst machines, sensitivity indices, tables and figures.

    Raises
    ------
    AmbkitError
        The study is not valid; the folder belongs to another study or version of ambkit, or cannot
        be written; the cluster does not answer.

    Examples
    --------
    $ ambkit campaign run tolerances.toml --folder out --out out.html
    $ ambkit campaign run tolerances.toml --folder out --cluster local
    """
    import logging

    from ambkit.campaigns import run

    known, place, begun, of = run.campaign_progress(study, folder)
    again = f"finished parts are kept in {place}, the same command goes on"
    with interrupted_says(again), progress(known.name, of, unit="runs", begun=begun) as done:
        result = run.campaign(
            known, place, cluster=cluster, workers=workers, threads=threads, done=done
        )
    logging.getLogger("ambkit").info("rows in %s", result.runs)
    return result


def campaign_status(folder: Folder) -> Statement:
    """Report the progress of a campaign.

    Parameters
    ----------
    folder : str or path
        Folder of the campaign.

    Returns
    -------
    Statement
        Runs, parts and yield so far.

    Raises
    ------
    AmbkitError
        The folder has no campaign, or one of another version of ambkit.

    Examples
    --------
    $ ambkit campaign status out
    """
    from ambkit.campaigns.run import status

    return status(folder)


def campaign_report(folder: Folder) -> Campaign:
    """Report the results of a campaign, complete or not.

    Parameters
    ----------
    folder : str or path
        Folder of the campaign.

    Returns
    -------
    Campaign
        As returned by `ambkit.campaign`.

    Raises
    ------
    AmbkitError
        The folder has no campaign, or one of another version of ambkit.

    Examples
    --------
    $ ambkit campaign report out --out report.html
    """
    from ambkit.campaigns.campaign import Campaign

    return Campaign.load(folder)


def campaign_replay(folder: Folder, run: int) -> Replayed:
    """Repeat one run of a campaign and record every sample.

    Parameters
    ----------
    folder : str or path
        Folder of the campaign.
    run : int
        Number of the run.

    Returns
    -------
    Replayed
        Record, estimate and sampled machine.

    Raises
    ------
    AmbkitError
        The run does not exist, or its machine is not physical.

    Examples
    --------
    $ ambkit campaign replay out 417 --out run-417.csv --plot run-417.png
    $ ambkit campaign replay out 417 --out estimates=e.csv --out machine=drawn.toml
    """
    from ambkit.campaigns.campaign import Campaign

    return Campaign.load(folder).replay(run)


def campaign_rare(
    folder: Folder,
    *,
    figure: str,
    above: Above,
    budget: int = 1000,
    seed: int = 0,
    threads: int | None = None,
) -> Statement:
    """Estimate the probability of a rare failure by subset simulation.

    Machines are sampled from the tolerances of the campaign's study. The interval is that of
    independent repetitions; where these fail in different directions from the nominal machine, the
    result warns of several modes of failure. The campaign's report includes the result.

    Parameters
    ----------
    folder : str or path
        Folder of the campaign.
    figure : str
        Figure of merit, such as peak_S, or a limit state of your own as my.py:limit: a function
        of a mapping of figures and varied quantities, by name, to arrays [SI].
    above : float or str
        Failure limit, such as 5 or "0.8 mm".
    budget : int, optional
        Runs per level, of all repetitions together.
    seed : int, optional
        Random seed.
    threads : int, optional
        Threads of this process. By default all available.

    Returns
    -------
    Statement
        Probability with its interval.

    Raises
    ------
    AmbkitError
        The figure is unknown, the limit has another unit, or the study has no probabilities.

    Examples
    --------
    $ ambkit campaign rare out --figure peak_S --above 5
    """
    from ambkit.campaigns import subset_simulation

    with progress("levels of rare failures", unit="runs") as done:
        return subset_simulation.rare_in_folder(
            folder, figure, above, runs=budget, seed=seed, threads=threads, done=done
        )


def campaign_problem(study: Study) -> Document:
    """Print the variations of a study as SALib problem (JSON, SI units).

    Parameters
    ----------
    study : Study, str or path
        TOML file of the study.

    Returns
    -------
    Document
        The problem dictionary.

    Raises
    ------
    AmbkitError
        The study is not valid.

    Examples
    --------
    $ ambkit campaign problem tolerances.toml > problem.json
    """
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.sobol_indices import problem_of
    from ambkit.campaigns.study import load
    from ambkit.result.result import json_document

    return json_document(problem_of(Plan(load(study))))
