"""Many filters at once: SIMD lanes and threads against one loop by hand, run after run."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
from numpy.typing import ArrayLike, NDArray

import ambkit
from ambkit.estimate.batch import instruction_sets, run_many
from benchmarks.entries import Entry
from benchmarks.hand import HandLoop, Outputs
from benchmarks.work import NOISE, Work

Array = NDArray[np.float64]

HAND = "hand loop in C, run after run, into arrays that are there"
ERRORS = "ambkit `run_many`, only the errors kept"
MEANS = "ambkit `run_many`, every mean kept, into arrays that are there"

CORES = len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Many:
    """Runs of the same filter along records of n samples, with the stiffnesses of the origin."""

    work: Work
    y: Array  # (runs, n)
    u: Array  # (runs, n)
    truth: Array  # (n, 3)

    @classmethod
    def of(cls, work: Work, runs: int, samples: int) -> Many:
        """Take the first samples of the work, with other noise on the measurement in each run."""
        first = work.first(samples)
        k = ambkit.ConstantStiffness.of(work.bearing)
        constant = {"k_i": np.full(samples, k.k_i), "k_s": np.full(samples, k.k_s)}
        rng = np.random.default_rng(11)
        y = first.y + rng.normal(scale=np.sqrt(work.settings.r), size=(runs, samples))
        truth = np.column_stack([work.record[name][:samples] for name in ("x", "v", "f_d")])
        return cls(replace(first, **constant), y, np.tile(first.u, (runs, 1)), truth)

    def each(self) -> list[Work]:
        """Return the runs one by one."""
        return [replace(self.work, y=y) for y in self.y]

    @property
    def samples(self) -> int:
        return self.y.size


def by_hand(many: Many) -> list[Entry]:
    """The yardstick: one thread, its outputs the same for all runs, and so in the cache."""
    hand, works, kept = HandLoop(), many.each(), Outputs.empty(many.y.shape[1])

    def run() -> ArrayLike:
        for work in works:
            hand(work, kept)
        return kept.mean

    return [Entry(HAND, many.samples, run)]


def side_by_side(many: Many) -> list[Entry]:
    """`run_many` on all cores, and on one with each set of instructions."""
    kf = ambkit.KalmanFilter(many.work.bearing, noise=NOISE)
    start = many.work.mean, many.work.std
    y, u = many.y, many.u
    first = run_many(kf, y, u, start=start)

    def means(threads: int, instructions: str | None = None) -> Callable[[], ArrayLike]:
        return lambda: run_many(
            kf, y, u, start=start, out=first, threads=threads, instructions=instructions
        ).mean[-1]  # type: ignore[index]

    def errors() -> ArrayLike:
        rmse = run_many(kf, y, u, truth=many.truth, history=(), start=start, threads=CORES).rmse
        assert rmse is not None
        return rmse

    def fresh() -> ArrayLike:
        return run_many(kf, y, u, start=start, threads=CORES).mean[-1]  # type: ignore[index]

    n = many.samples
    return [
        Entry(ERRORS, n, errors, CORES),
        Entry(MEANS, n, means(CORES), CORES),
        Entry("the same, into new arrays", n, fresh, CORES),
        *(
            Entry(f"one thread, every mean kept, {name}", n, means(1, name))
            for name in instruction_sets()
        ),
    ]


def numba_parallel(many: Many) -> list[Entry]:
    """The structured filter of numba_filters.py, over the runs in parallel."""
    from benchmarks import numba_filters as nf

    work = many.work
    start, out = nf.start_of(work), np.empty((*many.y.shape, 4))

    def run() -> ArrayLike:
        nf.parallel(work.settings, start, many.y, many.u, work.k_i, work.k_s, out)
        return out[-1]

    return [Entry("numba, structured, runs in parallel", many.samples, run, CORES)]


def libraries(many: Many, runs: int, samples: int) -> tuple[list[Entry], list[str]]:
    """Those that are installed, on fewer runs and samples; and the names of those that are not."""
    few = replace(
        many,
        work=replace(
            many.work.first(samples), k_i=many.work.k_i[:samples], k_s=many.work.k_s[:samples]
        ),
        y=np.ascontiguousarray(many.y[:runs, :samples]),
        u=np.ascontiguousarray(many.u[:runs, :samples]),
    )
    result, missing = [], []
    for name in ("jax", "simdkalman", "statsmodels"):
        if find_spec(name) is None:
            missing.append(name)
        else:
            result += _LIBRARIES[name](few)
    return result, missing


def _jax(few: Many) -> list[Entry]:
    from benchmarks import library_filters

    run = library_filters.jax_batch(few.work, few.y, few.u)
    return [Entry("JAX, `vmap` over the runs of a `scan`", few.samples, lambda: run()[-1], CORES)]


def _simdkalman(few: Many) -> list[Entry]:
    from benchmarks import library_filters

    run = library_filters.simdkalman_batch(few.work, few.y, few.u)
    return [Entry("simdkalman", few.samples, lambda: run()[-1])]


def _statsmodels(few: Many) -> list[Entry]:
    from benchmarks import library_filters

    run = library_filters.statsmodels_run(few.work, few.y[-1], few.u[-1])
    return [Entry("statsmodels, one run, in micrometres", few.y.shape[1], run)]


_LIBRARIES: dict[str, Callable[[Many], list[Entry]]] = {
    "jax": _jax,
    "simdkalman": _simdkalman,
    "statsmodels": _statsmodels,
}
