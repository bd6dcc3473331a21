"""A firmware in qemu with its two pipes, sample by sample."""

from __future__ import annotations

import os
import select
import subprocess
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambkit.base.errors import AmbkitError
from ambkit.export.pil.build import QEMU, qemu_command

OFTEN = 20  #: Samples between two counts of instructions.
PATIENCE = 60.0  #: Timeout of an answer, which takes less than one second.

GREETING = np.dtype(
    [(name, "<u4") for name in ("unequal", "wrong_status", "wrong", "selftest", "state")]
)
_END = 2


class Processor:
    """A running firmware."""

    def __init__(self, image: Path, folder: Path, sensors: int, axes: int, states: int) -> None:
        # Inputs and outputs of a sample: ``c/samples.h``.
        self.sample = np.dtype([
            ("y", "<f4", (sensors,)), ("r", "<f4", (axes,)), ("speed", "<f4"), ("fly", "<u4"),
            ("counted", "<u4"),
        ])  # fmt: skip
        self.answer = np.dtype([
            ("coil", "<f4", (axes, 2)), ("iu", "<f4", (axes,)), ("u", "<f4", (axes,)),
            ("mean", "<f4", (states,)), ("status", "<u4"), ("mode", "<u4"), ("on", "<u4"),
            ("usable", "<u4"), ("instructions", "<u4"), ("stack", "<u4"),
        ])  # fmt: skip
        self._answers: list[np.void] = []
        self._pipes = []
        for name in ("samples", "answers"):
            os.mkfifo(folder / name)
            # For both directions: opening does not wait for the other end.
            self._pipes.append(os.open(folder / name, os.O_RDWR))
        self._process = subprocess.Popen(
            qemu_command(image), cwd=folder,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            self.greeting = self._take(GREETING)
        except AmbkitError:
            self.close()
            raise

    def step(self, y: ArrayLike, r: ArrayLike, *, fly: bool, speed: float = 0.0) -> np.void:
        """Process one sample, and return the answer."""
        # Instructions are counted every so many samples, and after changes of mode or status. y
        # (sensors,); r (axes,) [m]
        last = self._answers[-2:]
        new = len(last) == 2 and any(last[0][name] != last[1][name] for name in ("mode", "status"))
        counted = new or len(self._answers) % OFTEN == 0
        self._send(y, r, speed, fly, counted)
        self._answers.append(self._take(self.answer))
        return self._answers[-1]

    @property
    def answers(self) -> NDArray[np.void]:
        """All answers, sample by sample (n,)."""
        return np.array(self._answers, self.answer)

    def close(self) -> None:
        """End it."""
        if self._process.poll() is None:
            self._send(0.0, 0.0, 0.0, False, _END)
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

    def _send(self, y: ArrayLike, r: ArrayLike, speed: float, fly: bool, counted: int) -> None:
        frame = np.zeros((), self.sample)
        for name, value in zip(self.sample.names or (), (y, r, speed, fly, counted), strict=True):
            frame[name] = value
        os.write(self._pipes[0], frame.tobytes())

    def _take(self, what: np.dtype[np.void]) -> np.void:
        got, until = b"", time.monotonic() + PATIENCE
        while len(got) < what.itemsize:
            if select.select([self._pipes[1]], [], [], 0.5)[0]:
                got += os.read(self._pipes[1], what.itemsize - len(got))
                until = time.monotonic() + PATIENCE
            elif self._process.poll() is not None or time.monotonic() > until:
                message = ""
                if self._process.poll() is not None and self._process.stdout is not None:
                    message = ": " + self._process.stdout.read().decode(errors="replace").strip()
                raise AmbkitError(f"the firmware in {QEMU} does not answer{message}")
        answer: np.void = np.frombuffer(got, what)[0]
        return answer
