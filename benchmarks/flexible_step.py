"""A flexible rotor, in real time: the filters' step of 40 states within a sample of 0.1 ms.

    uv run python -m benchmarks.flexible_step [rounds]

Each estimator along a record of the preset ``ufu_flexible`` (eight rigid states, twelve of three
modes in two planes, loads, lagged readings, currents, past controls), as `run(record)` calls the C:
checks, magnets and history included. Ends with status 1 where a sample is not at least five times
as long as the median step on one core.
"""

from __future__ import annotations

import sys
import time
from statistics import median

from ambkit import Machine, Scenario, simulate
from ambkit.estimate.registry import KINDS, learned_magnet

KEPT = ("linear", "extended")
"""Kinds that are held to the limit."""
SPARE = 5.0
"""How many times as long as a step a sample is, at least."""


def main(rounds: int = 7) -> int:
    """Measure, print, and judge by the limit."""
    machine = Machine.preset("ufu_flexible")
    record = simulate(machine, Scenario(duration=2.0)).record
    filters = {
        kind: KINDS[kind].make(machine, learned_magnet(kind, machine))
        for kind in (*KEPT, "unscented", "ud", "multiple-model")
    }
    times: dict[str, list[float]] = {kind: [] for kind in filters}
    for _ in range(rounds):
        for kind, one in filters.items():
            start = time.process_time()
            one.run(record)
            times[kind].append((time.process_time() - start) / len(record))
    kept = True
    print("| filter | states | a step | samples of 0.1 ms over a step | least |")
    print("| --- | --: | --: | --: | --: |")
    for kind, item in times.items():
        spare = machine.sampling_time / median(item)
        kept = kept and (kind not in KEPT or spare >= SPARE)
        least = machine.sampling_time / max(item)
        states = len(filters[kind].states)
        step = f"{1e6 * median(item):.1f} µs"
        print(f"| {kind} | {states} | {step} | {spare:.1f} | {least:.1f} |", flush=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
