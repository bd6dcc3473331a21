"""Parts of a study computed by the workers of a Dask cluster: the same code, the same numbers.

A task is a part of hundreds of runs, since Dask takes milliseconds for each. Rows come back to the
process that asked, which alone writes: workers need neither the folder nor the study's files.
"""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError, ExtraMissing
from ambkit.campaigns.worker import Rows, part_of, versions

if TYPE_CHECKING:
    from ambkit.campaigns.plan import Plan

AHEAD = 3
"""Parts that wait for each thread of the cluster, so that none runs dry."""

PATIENCE = 60.0
"""How long a scheduler may be away before the campaign gives up [s]."""


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
            raise AmbkitError(f"a part took its workers down: {error}") from None
        except (OSError, CommClosedError, CancelledError) as error:
            away = away or time.monotonic()
            if time.monotonic() - away >= patience:
                raise AmbkitError(
                    f"{scheduler}: the scheduler does not answer ({type(error).__name__}); "
                    "finished parts are kept, the same command goes on"
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
            raise ConnectionError("the scheduler has lost what it was given")
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
    try:
        from distributed import LocalCluster
    except ImportError:
        raise ExtraMissing("--cluster", "distributed", "campaign") from None
    if where == "local":
        count = workers or len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (
            workers or os.cpu_count() or 1
        )  # fmt: skip
        with LocalCluster(
            n_workers=count, threads_per_worker=1, dashboard_address=None, silence_logs=50
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
    try:
        from dask_jobqueue import SLURMCluster
    except ImportError:
        raise ExtraMissing("--cluster slurm", "dask-jobqueue", "campaign") from None
    try:
        return SLURMCluster()
    except (TypeError, ValueError, OSError) as error:
        raise AmbkitError(
            f"--cluster slurm: {error}; say what a job is in ~/.config/dask/jobqueue.yaml: cores, "
            "memory, queue, walltime"
        ) from None
