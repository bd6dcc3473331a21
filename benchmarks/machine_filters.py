"""Filters of machines beside the bound and beside a filter with ten steps in a sample.

    uv run python -m benchmarks.machine_filters [SEEDS] [PRESET ...]

Each preset with the extended filter from vague starts, at rest, at its speed and over a run-up from
rest to one and a half times that: displacements, velocities, loads and currents by the Cramér-Rao
bound, and NEES. Then with unbalance and runout among the states, drawn anew for each run: these and
all others by the paired ratio to a filter with ten steps in a sample on the same noise, as 20 draws
of an unbalance say nothing of a variance. Prints a table, a line as it is done; ends with status 1
where one is below `LEAST`, or NEES outside of `BAND`.
"""

from __future__ import annotations

import sys

import numpy as np

from ambkit import AmbkitError, Machine
from ambkit.machine import presets
from ambkit.simulation.waveforms import Constant, Ramp
from benchmarks.judge_states import Judgement, judge_states

LEAST = 0.95
BAND = 0.9, 1.1
SOFT = {"tum_mlps_flexible": 0.03, "ufu_flexible": 0.03}
"""Share of the magnets' force that is load, where rotors bend too easily for a tenth."""
BALANCED = 0.2
"""Of typical unbalance and runout: a run-up passes the critical speeds."""

HEAD = (
    "| machine | turns | s | v | f_d | i | NEES | unbalance | runout | all others | NEES |\n"
    "| --- | --- | --: | --: | --: | --: | --: | --: | --: | --: | --: |"
)


def mean_of(judged: Judgement, ratios: np.ndarray, *starts: str) -> float:
    """Return the mean over the quantities whose names start so; NaN where there is none."""
    results = [r for q, r in zip(judged.quantities, ratios, strict=True) if q.startswith(starts)]
    return float(np.mean(results)) if results else float("nan")


def row(name: str, turns: str, seeds: int) -> tuple[str, bool]:
    """Return a line of the table, and whether its limits are kept."""
    machine, load = Machine.preset(name), SOFT.get(name, 0.1)
    speed = {
        "at rest": Constant(value=0.0), "at speed": None,
        "run-up": Ramp(slope=3 * machine.speed, start=0.0),
    }[turns]  # fmt: skip
    duration = 0.5 if turns == "run-up" else 0.3
    one = machine.replace(speed=0.0, unbalance=[]) if turns == "at rest" else machine
    keys = {"seeds": seeds, "duration": duration, "settled": 0.1, "load": load}
    plain = judge_states(one, ("extended",), speed=None if turns == "at rest" else speed, **keys)
    by_bound = plain.efficiency("extended")
    figures = [mean_of(plain, by_bound, start) for start in ("s_", "v_", "f_d_", "i_")]
    nees = [float(plain.nees["extended"].mean())]
    if turns != "at rest":  # where unbalance does nothing, and runout is an offset
        whole = judge_states(
            machine, ("extended",), speed=speed, synchronous=("unbalance", "runout"),
            balance=BALANCED, finer=True, **keys,
        )  # fmt: skip
        paired = whole.paired("extended")
        of = (("U",), ("r",), ("s_", "v_", "f_d_", "i_"))
        figures += [mean_of(whole, paired, *starts) for starts in of]
        nees.append(float(whole.nees["extended"].mean()))
    kept = all(np.isnan(f) or f >= LEAST for f in figures)
    kept = kept and all(BAND[0] <= nee <= BAND[1] for nee in nees)
    told = ["" if np.isnan(f) else f"{f:.3f}" for f in figures] + [""] * (7 - len(figures))
    told = [*told[:4], f"{nees[0]:.3f}", *told[4:], f"{nees[1]:.3f}" if len(nees) > 1 else ""]
    return f"| {name} | {turns} | {' | '.join(told)} |", kept


def main(seeds: int, names: list[str]) -> int:
    """Print the table, and judge by the limits."""
    print(HEAD)
    kept = True
    for name in names or [n for n in presets.names() if not Machine.preset(n).single]:
        for turns in ("at rest", "at speed", "run-up"):
            try:
                line, good = row(name, turns, seeds)
            except AmbkitError as error:
                line, good = f"| {name} | {turns} | {error} |", False
            kept = kept and good
            print(line, flush=True)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else 20, sys.argv[2:]))
