"""Firmwares in qemu, whose time is instructions."""

from __future__ import annotations

import subprocess
from pathlib import Path

from ambkit.export.pil.boards import QEMU

SECONDS = 300  #: That a run to the end may last; none takes a tenth of it.


def command(image: Path) -> list[str]:
    """Return what runs a firmware: an instruction takes 1 ns, and files are those of the folder."""
    machine = ("-M", "mps2-an386", "-nographic", "-icount", "shift=0")
    semihosting = ("-semihosting-config", "enable=on,target=native")
    return [QEMU, *machine, *semihosting, "-kernel", str(image)]


def emulated(image: Path, folder: Path) -> str:
    """Run a firmware to its end, and return what it printed."""
    done = subprocess.run(
        command(image), cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=SECONDS,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"the firmware ended with {done.returncode}: {done.stderr.strip()}")
    return done.stderr
