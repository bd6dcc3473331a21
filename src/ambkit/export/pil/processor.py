"""A firmware in qemu, and what goes to and from it: two pipes, a sample at a time."""

from __future__ import annotations

import os
import select
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.export.pil.boards import QEMU
from ambkit.export.pil.emulator import command

PATIENCE = 60.0
"""Seconds for an answer, which takes less than one."""

SAMPLE = np.dtype([("y", "<f4"), ("r", "<f4"), ("fly", "<u4"), ("counted", "<u4")])
ANSWER = np.dtype([
    ("coil", "<f4", 2), ("iu", "<f4"), ("u", "<f4"), ("mean", "<f4", 4), ("status", "<u4"),
    ("mode", "<u4"), ("on", "<u4"), ("usable", "<u4"), ("instructions", "<u4"), ("stack", "<u4"),
])  # fmt: skip
GREETING = np.dtype(
    [(name, "<u4") for name in ("unequal", "wrong_status", "wrong", "selftest", "state")]
)
_END = 2


class Processor:
    """A running firmware.

    Parameters
    ----------
    image : Path
        What ``build.firmware`` linked.
    folder : Path
        For the pipes.

    Raises
    ------
    AmbkitError
        It does not start, or says nothing.
    """

    def __init__(self, image: Path, folder: Path) -> None:
        self._pipes = []
        for name in ("samples", "answers"):
            os.mkfifo(folder / name)
            # For both directions: opening does not wait for the other end.
            self._pipes.append(os.open(folder / name, os.O_RDWR))
        self._process = subprocess.Popen(
            command(image), cwd=folder,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self.greeting = self._take(GREETING)
        except AmbkitError:
            self.close()
            raise

    def step(self, y: float, r: float, *, fly: bool, counted: bool) -> np.void:
        """Let it take one sample, and return what it says of it (`ANSWER`).

        Parameters
        ----------
        y : float
            What the sensor shows, as the rig has it.
        r : float
            Reference [m].
        fly : bool
            Whether it is to fly.
        counted : bool
            Whether it is to count the instructions of this step.
        """
        os.write(self._pipes[0], np.array((y, r, fly, counted), SAMPLE).tobytes())
        return self._take(ANSWER)

    def close(self) -> None:
        """End it."""
        if self._process.poll() is None:
            os.write(self._pipes[0], np.array((0, 0, 0, _END), SAMPLE).tobytes())
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        for pipe in self._pipes:
            os.close(pipe)
        self._pipes = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _take(self, what: np.dtype[np.void]) -> np.void:
        got, until = b"", time.monotonic() + PATIENCE
        while len(got) < what.itemsize:
            if select.select([self._pipes[1]], [], [], 0.5)[0]:
                got += os.read(self._pipes[1], what.itemsize - len(got))
                until = time.monotonic() + PATIENCE
            elif self._process.poll() is not None or time.monotonic() > until:
                said = ""
                if self._process.poll() is not None and self._process.stdout is not None:
                    said = ": " + self._process.stdout.read().decode(errors="replace").strip()
                raise AmbkitError(f"the firmware in {QEMU} does not answer{said}")
        answer: np.void = np.frombuffer(got, what)[0]
        return answer
