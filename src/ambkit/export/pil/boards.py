"""Boards: which compiler, which flags, and whether qemu can run what comes out."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple

from ambkit.base.errors import AmbkitError

ARM = "arm-none-eabi-"
QEMU = "qemu-system-arm"


class Board(NamedTuple):
    """What a firmware is built for."""

    about: str
    compiler: str
    target: tuple[str, ...]
    install: str


_ARM_PACKAGES = "gcc-arm-none-eabi libnewlib-arm-none-eabi"
M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")

BOARDS = {
    "stm32f4": Board("STM32F4, Cortex-M4F", f"{ARM}gcc", (*M4F, "-O2"), _ARM_PACKAGES),
    "amdc": Board(
        "AMDC, Zynq-7000, Cortex-A9", f"{ARM}gcc",
        ("-mcpu=cortex-a9", "-mfloat-abi=hard", "-mfpu=vfpv3", "-O2"), _ARM_PACKAGES,
    ),
    "c2000": Board(
        "TI C2000, C28x with FPU", "cl2000",
        ("--silicon_version=28", "--float_support=fpu32", "--abi=eabi", "-O2"),
        "TI's C2000 code generation tools",
    ),
}  # fmt: skip
"""Boards by name, with what their projects compile with."""

QEMU_BOARD = Board("Cortex-M4F in qemu", f"{ARM}gcc", (*M4F, "-O3"), _ARM_PACKAGES)


def in_qemu(board: Board) -> Board:
    """Return what qemu runs: the board's own build, where that is for a Cortex-M4F."""
    return board if board.target[: len(M4F)] == M4F else QEMU_BOARD


def check(board: Board) -> None:
    """Refuse what there are no tools for."""
    missing, install = [], []
    if shutil.which(board.compiler) is None:
        missing.append(board.compiler)
        install.append(board.install)
    if shutil.which(QEMU) is None:
        missing.append(QEMU)
        install.append("qemu-system-arm")
    if missing:
        debian = (
            "apt-get install --no-install-recommends " if board.compiler.startswith(ARM) else ""
        )
        raise AmbkitError(
            f"a processor in the loop needs {' and '.join(missing)}, which is not there: "
            f"{debian}{' '.join(install)}"
        )


def qemu_command(image: Path) -> list[str]:
    """Return what runs a firmware: an instruction takes 1 ns, and files are those of the folder."""
    machine = ("-M", "mps2-an386", "-nographic", "-icount", "shift=0")
    semihosting = ("-semihosting-config", "enable=on,target=native")
    return [QEMU, *machine, *semihosting, "-kernel", str(image)]
