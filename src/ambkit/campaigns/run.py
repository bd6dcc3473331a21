"""Execution of a campaign: parts computed here or on a cluster, and written as they finish."""

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
from ambkit.campaigns.results import StoppingRule, interim_analyses
from ambkit.campaigns.store import Folder
from ambkit.campaigns.study import Study, load
from ambkit.campaigns.worker import Rows, compute, part_of, versions
from ambkit.estimate.batch import processors
from ambkit.result.result import Statement

AHEAD = 3  #: Queued parts per thread of the cluster, so that none is idle.

PATIENCE = 60.0  #: Maximum absence of a scheduler before the campaign fails [s].


def of(
    scheduler: Any, plan: Plan, parts: Iterable[int], patience: float = 0.0
) -> Iterator[tuple[int, Rows]]:
    """Yield parts as the workers of a cluster finish them, in any order."""
    # Parts of a worker that dies are computed by others; if the scheduler restarts, the unfinished
    # parts are submitted again.
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
    """Yield parts from a cluster, with a limited number in progress."""
    from distributed import as_completed

    threads = sum(client.nthreads().values()) or 1
    waiting = iter(parts)

    def submitted(part: int) -> Any:
        # Pure, under a fixed key: a part that is submitted twice is computed once.
        key = f"{plan.fingerprint[:16]}-{part}"
        return client.submit(part_of, pickled, part, versions(), key=key, retries=2)

    futures = {submitted(part): part for part in islice(waiting, AHEAD * threads)}
    queue = as_completed(list(futures), loop=client.loop)
    for future in queue:
        if future.status in ("cancelled", "lost"):
            raise ConnectionError("the scheduler lost a part")
        rows = future.result()
        part = futures.pop(future)
        future.release()
        threads = sum(client.nthreads().values()) or threads
        while len(futures) < AHEAD * threads and (more := next(waiting, None)) is not None:
            another = submitted(more)
            futures[another] = more
            queue.add(another)
        yield part, rows


@contextmanager
def scheduler(where: str, workers: int | None = None) -> Iterator[Any]:
    """Yield a local cluster, or the address of a scheduler."""
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
    """Return a cluster of Slurm jobs, according to the user's Dask configuration."""
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
    """Simulate the machines of a study, or resume it."""
    # The rows depend on the study only, bit for bit: not on threads, order, cluster or
    # interruptions.
    plan = Plan(study)
    plan.check()
    if cluster is None and workers is not None:
        raise AmbkitError("workers are of a cluster; without one there are threads")
    place = Folder(folder, plan)
    with place.held():
        place.begin()
        counted = StoppingRule(place)
        with _executor(cluster, workers, threads, done) as computed:
            for end in interim_analyses(plan):
                missing = [part for part in range(end) if part not in counted.passed]
                for part, rows in computed(plan, missing):
                    place.write(part, rows)
                    counted.add(part, rows.runs.column("passed").to_numpy(zero_copy_only=False))
                if counted.enough(end):
                    break
    return Campaign(Path(folder), plan, tuple(range(end)))


class CampaignProgress(NamedTuple):
    """A study, its folder, and numbers of finished and of all runs."""

    study: Study
    folder: Path
    runs: int
    of: int


def campaign_progress(
    study: Study | str | os.PathLike[str], folder: str | os.PathLike[str] | None
) -> CampaignProgress:
    """Return the progress of a campaign; the default folder is named as the study's file."""
    of_type(Study, str, os.PathLike, study=study)
    if folder is None:
        if isinstance(study, Study):
            raise AmbkitError("folder: a study from Python needs a folder for its results")
        folder = Path(study).with_suffix("").name
    known = load(study)
    plan = Plan(known)
    on_cluster = Folder(folder, plan).done()
    runs = sum(stop - first for first, stop in map(plan.span, on_cluster))
    return CampaignProgress(known, Path(folder), runs, plan.runs)


Executor = Callable[[Plan, list[int]], Iterator[tuple[int, Rows]]]


@contextmanager
def _executor(
    cluster: str | None, workers: int | None, threads: int | None, tell: Step
) -> Iterator[Executor]:
    """Yield the executor of parts, which reports their runs: this process or a cluster."""
    if cluster is None:
        yield partial(_in_process, threads=threads, tell=tell)
        return

    with scheduler(cluster, workers) as address:

        def on_cluster(plan: Plan, parts: list[int]) -> Iterator[tuple[int, Rows]]:
            for part, rows in of(address, plan, parts, 0.0 if cluster == "local" else PATIENCE):
                yield part, rows
                tell("", steps=rows.runs.num_rows)

        yield on_cluster


def _in_process(
    plan: Plan, parts: list[int], *, threads: int | None, tell: Step
) -> Iterator[tuple[int, Rows]]:
    for part in parts:
        first, stop = plan.span(part)
        counted = 0

        def count(runs: int) -> None:
            nonlocal counted
            counted += runs
            tell("", steps=runs)

        rows = compute(plan, first, stop, threads=threads, done=count)
        tell("", steps=stop - first - counted)  # impossible machines
        yield part, rows


def status(folder: str | os.PathLike[str]) -> Statement:
    """Return the progress of the campaign in a folder, without disturbing one that runs."""
    place = Folder.existing(folder)
    plan, counted = place.plan, StoppingRule(place)
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
