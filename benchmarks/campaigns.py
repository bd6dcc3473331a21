"""What a campaign costs beside the runs: Dask's share, the memory, the margins.

    uv run python -m benchmarks.campaigns --runs 100000
    uv run python -m benchmarks.campaigns --runs 1000000 --memory

Dask's overhead is the time of a campaign on a local cluster of one worker with one thread, over
that of this process with one thread, alternating in rounds; the start of worker and scheduler is no
part of it. Processor time of all processes together, which others at work on the machine do not
change, is held to 15 %; by the clock on the wall it is told as well. With ``--memory`` the runs are
flown here, and the greatest memory of the process is told: below 2 GB.
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
from statistics import median

from ambkit.campaigns.plan import Plan
from ambkit.campaigns.run import campaign, of, scheduler
from ambkit.campaigns.study import Study
from ambkit.campaigns.worker import compute

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

ROUNDS = 5
"""Of which the median is held to the limit."""


def study(runs: int, part: int, duration: float, margins: bool) -> Study:
    """Return a study of short runs."""
    text = STUDY.format(runs=runs, part=part, duration=duration, margins=str(margins).lower())
    return Study.from_toml(text)


def dask_share(plan: Plan) -> tuple[list[float], list[float]]:
    """Return by how much more a worker takes than this process, by processor and by wall (rounds,).

    One thread each; the parts are dealt to rounds, each computed here and then there.
    """
    compute(plan, 0, min(plan.runs, 100), threads=1)
    rounds = [range(first, plan.parts, ROUNDS) for first in range(min(ROUNDS, plan.parts))]
    by_processor, by_wall = [], []
    with scheduler("local", 1) as there:
        warm = Plan(study(4, 1, 1.0, False))
        list(of(there, warm, range(4)))  # the worker imports ambkit
        for parts in rounds:
            before = _times()
            for part in parts:
                compute(plan, *plan.span(part), threads=1)
            between = _times()
            count = sum(1 for _ in of(there, plan, parts))
            after = _times()
            assert count == len(parts)
            for place, result in enumerate((by_processor, by_wall)):
                here, beside = between[place] - before[place], after[place] - between[place]
                result.append(beside / here - 1)
    return by_processor, by_wall


def _times() -> tuple[float, float]:
    """Return the processor time of this process and all that it started, and of the wall [s]."""
    import psutil

    own = psutil.Process()
    parts = [one.cpu_times() for one in (own, *own.children(recursive=True))]
    return sum(one.user + one.system for one in parts), time.perf_counter()


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; see the module."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.campaigns", description=__doc__)
    parser.add_argument("--runs", type=int, default=100_000)
    parser.add_argument("--part", type=int, default=1000)
    parser.add_argument("--duration", type=float, default=10.0, help="of a run [ms]")
    parser.add_argument(
        "--no-margins", dest="margins", action="store_false", help="leave out the margins of each"
    )
    parser.add_argument("--memory", action="store_true", help="fly them here, and tell the memory")
    options = parser.parse_args(arguments)
    made = study(options.runs, options.part, options.duration, options.margins)
    if options.memory:
        with tempfile.TemporaryDirectory() as folder:
            start, used = time.perf_counter(), time.process_time()
            result = campaign(made, Path(folder, "out"))
            seconds, used = time.perf_counter() - start, time.process_time() - used
            result.to_dict()
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        parts = 1e3 * used / options.runs
        print(f"{options.runs:,} runs of {options.duration:g} ms, margins "
              f"{'on' if options.margins else 'off'}, in {seconds:.0f} s, "
              f"{options.runs / seconds:,.0f} a second, {parts:.3f} ms of a processor each; "
              f"at most {most / 1e9:.2f} GB; limit {MEMORY / 1e9:g} GB")  # fmt: skip
        return int(most > MEMORY)
    by_processor, by_wall = dask_share(Plan(made))
    share = median(by_processor)
    print(f"{options.runs:,} runs, {len(by_processor)} rounds: a worker of Dask takes "
          f"{100 * share:.1f} % more of the processor ({100 * min(by_processor):.1f} to "
          f"{100 * max(by_processor):.1f} %), {100 * median(by_wall):.1f} % more by the clock on "
          f"the wall; limit {100 * DASK:g} %")  # fmt: skip
    return int(share > DASK)


if __name__ == "__main__":
    sys.exit(main())
