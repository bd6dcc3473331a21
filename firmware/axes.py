"""What a step of a machine's filter takes on a Cortex-M4F: ``python -m firmware.axes``.

Of the preset ``hindawi_2011``, four axes and 16 states, in single precision: straight line, and
loops over the entries of its model.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from ambkit import Machine, Scenario, simulate
from ambkit.estimate.registry import get_kind
from ambkit.export.c import export_c
from firmware import harness

SAMPLES = 300
KINDS = ("linear", "extended")


def measure(kind: str, loops: bool, folder: Path) -> tuple[int, int, int, int]:
    """Return median and most instructions, and bytes of code and constants.

    Parameters
    ----------
    kind : str
        Of the registry.
    loops : bool
        Loops over the model, or straight-line code.
    folder : Path
        Takes what is made.

    Raises
    ------
    RuntimeError
        The self-test says that bits differ.
    """
    machine = Machine.preset("hindawi_2011")
    filter = get_kind(kind).make(machine, precision="float32")
    export = export_c(machine, filter, folder / "export", prefix="filter", loops=loops).folder
    firmware = harness.build(export, folder / "build", main=harness.HERE / "axes.c")
    record = simulate(machine, Scenario(duration=SAMPLES * machine.sampling_time)).record
    y = np.column_stack([record[f"y_{r.name}"] for r in machine.readings])
    u = np.column_stack([record[f"u_{axis.name}"] for axis in machine.axes])
    samples = np.hstack([y[1:], u[:-1]]).astype("<f4")
    samples.tofile(folder / "input.bin")
    harness.emulated(firmware.elf, folder)
    counted = np.fromfile(folder / "instructions.bin", "<u4")[1:]
    size = harness.size(firmware)
    return int(np.median(counted)), int(counted.max()), size.code, size.constants


def main() -> int:
    """Print a table."""
    print("| filter | code | instructions | most | code [bytes] | constants [bytes] |")
    print("| --- | --- | --: | --: | --: | --: |")
    for kind in KINDS:
        for loops in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                figures = " | ".join(map(str, measure(kind, loops, Path(folder))))
            print(f"| {kind} | {'loops' if loops else 'straight line'} | {figures} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
