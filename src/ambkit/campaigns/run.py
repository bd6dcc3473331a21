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
from ambkit.result.document import Statement

Told = Callable[..., None]


def campaign(
    study: Study,
    folder: str | os.PathLike[str],
    *,
    cluster: str | None = None,
    workers: int | None = None,
    threads: int | None = None,
    done: Told | None = None,
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
            raise AmbkitError("folder: say where the rows of a study from Python are to be kept")
        folder = Path(study).with_suffix("").name
    known = load(study)
    plan = Plan(known)
    there = Folder(folder, plan).done()
    runs = sum(stop - first for first, stop in map(plan.span, there))
    return Begun(known, Path(folder), runs, plan.runs)


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

    def stated(self) -> Statement:
        """Return it as a result."""
        state = "finished" if self.complete else "not finished"
        left = "" if self.complete else f" of {self.of:,}"
        return Statement(
            f"{self.name}: {state}, {self.runs:,}{left} runs in {self.parts} parts, "
            f"good {self.good}",
            self._asdict() | {"good": self.good._asdict()},
        )


def status(folder: str | os.PathLike[str]) -> Status:
    """Return how far the campaign in a folder is; one that is at work is not disturbed."""
    place = Folder.existing(folder)
    plan, counted = place.plan, Counted(place)
    parts = counted.counting()
    good, complete = counted.share(parts), counted.end is not None
    return Status(plan.study.name, counted.runs, plan.runs, len(parts), good, complete)
