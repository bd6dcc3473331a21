"""Many closed loops of the nonlinear plant, with the linear filter in them: runs a second.

    uv run --group benchmarks python -m benchmarks.many_loops

flies 10^6 runs of 0.1 s, and says how many a second, and how much memory at most.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

import ambkit
from ambkit.simulation.many import simulate_many
from ambkit.simulation.plans import Planned
from ambkit.simulation.recording import CONTROL, SENSOR, Stream
from benchmarks.batch import CORES
from benchmarks.closed_loop import ClosedLoop
from benchmarks.entries import Entry
from benchmarks.work import NOISE, Work

Array = NDArray[np.float64]

ONE = "ambkit `simulate_many`, one thread"
ALL = "ambkit `simulate_many`, all cores"
SIMULATE = "ambkit `simulate(bearing, scenario)`, run after run"
NUMBA = "numba, arranged as `sim/plant.c`, runs in parallel"

FEW = 8
"""Runs of those who take long."""


@dataclass(frozen=True)
class Loops:
    """Runs of one loop that differ in their noise."""

    bearing: ambkit.Machine
    scenario: ambkit.Scenario
    kalman: ambkit.KalmanFilter
    loop: ClosedLoop
    runs: int

    @classmethod
    def of(cls, work: Work, runs: int, samples: int) -> Loops:
        """Take the first samples of the work's scenario."""
        scenario = work.scenario.replace(
            duration=(samples - 1) * work.bearing.sampling_time,
            controller=work.scenario.controller.model_copy(update={"setpoint_weight": 1.0}),
        )
        kalman = ambkit.KalmanFilter(work.bearing, noise=NOISE)
        return cls(work.bearing, scenario, kalman, ClosedLoop.of(work), runs)

    @property
    def samples(self) -> int:
        return round(self.scenario.duration / self.bearing.sampling_time) + 1

    def planned(self, runs: int) -> Iterator[Planned]:
        """So many runs."""
        for number in range(runs):
            yield Planned(self.bearing, self.scenario, self.kalman, number=number)

    def errors(self, runs: int, threads: int) -> Array:
        """RMS errors of x, v, f_d (runs, 3)."""
        figures = simulate_many(self.planned(runs), threads=threads).figures
        return np.column_stack([figures[name] for name in ("x_rms", "v_rms", "f_d_rms")])

    def noise(self) -> tuple[Array, Array]:
        """The same noise as arrays (runs, n) [V], [m]."""
        stds = self.bearing.amplifier.noise_variance**0.5, self.bearing.sensor.noise_variance**0.5
        noise_u, noise_y = (
            np.array(
                [
                    Stream(self.scenario.seed, run, stream).normal(std, self.samples)
                    for run in range(self.runs)
                ]
            )
            for stream, std in zip((CONTROL, SENSOR), stds, strict=True)
        )
        return noise_u, noise_y


def side_by_side(loops: Loops) -> list[Entry]:
    """All runs on one core and on all."""
    n = loops.runs * loops.samples
    return [
        Entry(ONE, n, lambda: loops.errors(loops.runs, 1)),
        Entry(ALL, n, lambda: loops.errors(loops.runs, CORES), CORES),
    ]


def one_by_one(loops: Loops) -> list[Entry]:
    """A few runs by `simulate`."""

    def run() -> ArrayLike:
        errors = []
        for number in range(FEW):
            record = ambkit.simulate(
                loops.bearing, loops.scenario.replace(run=number), filter=loops.kalman
            )
            estimate = record.estimate
            assert estimate is not None  # an estimator is given
            errors.append(
                [
                    np.sqrt(np.mean((estimate[name] - record.record[name])[1:] ** 2))
                    for name in ("x", "v", "f_d")
                ]
            )
        return errors

    return [Entry(SIMULATE, FEW * loops.samples, run)]


def numba_parallel(loops: Loops) -> list[Entry]:
    """The loop of numba_loop.py, over the runs in parallel; its noise is drawn before."""
    from benchmarks import numba_loop as nl

    loop, n = loops.loop, loops.samples
    told = nl.parameters_of(loop), loop.settings, nl.started(loop), loop.integral
    noise_u, noise_y = loops.noise()
    errors = np.empty((loops.runs, 3))

    def run() -> ArrayLike:
        nl.many(*told, loop.r[:n], loop.f_d[:n], noise_u, noise_y, errors)
        return errors

    return [Entry(NUMBA, loops.runs * n, run, CORES)]


def main() -> None:
    """Fly many runs once; see the module."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.many_loops", description=__doc__)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--duration", type=float, default=0.1, help="of each [s]")
    options = parser.parse_args()
    work = Work.simulated(2000)
    loops = Loops.of(work, options.runs, round(options.duration / work.bearing.sampling_time) + 1)
    start, used = time.perf_counter(), time.process_time()
    many = simulate_many(loops.planned(options.runs), done=_Told(options.runs))
    wall, used = time.perf_counter() - start, time.process_time() - used
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"\n{len(many):,} runs of {options.duration:g} s: {len(many) / wall:,.0f} a second by the "
        f"clock on the wall, {len(many) / used * CORES:,.0f} on {CORES} cores that do nothing else "
        f"({1e9 * used / len(many) / loops.samples:.1f} ns of a processor a sample); "
        f"at most {memory:.2f} GB; mean error of the force "
        f"{many.figures['f_d_rms'].mean():.4f} N"
    )


class _Told:
    """A line of progress."""

    def __init__(self, runs: int) -> None:
        self.runs, self.done = runs, 0

    def __call__(self, more: int) -> None:
        self.done += more
        if sys.stderr.isatty():
            print(f"\r{self.done:,} of {self.runs:,}", end="", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
