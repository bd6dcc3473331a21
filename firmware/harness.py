"""Build an exported folder for the Cortex-M4F, and run it in qemu."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import ambkit
from ambkit.export.pil.build import ARM, M4F, QEMU, qemu_command

HERE = Path(__file__).resolve().parent
BOARD = Path(ambkit.__file__).parent / "export" / "pil" / "c"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
FLAGS = ("-std=c99", "-O3", "-fno-common", *M4F)

Contraction = Literal["off", "fast"]

SECONDS = 300  # that a run to the end may last; none takes a tenth of it

_ANSWER = np.dtype(
    [("mean", "<f4", 4), ("status", "<u4"), ("instructions", "<u4"), ("trusted", "<u4")]
)
_SUMMARY = np.dtype(
    [(name, "<u4") for name in ("unequal", "wrong_status", "stack", "state", "selftest")]
)


class Firmware(NamedTuple):
    """What was built."""

    elf: Path  # harness and export
    object: Path  # what a controller's firmware would take of the export


class Size(NamedTuple):
    """What an export takes of a controller's memory [bytes]; variables are the caller's."""

    code: int
    constants: int
    variables: int


class Run(NamedTuple):
    """What the processor gave."""

    mean: NDArray[np.float32]  # (n, 4): x [m], v [m/s], f_d [N], x_m [m]
    status: NDArray[np.uint32]  # (n,)
    instructions: NDArray[np.uint32]  # (n - 1,), of each step
    trusted: NDArray[np.uint32]  # (n - 1,), of the step that trusts its input; 0 without one
    stack: int  # bytes that a step needs
    state: int  # bytes of an instance
    selftest: int  # instructions of the self-test
    unequal: int  # states of the self-test that are not equal to the last bit
    wrong_status: int  # statuses of the self-test
    text: str  # what it printed


def missing_tools() -> list[str]:
    """Return the programs that are needed and not there."""
    tools = [ARM + name for name in ("gcc", "ld", "size", "nm")] + [QEMU]
    return [tool for tool in tools if shutil.which(tool) is None]


def compiler() -> str:
    """Return name, version and flags of the cross compiler."""
    version = _call(ARM + "gcc", "-dumpfullversion").strip()
    return " ".join([f"{ARM}gcc {version}", *FLAGS, "-ffp-contract=off"])


def build(
    export: Path, into: Path, contraction: Contraction = "off", main: Path = HERE / "main.c"
) -> Firmware:
    """Compile and link an exported folder with the harness.

    Parameters
    ----------
    export : Path
        What ``ambkit export c --precision float`` wrote.
    into : Path
        Folder for what is built.
    contraction : {"off", "fast"}
        Whether the compiler may fuse a multiplication and an addition, which rounds once less.
    main : Path
        What runs it.

    Raises
    ------
    subprocess.CalledProcessError
        It does not compile; the compiler has said why.
    """
    name = _name_of(export)
    into.mkdir(parents=True, exist_ok=True)
    includes = [f"-I{export / folder}" for folder in (".", "core/include", "core", "selftest")]
    flags = [*FLAGS, f"-ffp-contract={contraction}", *includes]
    gcc = ARM + "gcc"

    sources = [*export.glob("*.c"), *export.glob("core/src/*.c")]
    objects = [into / f"{source.stem}.o" for source in sources]
    for source, made in zip(sources, objects, strict=True):
        sections = ("-ffunction-sections", "-fdata-sections")
        _call(gcc, *flags, *WARNINGS, *sections, "-c", source, "-o", made)
    roots = [f"-u{name}_{function}" for function in ("init", "reset", "step")]
    partial = into / "export.o"
    _call(ARM + "ld", "-r", "--gc-sections", *roots, *sorted(objects), "-o", partial)

    words = ["state", "estimates", "init", "reset", "step", "selftest", "selftest_result"]
    if f"{name}_step_trusted" in (export / f"{name}.h").read_text():
        words.append("step_trusted")
    defines = [f"-Dfilter_{word}={name}_{word}" for word in words]
    defines += [f'-DHEADER="{name}_selftest.h"']
    tests = [export / "selftest" / f"{name}_{part}.c" for part in ("selftest", "vectors")]
    harness = [BOARD / "startup.c", BOARD / "semihosting.c", main]
    flags.append(f"-I{BOARD}")
    elf = into / "firmware.elf"
    link = ("-nostartfiles", "--specs=nano.specs", f"-T{BOARD / 'm.ld'}")
    _call(gcc, *flags, *defines, *link, *harness, *tests, *sorted(objects), "-o", elf)
    return Firmware(elf, partial)


def run(firmware: Firmware, y: ArrayLike, u: ArrayLike) -> Run:
    """Run the self-test and a record through the filter.

    Parameters
    ----------
    firmware : Firmware
        From :func:`build`.
    y : array_like (n,)
        Measurements [m].
    u : array_like (n,)
        Control signals [V]; u[k] acts from sample k to k + 1.

    Raises
    ------
    RuntimeError
        The firmware did not come to its end.
    """
    samples = np.zeros((len(np.asarray(y)), 2), dtype="<f4")
    samples[:, 0] = y
    samples[1:, 1] = np.asarray(u)[:-1]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples.tofile(folder / "input.bin")
        text = emulated(firmware.elf, folder)
        answers = np.fromfile(folder / "output.bin", _ANSWER)
        summary = np.fromfile(folder / "summary.bin", _SUMMARY)[0]
    return Run(
        mean=answers["mean"],
        status=answers["status"],
        instructions=answers["instructions"][1:],
        trusted=answers["trusted"][1:],
        stack=int(summary["stack"]),
        state=int(summary["state"]),
        selftest=int(summary["selftest"]),
        unequal=int(summary["unequal"]),
        wrong_status=int(summary["wrong_status"]),
        text=text,
    )


def size(firmware: Firmware) -> Size:
    """Return what the export takes of flash and of memory."""
    listing = _call(ARM + "size", "-A", firmware.object)
    totals = {".text": 0, ".rodata": 0, ".data": 0, ".bss": 0}
    for section, count in re.findall(r"^(\.\w+)\S*\s+(\d+)\s", listing, re.MULTILINE):
        if section in totals:
            totals[section] += int(count)
    return Size(totals[".text"], totals[".rodata"], totals[".data"] + totals[".bss"])


def borrowed(firmware: Firmware) -> set[str]:
    """Return what the export needs that it does not bring: functions of the compiler's library."""
    return set(_call(ARM + "nm", "--undefined-only", "--just-symbols", firmware.object).split())


def _name_of(export: Path) -> str:
    """Return the prefix of an export: its self-test is named after it."""
    (header,) = export.glob("selftest/*_selftest.h")
    return header.name.removesuffix("_selftest.h")


def _call(*command: str | Path) -> str:
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def emulated(image: Path, folder: Path) -> str:
    """Run a firmware to its end, and return what it printed."""
    done = subprocess.run(
        qemu_command(image), cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True,
        timeout=SECONDS,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"the firmware ended with {done.returncode}: {done.stderr.strip()}")
    return done.stderr
