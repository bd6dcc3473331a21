"""Measure, print the tables, and with ``--write`` put them into README.md.

    uv run --group benchmarks python -m benchmarks --write

Ends with status 1 where a limit is not kept.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import ambkit
from benchmarks import entries
from benchmarks.closed_loop import ClosedLoop
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
    options = parser.parse_args(arguments)

    work = Work.simulated(options.samples)
    filters, simulations = _measure(work, options.few, options.rounds)
    limits = _limits(filters + simulations)
    heading = f"Median of {options.rounds} rounds. {machine()}."
    measured = "\n\n".join(
        [
            f"{heading}\n\nThe filter, along a record:",
            table(filters, filters[0]),
            "The closed loop, simulated, with the linear filter in it:",
            table(simulations, simulations[0]),
            "Held to:",
            limits_table(limits),
        ]
    )
    print(measured)
    if options.write:
        write(measured)
    return 0 if all(limit.kept for limit in limits) else 1


def _measure(work: Work, few: int, rounds: int) -> tuple[list[Times], list[Times]]:
    expert = ambkit.train(work.bearing, weights=True)
    filters = interleaved(
        [
            *entries.in_c(work),
            *entries.in_numba(work),
            *entries.in_python(work, few),
            *entries.constant(work, few),
            *entries.adaptive(work, expert),
            *entries.rules_in_numba(work, expert),
        ],
        rounds,
    )
    loop = ClosedLoop.of(work)
    simulations = interleaved([*entries.loops_in_numba(loop), *entries.loops(loop)], rounds)
    return filters, simulations


def _limits(times: Sequence[Times]) -> list[Limit]:
    by_name = {t.entry.name: t for t in times}
    hand = (by_name[entries.HAND], by_name[entries.HAND_NEW])
    textbook = (by_name[entries.TEXTBOOK],)
    return [
        Limit("linear filter, k_i and k_s given: hand loop", by_name[entries.GIVEN], hand, 1.3),
        Limit("adaptive filter, 25 exact rules: hand loop", by_name[entries.RULES], hand, 12),
        Limit("closed loop: numba's, textbook", by_name[entries.LOOP], textbook, 1),
    ]


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ModuleNotFoundError as missing:
        sys.exit(f"{missing}; run: uv run --group benchmarks python -m benchmarks")
