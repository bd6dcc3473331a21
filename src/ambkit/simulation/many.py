"""Many closed loops of the nonlinear plant in one call, for Monte Carlo and campaigns."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import name_of
from ambkit.estimate.batch import processors
from ambkit.machine.machine import Machine
from ambkit.simulation.lanes import Counts, Lanes
from ambkit.simulation.planned import Planned, copied
from ambkit.simulation.run_figures import FLAGS, figures_for, figures_of, flags_of

CHUNK = 256
"""Runs that are planned and flown together: many times as many as there are lanes."""


@dataclass(frozen=True)
class Many:
    """What many runs gave, in their order."""

    #: (runs,) By the names of :data:`FIGURES`, in SI; NaN where one does not apply.
    figures: Mapping[str, Array]
    #: (runs,) By the names of :class:`ambkit.Status` in lower case: samples at which it was said.
    status: Mapping[str, Counts]

    @classmethod
    def none(cls, figures: Iterable[str]) -> Many:
        """Return what no runs gave, by the names of their figures."""
        return cls(_columns(figures, (), float), _columns(FLAGS, (), np.int64))

    def __len__(self) -> int:
        return len(self.figures["touched"])

    def columns(self) -> dict[str, Array | Counts]:
        """Return all figures and, as ``samples_missing`` and so on, the counts of flags."""
        return {**self.figures, **{f"samples_{name}": n for name, n in self.status.items()}}


def simulate_many(
    runs: Iterable[Planned],
    *,
    settling: float = 0.0,
    band: float = 0.05,
    threads: int | None = None,
    instructions: str | None = None,
    done: Callable[[int], None] | None = None,
) -> Many:
    """Simulate many closed loops and judge each by the truth, without keeping its samples.

    The numbers are those of `simulate_run`, run by run and to the last bit, whatever the order, the
    threads, the lanes and what else is in the batch.

    Parameters
    ----------
    runs : iterable of Planned
        All of one axis, or all of several; else any mixture. Taken one after another, so that 10^6
        of them need not be there at once.
    settling : float
        Time at the start of each run that errors leave out [s]; the first sample always is.
    band : float
        Control error that a rotor has recovered within, as a share of its clearance.
    threads : int, optional
        Default: as many as the process may use.
    instructions : str, optional
        One of `ambkit.estimate.batch.instruction_sets`, of runs of one axis; default: the fastest.
    done : callable, optional
        Called now and then with the number of runs that were finished since the last call.

    Returns
    -------
    Many

    Raises
    ------
    ValueError
        A run has no sample after the settling, or some runs have one axis and others several.

    Examples
    --------
    >>> bearing = ambkit.Bearing.preset("zittau_axial")
    >>> scenario = ambkit.Scenario(duration=0.1, seed=1)
    >>> kalman = ambkit.KalmanFilter(bearing)
    >>> runs = [Planned(bearing, scenario, kalman, number=k) for k in range(20)]
    >>> simulate_many(runs).figures["f_d_rms"].shape
    (20,)
    """
    threads = processors() if threads is None else threads
    machine, planned = _parted(runs)
    if machine is None or machine.single:
        figures, flags = _in_lanes(planned, Lanes(settling, band, threads, instructions), done)
    else:
        figures, flags = _in_threads(planned, settling, band, threads, done)
    return Many(_columns(figures_for(machine), figures, float), _columns(FLAGS, flags, np.int64))


_Judged = tuple[Sequence[Array], Sequence[Counts]]
"""Tables of figures, and of counts of flags."""


def _parted(runs: Iterable[Planned]) -> tuple[Machine | None, Iterator[Planned]]:
    """Return the machine of the first run, and the runs; each is checked when it is taken."""
    parts = iter(runs)
    first = next(parts, None)
    if first is None:
        return None, parts
    single = first.bearing.single

    def alike() -> Iterator[Planned]:
        for run in chain([first], parts):
            if run.bearing.single != single:
                raise ValueError("runs must all have one axis, or all several")
            own = run.scenario.controller.custom or run.scenario.plant
            if single and own is not None:  # the lanes are C throughout
                raise AmbkitError(
                    f"{name_of(own)}: a class of yours runs one at a time: use simulate"
                )
            yield run

    return first.bearing, alike()


def _in_threads(
    runs: Iterator[Planned], settling: float, band: float, threads: int,
    done: Callable[[int], None] | None,
) -> _Judged:  # fmt: skip
    """Fly runs of several axes: while one is in C, another is got ready."""
    own = threading.local()  # an estimator has a state: each thread has its own

    def fly(planned: Planned) -> tuple[list[float], list[int]]:
        if not hasattr(own, "estimators"):
            own.estimators = {}
        estimator = planned.estimator
        if estimator is not None:
            known = own.estimators.get(id(estimator))
            estimator = known or own.estimators.setdefault(id(estimator), copied(estimator))
        run = planned._flown(estimator)
        return list(figures_of(run, planned.estimator, settling, band).values()), flags_of(run)

    rows, flags = list[Array](), list[Counts]()
    with ThreadPoolExecutor(threads) as pool:
        for row, flag_counts in pool.map(fly, runs):
            rows.append(np.array([row]))
            flags.append(np.array([flag_counts], np.int64))
            if done is not None:
                done(1)
    return rows, flags


def _in_lanes(
    runs: Iterator[Planned], engine: Lanes, done: Callable[[int], None] | None
) -> _Judged:
    """Fly runs of one axis, many at once in C."""
    parts: list[tuple[Array, Counts]] = []
    # While some are flown, the next ones are planned: C needs no interpreter.
    ahead: Future[tuple[Array, Counts]] | None = None
    last = 0
    with ThreadPoolExecutor(1) as pilot:

        def landed() -> None:
            if ahead is not None:
                parts.append(ahead.result())
                if done is not None:
                    done(last)

        while chunk := list(islice(runs, CHUNK)):
            ready = engine.ready(chunk)
            landed()
            ahead, last = pilot.submit(engine.flown, ready), len(chunk)
        landed()
    figures, flags = zip(*parts, strict=True) if parts else ((), ())
    return figures, flags


def _columns(names: Iterable[str], parts: Sequence[NDArray[Any]], kind: Any) -> dict[str, Any]:
    """Return each column of tables that stand one below the other."""
    return {
        name: np.concatenate([part[:, k] for part in parts]) if parts else np.empty(0, kind)
        for k, name in enumerate(names)
    }
