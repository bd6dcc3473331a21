"""The exported step of a four-axis filter of 16 states beside its bare prediction and update.

    uv run --group benchmarks python -m benchmarks.machine_step [rounds]

Both in straight-line C of the same model, ``hindawi_2011``, compiled alike (see `model_step`).
Bare: nothing checked, k_i and k_s given. Exported: the linear filter as ``ambkit export c`` writes
it, with readings and controls of a flight, each looked at, with limits, statuses and supervisor.
Ends with status 1 where the exported step takes more than `MOST` of the bare one.
"""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from ambkit import KalmanFilter, Machine, Scenario, simulate
from ambkit.export.c import export_c
from benchmarks.model_step import FLAGS, built

MOST = 1.3

RUN = """
#include "filter.h"
long run(long samples, const double *y, const double *u)
{
  static filter_state state;
  filter_estimates now;
  long flagged = 0;
  filter_init(&state);
  (void)filter_reset(&state, y, &now);
  for (long k = 1; k < samples; k++)
    flagged += filter_step(&state, &y[k * AMB_SENSORS], &u[(k - 1) * AMB_CONTROLS], &now) != 0;
  return flagged;
}
"""


def exported(machine: Machine, folder: Path) -> ctypes.CDLL:
    """Return the exported filter as a library."""
    export = export_c(
        machine, KalmanFilter(machine), folder / "c", prefix="filter", loops=False
    ).folder
    (folder / "run.c").write_text(RUN, encoding="utf-8")
    sources = [*export.glob("*.c"), *export.glob("core/src/*.c"), folder / "run.c"]
    includes = [f"-I{export / part}" for part in (".", "core/include", "core")]
    library = folder / "exported.so"
    command = ["gcc", *FLAGS.split(), "-fno-tree-slp-vectorize", "-flto", *includes]
    subprocess.run([*command, *map(str, sources), "-o", str(library)], check=True)
    return ctypes.CDLL(str(library))


def main(rounds: int = 21) -> int:
    """Measure both in turn, print, and judge by the limit."""
    machine = Machine.preset("hindawi_2011")
    record = simulate(machine, Scenario(duration=1.0)).record
    y = np.column_stack([record[f"y_{r.name}"] for r in machine.readings])
    u = np.column_stack([record[f"u_{axis.name}"] for axis in machine.axes])
    pointers = [np.ascontiguousarray(a).ctypes.data_as(ctypes.c_void_p) for a in (y, u)]
    with tempfile.TemporaryDirectory() as name:
        bare = built(KalmanFilter(machine).model, Path(name))["straight line"]
        whole = exported(machine, Path(name))
        times, ratios = [], []
        for _ in range(rounds):
            one = bare.run(len(y))
            start = time.thread_time_ns()
            flagged = whole.run(ctypes.c_long(len(y)), *pointers)
            parts = (time.thread_time_ns() - start) / len(y)
            times.append((one, parts))
            ratios.append(parts / one)
    assert flagged == 0
    one, parts = (median(of) for of in zip(*times, strict=True))
    print("| bare step | exported step | ratio |\n| --: | --: | --: |")
    print(f"| {one:,.0f} ns | {parts:,.0f} ns | {median(ratios):.2f} |")
    return 0 if median(ratios) <= MOST else 1


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
