"""Who takes part: a name, how many samples, and a call that is timed as a whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

import ambkit
from ambkit.estimate.registry import KINDS
from benchmarks.closed_loop import ClosedLoop
from benchmarks.hand import HandLoop, Outputs
from benchmarks.work import NOISE, Work

HAND = "hand loop in C, into arrays that are there"
HAND_NEW = "hand loop in C, into new arrays"
GIVEN = "ambkit `core.run(y, u, k_i, k_s)`"
CONSTANT = "ambkit `KalmanFilter.run(record)`"
STEP = "ambkit `KalmanFilter.step(y, u)`, a call a sample"
STEP_NUMBA = "numba, structured, a call a sample"
EXTENDED = "ambkit, extended, closed law, `run(record)`"
UNSCENTED = "ambkit, unscented, closed law, `run(record)`"
RULES = "ambkit, 25 exact rules, `run(record)`"
TEXTBOOK = "numba, textbook Runge-Kutta"
ARRANGED = "numba, arranged as `sim/plant.c`"
LOOP = "ambkit `core.simulate`"


@dataclass(frozen=True)
class Entry:
    """One that takes part; `run` returns the means (samples, 4)."""

    name: str
    samples: int
    run: Callable[[], ArrayLike]
    cores: int = 1  # among which its processor time is divided


def in_c(work: Work) -> list[Entry]:
    """Linear filter with k_i, k_s given for each sample: the yardstick and the core."""
    n, hand, kept = work.y.size, HandLoop(), Outputs.empty(work.y.size)
    double = ambkit.KalmanFilter(work.bearing, noise=NOISE)
    single = ambkit.KalmanFilter(work.bearing, noise=NOISE, precision="float32")
    narrow = [a.astype(np.float32) for a in (work.y, work.u, work.k_i, work.k_s)]

    def core(kf: ambkit.KalmanFilter, arrays: list[np.ndarray]) -> ArrayLike:
        kf.reset(work.mean, work.std.tolist())
        return kf.core.run(*arrays)["mean"]  # type: ignore[no-any-return]

    return [
        Entry(HAND, n, lambda: hand(work, kept)),
        Entry(HAND_NEW, n, lambda: hand(work, Outputs.empty(n))),
        Entry(GIVEN, n, lambda: core(double, [work.y, work.u, work.k_i, work.k_s])),
        Entry("the same, float32 build", n, lambda: core(single, narrow)),
    ]


def in_numba(work: Work) -> list[Entry]:
    """The same work in numba."""
    from benchmarks import numba_filters

    n = work.y.size
    return [
        Entry("numba, structured by hand", n, lambda: numba_filters.structured_run(work)),
        Entry("numba, dense matrices", n, lambda: numba_filters.dense_run(work)),
    ]


def in_python(work: Work, samples: int) -> list[Entry]:
    """The same work, on fewer samples, with NumPy and filterpy."""
    from benchmarks import python_filters

    few = work.first(samples)
    return [
        Entry("NumPy", samples, lambda: python_filters.numpy_run(few)),
        Entry("filterpy", samples, lambda: python_filters.filterpy_run(few)),
    ]


def constant(work: Work, samples: int) -> list[Entry]:
    """The public linear filter, which asks its magnet for the constant stiffnesses."""
    kf = ambkit.KalmanFilter(work.bearing, noise=NOISE)
    few = work.first(samples)
    y, u = few.y.tolist(), few.u.tolist()

    def by_sample() -> ArrayLike:
        kf.reset(work.mean, work.std.tolist())
        first = kf.update(y[0])
        return [first] + [kf.step(*pair) for pair in zip(y[1:], u[:-1], strict=True)]

    return [
        Entry(CONSTANT, work.y.size, lambda: kf.run(work.record).mean),
        Entry(STEP, samples, by_sample),
    ]


def numba_by_sample(work: Work, samples: int) -> list[Entry]:
    """The same in numba: a call for each sample from Python, which returns a new mean."""
    from benchmarks import numba_filters as nf

    k = ambkit.ConstantStiffness.of(work.bearing)
    few = replace(work.first(samples), k_i=np.full(samples, k.k_i), k_s=np.full(samples, k.k_s))
    y, u, step = few.y.tolist(), few.u.tolist(), nf.stepper(few)
    kf = ambkit.KalmanFilter(work.bearing, noise=NOISE)
    kf.reset(work.mean, work.std.tolist())
    first = kf.update(y[0])
    start = np.concatenate([first, kf.core.covariance[np.triu_indices(4)]])

    def run() -> ArrayLike:
        state = start.copy()
        return [first] + [step(state, *pair) for pair in zip(y[1:], u[:-1], strict=True)]

    return [Entry(STEP_NUMBA, samples, run)]


def nonlinear(work: Work) -> list[Entry]:
    """The extended and the unscented filter on the closed law, along the record."""
    entries = []
    for name in ("extended", "unscented"):
        kf = KINDS[name].make(work.bearing, noise=NOISE)
        entries.append(Entry(f"ambkit, {name}, closed law, `run(record)`", work.y.size,
                             lambda kf=kf: kf.run(work.record).mean))  # fmt: skip
    return entries


def adaptive(work: Work, expert: ambkit.Expert) -> list[Entry]:
    """The public adaptive filter with each model of the magnet."""

    def entry(name: str, kf: ambkit.KalmanFilter) -> Entry:
        return Entry(name, work.y.size, lambda: kf.run(work.record).mean)

    bearing, adapted = work.bearing, ambkit.AdaptiveKalmanFilter
    table = ambkit.stiffness_map(bearing)
    law = ambkit.ClosedLaw(bearing)
    return [
        entry("ambkit, closed law, `run(record)`", adapted(bearing, law, noise=NOISE)),
        entry("ambkit, table of 25 nodes, `run(record)`", adapted(bearing, table, noise=NOISE)),
        entry(RULES, adapted(bearing, expert, noise=NOISE)),
        entry(
            "the same, float32 build", adapted(bearing, expert, noise=NOISE, precision="float32")
        ),
    ]


def rules_in_numba(work: Work, expert: ambkit.Expert) -> list[Entry]:
    """The adaptive filter with 25 rules in numba."""
    from benchmarks import numba_filters as nf

    rules, start = nf.Rules.of(expert), nf.start_of(work)

    def run() -> ArrayLike:
        return nf.with_rules(work.settings, rules, start, work.y, work.u)

    return [Entry("numba, structured, 25 rules", work.y.size, run)]


def loops(loop: ClosedLoop) -> list[Entry]:
    """The simulated closed loop in C, bare and with all that makes a record."""
    n = loop.r.size

    def core() -> ArrayLike:
        return loop.core_run()["estimate"]["mean"]  # type: ignore[no-any-return]

    return [
        Entry(LOOP, n, core),
        Entry("ambkit `simulate(bearing, scenario)`", n, lambda: loop.public_run().mean),
    ]


def loops_in_numba(loop: ClosedLoop) -> list[Entry]:
    """The same loop in numba, with the plant's step written in two ways."""
    from benchmarks import numba_loop as nl

    n = loop.r.size
    return [
        Entry(TEXTBOOK, n, lambda: nl.run(loop, nl.TEXTBOOK)[1]),
        Entry(ARRANGED, n, lambda: nl.run(loop, nl.ARRANGED)[1]),
    ]
