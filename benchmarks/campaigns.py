"""What a campaign costs beside the runs: Dask's share, the memory, the margins.

    uv run python -m benchmarks.campaigns --runs 100000
    uv run python -m benchmarks.campaigns --runs 1000000 --memory

Dask's overhead is the time of a campaign on a local cluster of one worker with one thread, over
that of this process with one thread; the start of worker and scheduler is no part of it. Held to
15 %. With ``--memory`` the runs are flown here, and the greatest memory of the process is told:
below 2 GB.
Ends with status 1 where a limit is not kept.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from ambkit.workflow.campaign import cluster
from ambkit.workflow.campaign.compute import compute
from ambkit.workflow.campaign.plan import Plan
from ambkit.workflow.campaign.running import campaign
from ambkit.workflow.campaign.study import Study

STUDY = """
name = "short runs"
bearing = "zittau_axial"
runs = {runs}
part = {part}
sampling = "random"
scenario = {{ duration = "{duration} ms" }}
record = {{ margins = {margins} }}

[[vary]]
what = "magnet.air_gap"
type = "normal"
std = "1 %"

[[vary]]
what = "rotor.mass"
type = "uniform"
tolerance = "3 %"
"""

DASK, MEMORY = 0.15, 2e9


def study(runs: int, part: int, duration: float, margins: bool) -> Study:
    """Return a study of short runs."""
    text = STUDY.format(runs=runs, part=part, duration=duration, margins=str(margins).lower())
    return Study.from_toml(text)


def dask_share(plan: Plan) -> tuple[float, float]:
    """Return the times of all parts here and by a worker, one thread each [s]."""
    compute(plan, 0, min(plan.runs, 100), threads=1)
    start = time.perf_counter()
    for part in range(plan.parts):
        compute(plan, *plan.span(part), threads=1)
    here = time.perf_counter() - start
    with cluster.scheduler("local", 1) as there:
        warm = Plan(study(4, 1, 1.0, False))
        list(cluster.of(there, warm, range(4)))  # the worker imports ambkit
        start = time.perf_counter()
        count = sum(1 for _ in cluster.of(there, plan, range(plan.parts)))
        beside = time.perf_counter() - start
    assert count == plan.parts
    return here, beside


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; see the module."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.campaigns", description=__doc__)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--part", type=int, default=1000)
    parser.add_argument("--duration", type=float, default=10.0, help="of a run [ms]")
    parser.add_argument("--margins", action="store_true", help="find the margins of each as well")
    parser.add_argument("--memory", action="store_true", help="fly them here, and tell the memory")
    options = parser.parse_args(arguments)
    made = study(options.runs, options.part, options.duration, options.margins)
    if options.memory:
        with tempfile.TemporaryDirectory() as folder:
            start = time.perf_counter()
            found = campaign(made, Path(folder, "out"))
            seconds = time.perf_counter() - start
            found.to_dict()
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(f"{options.runs:,} runs in {seconds:.0f} s, {options.runs / seconds:,.0f} a second; "
              f"at most {most / 1e9:.2f} GB, limit {MEMORY / 1e9:g} GB")  # fmt: skip
        return int(most > MEMORY)
    here, beside = dask_share(Plan(made))
    share = beside / here - 1
    print(f"{options.runs:,} runs: here {here:.1f} s, by a worker of Dask {beside:.1f} s, "
          f"{100 * share:.1f} % more; limit {100 * DASK:g} %")  # fmt: skip
    return int(share > DASK)


if __name__ == "__main__":
    sys.exit(main())
