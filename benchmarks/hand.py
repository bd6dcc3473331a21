"""The yardstick: hand_loop.c, compiled here and called through ctypes."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.work import Settings, Work

Array = NDArray[np.float64]

SOURCE = Path(__file__).with_name("hand_loop.c")
COMPILER = "gcc"
# As the core is built: portable, and no fused multiply-add.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off")


class Outputs(NamedTuple):
    """Where the loop writes, n samples."""

    mean: Array  # (n, 4)
    innovation: Array  # (n,)
    variance: Array  # (n,)

    @classmethod
    def empty(cls, n: int) -> Outputs:
        return cls(np.empty((n, 4)), np.empty(n), np.empty(n))


class _Hand(ctypes.Structure):
    _fields_ = tuple((name, ctypes.c_double) for name in Settings._fields)


class HandLoop:
    """The compiled loop.

    Raises
    ------
    SystemExit
        There is no compiler; the message says what to install.
    subprocess.CalledProcessError
        The source does not compile.
    """

    def __init__(self) -> None:
        with tempfile.TemporaryDirectory() as folder:
            library = Path(folder) / "hand_loop.so"
            command = [COMPILER, *FLAGS, "-shared", "-fPIC", "-o", str(library), str(SOURCE)]
            try:
                subprocess.run(command, check=True)
            except FileNotFoundError:
                raise SystemExit(f"the benchmarks need {COMPILER}: install it first") from None
            # Once loaded, the library no longer needs its file.
            self._run = ctypes.CDLL(str(library)).hand_run
        pointers = [ctypes.c_void_p] * 9
        self._run.argtypes = [ctypes.POINTER(_Hand), ctypes.c_size_t, *pointers]
        self._run.restype = None

    def __call__(self, work: Work, outputs: Outputs) -> Array:
        """Run along the record; returns the means (n, 4), which are those of `outputs`."""
        hand = _Hand(*work.settings)
        mean, cov = work.mean.copy(), work.cov[np.triu_indices(4)]
        arrays = (work.y, work.u, work.k_i, work.k_s, mean, cov, *outputs)
        self._run(ctypes.byref(hand), work.y.size, *(a.ctypes.data for a in arrays))
        return outputs.mean


def compiler_version() -> str:
    """Return for example ``gcc 12.2.0``."""
    answer = subprocess.run(
        [COMPILER, "-dumpfullversion"], check=True, capture_output=True, text=True
    )
    return f"{COMPILER} {answer.stdout.strip()}"
