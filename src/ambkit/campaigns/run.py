"""A campaign: its parts computed here or on a cluster, and written as they come."""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from ambkit.base.errors import AmbkitError, library
from ambkit.base.progress import Step, silent
from ambkit.base.quantity_arguments import of_type
from ambkit.campaigns.campaign import Campaign
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.results import Counted, looks_of
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study import Study, load
from ambkit.campaigns.worker import Rows, compute, part_of, versions
from ambkit.estimate.batch import processors
from ambkit.result.result import Statement

AHEAD = 3  #: Parts that wait for each thread of the cluster, so that none runs dry.

PATIENCE = 60.0  #: How long a scheduler may be away before the campaign gives up [s].


def of(
    scheduler: Any, plan: Plan, parts: Iterable[int], patience: float = 0.0
) -> Iterator[tuple[int, Rows]]:
    """Yield parts as the workers of a cluster finish them, in no order."""
    # A worker that dies has its parts computed by others; where the scheduler goes away and comes
    # back, the parts that were not finished are given to it again.
    from concurrent.futures import CancelledError

    from distributed import Client, KilledWorker
    from distributed.comm.core import CommClosedError

    left = dict.fromkeys(parts)
    pickled = pickle.dumps(plan)
    away = None
    while left:
        try:
            wait = min(patience, 10.0) or 10.0
            with Client(scheduler, timeout=wait, set_as_default=False) as client:
                for part, rows in _from(client, plan, pickled, list(left)):
                    away = None
                    del left[part]
                    yield part, rows
        except KilledWorker as error:
            raise AmbkitError(f"a part stopped its workers: {error}") from None
        except (OSError, CommClosedError, CancelledError) as error:
            away = away or time.monotonic()
            if time.monotonic() - away >= patience:
                raise AmbkitError(
                    f"{scheduler}: no answer from the scheduler ({type(error).__name__}); "
                    "finished parts are kept; the same command resumes"
                ) from None
            time.sleep(0.5)


def _from(client: Any, plan: Plan, pickled: bytes, parts: list[int]) -> Iterator[tuple[int, Rows]]:
    """Yield parts from a cluster, with never more under way than it can hold in its hands."""
    from distributed import as_completed

    threads = sum(client.nthreads().values()) or 1
    waiting = iter(parts)

    def given(part: int) -> Any:
        # Pure, under a name of its own: a part that is asked for twice is computed once.
        key = f"{plan.fingerprint[:16]}-{part}"
        return client.submit(part_of, pickled, part, versions(), key=key, retries=2)

    futures = {given(part): part for part in islice(waiting, AHEAD * threads)}
    queue = as_completed(list(futures), loop=client.loop)
    for future in queue:
        if future.status in ("cancelled", "lost"):
            raise ConnectionError("the scheduler lost a part")
        rows = future.result()
        part = futures.pop(future)
        future.release()
        threads = sum(client.nthreads().values()) or threads
        while len(futures) < AHEAD * threads and (more := next(waiting, None)) is not None:
            another = given(more)
            futures[another] = more
            queue.add(another)
        yield part, rows


@contextmanager
def scheduler(where: str, workers: int | None = None) -> Iterator[Any]:
    """Give a cluster of our own, or the address of one."""
    distributed = library("distributed", "--cluster", "campaign")
    if where == "local":
        with distributed.LocalCluster(
            n_workers=workers or processors(),
            threads_per_worker=1,
            dashboard_address=None,
            silence_logs=50,
        ) as cluster:
            yield cluster
    elif where == "slurm":
        with _slurm() as cluster:
            cluster.scale(workers or 1)
            yield cluster
    else:
        yield where


def _slurm() -> Any:
    """Return a cluster whose workers are jobs of Slurm, as the user's Dask configuration has it."""
    jobs = library("dask_jobqueue", "--cluster slurm", "campaign", "dask-jobqueue")
    try:
        return jobs.SLURMCluster()
    except (TypeError, ValueError, OSError) as error:
        raise AmbkitError(
            f"--cluster slurm: {error}; describe a job in ~/.config/dask/jobqueue.yaml: cores, "
            "memory, queue, walltime"
        ) from None


def campaign(
    study: Study,
    folder: str | os.PathLike[str],
    *,
    cluster: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
    done: Step = silent,
) -> Campaign:
    """Simulate the machines of a study, or go on where that was interrupted."""
    # The rows follow from the study alone, bit for bit: not from threads, order, cluster or from
    # how often it was interrupted.
    plan = Plan(study)
    plan.check()
    if cluster is None and workers is not None:
        raise AmbkitError("workers are of a cluster; without one there are threads")
    place = Folder(folder, plan)
    with place.held():
        place.begin()
        counted = Counted(place)
        with _hands(cluster, workers, threads, done) as computed:
            for end in looks_of(plan):
                missing = [part for part in range(end) if part not in counted.passed]
                for part, rows in computed(plan, missing):
                    place.write(part, rows)
                    counted.add(part, rows.runs.column("passed").to_numpy(zero_copy_only=False))
                if counted.enough(end):
                    break
    return Campaign(Path(folder), plan, tuple(range(end)))


class Begun(NamedTuple):
    """A study, its folder, how many runs that has already, and of how many."""

    study: Study
    folder: Path
    runs: int
    of: int


def begun(study: Study | str | os.PathLike[str], folder: str | os.PathLike[str] | None) -> Begun:
    """Return how far a campaign has come; without a folder it is named as the study's file."""
    of_type(Study, str, os.PathLike, study=study)
    if folder is None:
        if isinstance(study, Study):
            raise AmbkitError("folder: a study from Python needs a folder for its results")
        folder = Path(study).with_suffix("").name
    known = load(study)
    plan = Plan(known)
    there = Folder(folder, plan).done()
    runs = sum(stop - first for first, stop in map(plan.span, there))
    return Begun(known, Path(folder), runs, plan.runs)


Hands = Callable[[Plan, list[int]], Iterator[tuple[int, Rows]]]


@contextmanager
def _hands(
    cluster: str | None, workers: int | None, threads: int | None, tell: Step
) -> Iterator[Hands]:
    """Give what computes parts, in no order, and tells of their runs: this process or a cluster."""
    if cluster is None:
        yield partial(_here, threads=threads, tell=tell)
        return

    with scheduler(cluster, workers) as address:

        def there(plan: Plan, parts: list[int]) -> Iterator[tuple[int, Rows]]:
            for part, rows in of(address, plan, parts, 0.0 if cluster == "local" else PATIENCE):
                yield part, rows
                tell("", steps=rows.runs.num_rows)

        yield there


def _here(
    plan: Plan, parts: list[int], *, threads: int | None, tell: Step
) -> Iterator[tuple[int, Rows]]:
    for part in parts:
        first, stop = plan.span(part)
        told = 0

        def count(runs: int) -> None:
            nonlocal told
            told += runs
            tell("", steps=runs)

        rows = compute(plan, first, stop, threads=threads, done=count)
        tell("", steps=stop - first - told)  # those that cannot be flown
        yield part, rows


def status(folder: str | os.PathLike[str]) -> Statement:
    """State how far the campaign in a folder is; one that is at work is not disturbed."""
    place = Folder.existing(folder)
    plan, counted = place.plan, Counted(place)
    parts = counted.counting()
    good, complete = counted.share(parts), counted.end is not None
    state = "finished" if complete else "not finished"
    left = "" if complete else f" of {plan.runs:,}"
    return Statement(
        f"{plan.study.name}: {state}, {counted.runs:,}{left} runs in {len(parts)} parts, "
        f"good {good}",
        {"name": plan.study.name, "runs": counted.runs, "of": plan.runs, "parts": len(parts),
         "good": good._asdict(), "complete": complete},
    )  # fmt: skip
