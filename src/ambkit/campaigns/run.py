"""A campaign: its parts computed here or on a cluster, written as they come, until it is enough."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import reporting
from ambkit.base.quantity_arguments import of_type
from ambkit.campaigns.campaign import Campaign
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.statistics import Share
from ambkit.campaigns.stopping_rule import Counted, looks_of
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study import Study, load
from ambkit.campaigns.worker import Rows, compute

Told = Callable[..., None]


def campaign(
    study: Study | str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    cluster: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
    done: Told | None = None,
) -> Campaign:
    """Simulate the machines of a study, as ``ambkit campaign`` does.

    The rows follow from the study alone, bit for bit: not from threads, order, cluster or from how
    often it was interrupted. A folder in which it was begun is gone on with.

    Parameters
    ----------
    study : Study or path
        What varies, and what is asked.
    folder : path, optional
        Where the rows are kept; by default named as the study's file, without its ending.
    cluster : str, optional
        ``"local"`` for processes of this machine, the address of a Dask scheduler, or ``"slurm"``;
        without it this process computes, in threads.
    workers : int, optional
        Processes of a cluster; by default as many as this machine has processors.
    threads : int, optional
        Of this process; by default as many as it may use.
    done : callable, optional
        Told by ``done(text, steps=n)`` of runs that are finished; a notebook shows a bar without.

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
    >>> found = ambkit.campaign("tolerances.toml", "out")
    >>> found.good
    Share(passed=1968, of=2000, low=0.977, high=0.989)
    """
    of_type(Study, str, os.PathLike, study=study)
    if folder is None:
        if isinstance(study, Study):
            raise AmbkitError("folder: say where the rows of a study from Python are to be kept")
        folder = Path(study).with_suffix("").name
    plan = Plan(load(study))
    plan.check()
    if cluster is None and workers is not None:
        raise AmbkitError("workers are of a cluster; without one there are threads")
    place = Folder(folder, plan)
    with place.held():
        place.begin()
        counted = Counted(place)
        reporter = reporting(done, plan.study.name, plan.runs, unit="runs", begun=counted.runs)
        with reporter as tell, _hands(cluster, workers, threads, tell) as computed:
            for end in looks_of(plan):
                missing = [part for part in range(end) if part not in counted.passed]
                for part, rows in computed(plan, missing):
                    place.write(part, rows)
                    counted.add(part, rows.runs.column("passed").to_numpy(zero_copy_only=False))
                if counted.enough(end):
                    break
    return Campaign(Path(folder), plan, tuple(range(end)))


def begun_in(study: Study, folder: str | os.PathLike[str]) -> tuple[int, int]:
    """Return how many runs of a study a folder has already, and of how many."""
    plan = Plan(study)
    there = Folder(folder, plan).done()
    return sum(stop - first for first, stop in map(plan.span, there)), plan.runs


Hands = Callable[[Plan, list[int]], Iterator[tuple[int, Rows]]]


@contextmanager
def _hands(
    cluster: str | None, workers: int | None, threads: int | None, tell: Told
) -> Iterator[Hands]:
    """Give what computes parts, in no order, and tells of their runs: this process or a cluster."""
    if cluster is None:

        def here(plan: Plan, parts: list[int]) -> Iterator[tuple[int, Rows]]:
            for part in parts:
                yield part, _here(plan, part, threads, tell)

        yield here
        return
    from ambkit.campaigns.cluster import PATIENCE, of, scheduler

    with scheduler(cluster, workers) as address:

        def there(plan: Plan, parts: list[int]) -> Iterator[tuple[int, Rows]]:
            for part, rows in of(address, plan, parts, 0.0 if cluster == "local" else PATIENCE):
                yield part, rows
                tell("", steps=rows.runs.num_rows)

        yield there


def _here(plan: Plan, part: int, threads: int | None, tell: Told) -> Rows:
    first, stop = plan.span(part)
    told = 0

    def count(runs: int) -> None:
        nonlocal told
        told += runs
        tell("", steps=runs)

    rows = compute(plan, first, stop, threads=threads, done=count)
    tell("", steps=stop - first - told)  # those that cannot be flown
    return rows


class Status(NamedTuple):
    """How far a campaign is."""

    name: str  #: Of the study.
    runs: int  #: Finished, and at most.
    of: int
    parts: int  #: Finished.
    good: Share  #: The yield so far.
    complete: bool  #: Whether nothing is left to be done.


def status(folder: str | os.PathLike[str]) -> Status:
    """Return how far the campaign in a folder is; one that is at work is not disturbed."""
    place = Folder.existing(folder)
    plan, counted = place.plan, Counted(place)
    parts = counted.counting()
    good, complete = counted.share(parts), counted.end is not None
    return Status(plan.study.name, counted.runs, plan.runs, len(parts), good, complete)
