"""Thousands of machines sampled from their tolerances."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.verbs.words import Above, Cluster, Folder, Study

if TYPE_CHECKING:
    from ambkit.campaigns.campaign import Campaign
    from ambkit.campaigns.replay import Replayed
    from ambkit.result.document import Document, Statement


def campaign(
    study: Study,
    folder: Folder | None = None,
    *,
    cluster: Cluster | None = None,
    workers: int | None = None,
    threads: int | None = None,
) -> Campaign:
    """Simulate thousands of machines within their tolerances.

    Which share is good, which is the worst, and what drives it. A folder in which the study was
    begun is gone on with. The rows follow from the study alone, to the last bit: not from threads,
    order or cluster. They are Parquet, in the folder's runs.

    Parameters
    ----------
    study : Study, str or path
        TOML file that says what varies, and what is wanted.
    folder : str or path, optional
        Where the rows are kept; by default named as the study's file, without its ending.
    cluster : str, optional
        Dask: local for processes of this machine, the address of a scheduler (tcp://...), or slurm;
        by default threads of this process.
    workers : int, optional
        Processes, or jobs of slurm, of that cluster.
    threads : int, optional
        Of this process; by default as many as it may use.

    Returns
    -------
    Campaign
        With yield, worst machines, what drives them, tables and pictures.

    Raises
    ------
    AmbkitError
        The study is not valid, the folder is of another one or of another version of ambkit, or it
        cannot be written; the cluster does not answer.

    Examples
    --------
    $ ambkit campaign run tolerances.toml --folder out --out out.html
    $ ambkit campaign run tolerances.toml --folder out --cluster local
    """
    import logging

    from ambkit.base.progress import interrupted_says, progress
    from ambkit.campaigns import run

    known, place, begun, of = run.begun(study, folder)
    again = f"finished parts are kept in {place}, the same command goes on"
    with interrupted_says(again), progress(known.name, of, unit="runs", begun=begun) as done:
        result = run.campaign(
            known, place, cluster=cluster, workers=workers, threads=threads, done=done
        )
    logging.getLogger("ambkit").info("rows in %s", result.runs)
    return result


def campaign_status(folder: Folder) -> Statement:
    """Report how far a campaign is, also while it is at work.

    Parameters
    ----------
    folder : str or path
        Of the campaign.

    Returns
    -------
    Statement
        Its runs, parts and yield so far.

    Raises
    ------
    AmbkitError
        There is no campaign in it, or it is of another version of ambkit.

    Examples
    --------
    $ ambkit campaign status out
    """
    from ambkit.campaigns.run import status

    return status(folder).stated()


def campaign_report(folder: Folder) -> Campaign:
    """Report the results of a campaign, finished or not.

    Parameters
    ----------
    folder : str or path
        Of the campaign.

    Returns
    -------
    Campaign
        As of `ambkit campaign run`.

    Raises
    ------
    AmbkitError
        There is no campaign in it, or it is of another version of ambkit.

    Examples
    --------
    $ ambkit campaign report out --out report.html
    """
    from ambkit.campaigns.campaign import Campaign

    return Campaign.load(folder)


def campaign_replay(folder: Folder, run: int) -> Replayed:
    """Simulate one run of a campaign again, with every sample.

    Parameters
    ----------
    folder : str or path
        Of the campaign.
    run : int
        Number of the run.

    Returns
    -------
    Replayed
        Record, estimate, and the machine that was drawn.

    Raises
    ------
    AmbkitError
        There is no such run, or no such machine can be.

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
    """Estimate the probability of a rare failure.

    By subset simulation, with what varies in the campaign's study. The report has it then.

    Parameters
    ----------
    folder : str or path
        Of the campaign.
    figure : str
        Figure of a run, such as peak_S.
    above : float or str
        It fails at or above this, such as 5 or "0.8 mm".
    budget : int, optional
        Number of runs of each level.
    seed : int, optional
        Random seed.
    threads : int, optional
        Of this process; by default as many as it may use.

    Returns
    -------
    Statement
        The probability, with its interval.

    Raises
    ------
    AmbkitError
        There is no such figure, the limit has another unit, or the study has no probabilities.

    Examples
    --------
    $ ambkit campaign rare out --figure peak_S --above 5
    """
    from ambkit.base.progress import progress
    from ambkit.campaigns import subset_simulation

    with progress("levels of rare failures", unit="runs") as done:
        return subset_simulation.rare_in_folder(
            folder, figure, above, runs=budget, seed=seed, threads=threads, done=done
        )


def campaign_problem(study: Study) -> Document:
    """Print what varies as SALib's problem dictionary, in JSON and SI.

    Parameters
    ----------
    study : Study, str or path
        TOML file that says what varies, and what is wanted.

    Returns
    -------
    Document
        The dictionary.

    Raises
    ------
    AmbkitError
        The study is not valid.

    Examples
    --------
    $ ambkit campaign problem tolerances.toml > problem.json
    """
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.salib import problem_of
    from ambkit.campaigns.study import load
    from ambkit.result.document import json_document

    return json_document(problem_of(Plan(load(study))))
