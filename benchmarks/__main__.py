"""Measure, print the tables, and with ``--write`` put them into README.md.

    uv run --group benchmarks python -m benchmarks --write

Ends with status 1 where a limit is not kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from time import process_time_ns

import ambkit
from benchmarks import batch, entries, many_loops
from benchmarks.batch import Many
from benchmarks.closed_loop import ClosedLoop
from benchmarks.many_loops import Loops
from benchmarks.report import Limit, limits_table, machine, table, write
from benchmarks.timing import Times, interleaved
from benchmarks.work import Work


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmarks; see the module."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the tables into README.md")
    parser.add_argument("--rounds", type=int, default=51, help="how often all are timed")
    parser.add_argument("--samples", type=int, default=100_000, help="length of the record")
    parser.add_argument("--few", type=int, default=2_000, help="samples for the slow ones")
    parser.add_argument("--runs", type=int, default=64, help="how many filters go side by side")
    parser.add_argument("--length", type=int, default=5_000, help="samples of each of these")
    parser.add_argument("--loops", type=int, default=256, help="how many loops go side by side")
    parser.add_argument("--short", type=int, default=1_001, help="samples of each of these")
    options = parser.parse_args(arguments)

    work = Work.simulated(options.samples)
    filters, simulations = _measure(work, options.few, options.rounds)
    many, libraries, missing = _measure_many(
        work, options.runs, options.length, options.few, options.rounds
    )
    loops = _measure_loops(work, options.loops, options.short, options.rounds)
    limits = _limits(filters + simulations + many + loops)
    heading = f"Median of {options.rounds} rounds. {machine()}."
    measured = "\n\n".join(
        [
            f"{heading}\n\nThe filter, along a record:",
            table(filters, filters[0]),
            f"Many linear filters, {options.runs} runs of {options.length:,} samples, on"
            f" {batch.CORES} cores:",
            table(many, many[0]),
            *_others(libraries, missing),
            "The closed loop, simulated, with the linear filter in it:",
            table(simulations, simulations[0]),
            f"Many closed loops, {options.loops} runs of {options.short:,} samples, on"
            f" {batch.CORES} cores, only the errors kept:",
            table(loops, loops[0]),
            "Held to:",
            limits_table(limits),
        ]
    )
    print(measured)
    if options.write:
        write(measured)
    return 0 if all(limit.kept for limit in limits) else 1


def _measure(work: Work, few: int, rounds: int) -> tuple[list[Times], list[Times]]:
    expert = ambkit.train(work.bearing).expert
    filters = interleaved(
        [
            *entries.in_c(work),
            *entries.in_numba(work),
            *entries.in_python(work, few),
            *entries.constant(work, few),
            *entries.numba_by_sample(work, few),
            *entries.nonlinear(work),
            *entries.adaptive(work, expert),
            *entries.rules_in_numba(work, expert),
        ],
        rounds,
    )
    loop = ClosedLoop.of(work)
    simulations = interleaved([*entries.loops_in_numba(loop), *entries.loops(loop)], rounds)
    return filters, simulations


def _measure_many(
    work: Work, runs: int, length: int, few: int, rounds: int
) -> tuple[list[Times], list[Times], list[str]]:
    many = Many.of(work, runs, length)
    fast = interleaved(
        [*batch.by_hand(many), *batch.side_by_side(many), *batch.numba_parallel(many)],
        rounds,
        process_time_ns,
    )
    result, missing = batch.libraries(many, runs=runs, samples=min(few, length))
    slow = interleaved([*batch.by_hand(many), *result], max(rounds // 5, 1), process_time_ns)
    return fast, slow, missing


def _measure_loops(work: Work, runs: int, length: int, rounds: int) -> list[Times]:
    loops = Loops.of(work, runs, length)
    return interleaved(
        [
            *many_loops.numba_parallel(loops),
            *many_loops.side_by_side(loops),
            *many_loops.one_by_one(loops),
        ],
        rounds,
        process_time_ns,
    )


def _others(libraries: Sequence[Times], missing: Sequence[str]) -> list[str]:
    told = []
    if len(libraries) > 1:
        told += ["The same in libraries:", table(libraries, libraries[0])]
    if missing:
        told.append(f"Not installed, and so not measured: {', '.join(missing)}.")
    return told


def _limits(times: Sequence[Times]) -> list[Limit]:
    by_name = {t.entry.name: t for t in times}
    hand = (by_name[entries.HAND], by_name[entries.HAND_NEW])
    textbook = (by_name[entries.TEXTBOOK],)
    one_by_one = (by_name[batch.HAND],)
    stepped = (by_name[entries.STEP_NUMBA],)
    arranged = (by_name[entries.ARRANGED],)
    one, every = (by_name[many_loops.ONE],), by_name[many_loops.ALL]
    in_numba, simulated = (by_name[many_loops.NUMBA],), (by_name[many_loops.SIMULATE],)
    return [
        Limit("linear filter, k_i and k_s given: hand loop", by_name[entries.GIVEN], hand, 1.2),
        Limit("extended filter: hand loop", by_name[entries.EXTENDED], hand, 2),
        Limit("unscented filter: hand loop", by_name[entries.UNSCENTED], hand, 25),
        Limit("adaptive filter, 25 exact rules: hand loop", by_name[entries.RULES], hand, 12),
        Limit("many filters, errors kept: hand loop", by_name[batch.ERRORS], one_by_one, 1 / 6),
        Limit("`step(y, u)` from Python: numba's", by_name[entries.STEP], stepped, 1),
        Limit("closed loop: numba's, textbook", by_name[entries.LOOP], textbook, 1),
        Limit("closed loop: numba's, arranged", by_name[entries.LOOP], arranged, 1.1),
        Limit("linear filter, `run(record)`: hand loop", by_name[entries.CONSTANT], hand, 1),
        Limit("many closed loops, all cores: one thread", every, one, 1 / (0.9 * batch.CORES)),
        Limit("many closed loops, all cores: numba's in parallel", every, in_numba, 1 / 2),
        Limit("many closed loops, all cores: `simulate` in a loop", every, simulated, 1 / 5),
    ]


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ModuleNotFoundError as missing:
        sys.exit(f"{missing}; run: uv run --group benchmarks python -m benchmarks")
