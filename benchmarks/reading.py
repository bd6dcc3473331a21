"""How long ``ambkit read`` takes on a long log, and how much memory.

    python -m benchmarks.reading --rows 10000000

Ends with status 1 where it takes more than 10 s of wall time, or 2 GB of resident memory.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

LIMIT_SECONDS, LIMIT_BYTES = 10.0, 2e9

MAP = """\
[signals.t]
column = "time"
unit = "s"
[signals.y]
column = "pos"
unit = "mm"
[signals.u]
column = "current"
unit = "A"
scale = "1 V/A"
"""


class Cost(NamedTuple):
    """What a call cost."""

    wall: float
    """Time on the clock [s]."""
    cpu: float
    """Time of the processors [s], which a busy machine does not lengthen much."""
    memory: float
    """Most resident memory [bytes]."""


def write_log(path: Path, rows: int) -> None:
    """Write a Parquet log at 10 kHz whose control signal saturates now and then."""
    import pyarrow as pa
    from pyarrow import parquet

    rng = np.random.default_rng(0)
    time_ = 1e-4 * np.arange(rows)
    wave = np.sin(2 * np.pi * time_)
    columns = {
        "time": time_,
        "pos": 0.1 * wave + 0.01 * rng.normal(size=rows),
        "current": np.clip(-0.3 * wave + 0.01 * rng.normal(size=rows), -0.29, 0.29),
    }
    parquet.write_table(pa.table(columns), path)


# A process starts with the memory of the one that forked it: this one has next to none.
LAUNCHER = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(code, used.ru_utime + used.ru_stime, used.ru_maxrss)
"""


def measure(rows: int, folder: Path, stderr: int = subprocess.DEVNULL) -> Cost:
    """Read a log of so many rows with the command, in a process of its own."""
    log, channel_map = folder / "log.parquet", folder / "map.toml"
    write_log(log, rows)
    channel_map.write_text(MAP)
    command = [sys.executable, "-m", "ambkit", "read", str(log), "--channels", str(channel_map)]
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", LAUNCHER, *command], stdout=subprocess.PIPE, stderr=stderr, text=True
    )
    wall = time.perf_counter() - start
    code, cpu, most = done.stdout.split()
    if code != "0":
        raise RuntimeError(f"ambkit read ended with {code}")
    unit = 1 if sys.platform == "darwin" else 1024
    return Cost(wall, float(cpu), float(most) * unit)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, print, and hold to the limits."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.reading", description=__doc__)
    parser.add_argument("--rows", type=int, default=10_000_000)
    rows = parser.parse_args(arguments).rows
    with tempfile.TemporaryDirectory() as folder:
        cost = measure(rows, Path(folder))
    print(
        f"{rows:,} rows of 3 columns: {cost.wall:.1f} s ({cost.cpu:.1f} s of processor), "
        f"{1e-9 * cost.memory:.2f} GB"
    )
    return 0 if cost.wall < LIMIT_SECONDS and cost.memory < LIMIT_BYTES else 1


if __name__ == "__main__":
    sys.exit(main())
