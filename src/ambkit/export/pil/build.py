"""Compilation of an exported controller for a board: flash, memory, stack; linking for qemu."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ambkit.base.errors import AmbkitError

HERE = Path(__file__).parent / "c"
FLAGS = (
    "-std=c99", "-fno-common", "-ffp-contract=off", "-ffunction-sections", "-fdata-sections",
    "-Werror=incompatible-pointer-types",
)  # fmt: skip
PREFIX = "rig"  #: Prefix of the called functions.
_CALLS = ("init", "step", "transfer_from")


class Built(NamedTuple):
    """Size of the export in a controller [bytes]."""

    code: int
    constants: int
    variables: int
    stack: int | None  # bound by the compiler's figures over all calls; None if unknown
    compiler: str


def size(export: Path, board: Board, into: Path, several: bool) -> Built:
    """Compile an export for a board, and return its size."""
    name = f"{PREFIX}_control" if several else PREFIX
    into.mkdir(parents=True, exist_ok=True)
    if not board.compiler.startswith(ARM):
        return _compile_only(export, board, into)
    objects = compiled(export, board, into, "-fcallgraph-info=su")
    partial = into / "export.o"
    roots = [f"-u{name}_{function}" for function in _CALLS]
    _call(ARM + "ld", "-r", "--gc-sections", *roots, *map(str, objects), "-o", str(partial))
    listing = _call(ARM + "size", "-A", str(partial))
    totals = {".text": 0, ".rodata": 0, ".data": 0, ".bss": 0}
    for section, count in re.findall(r"^(\.\w+)\S*\s+(\d+)\s", listing, re.MULTILINE):
        if section in totals:
            totals[section] += int(count)
    moved = _call(ARM + "objdump", "-r", str(partial))
    address_taken = set(re.findall(r"R_ARM_ABS32\s+(?:\.text\.)?(\w+)", moved))
    deepest = stack(sorted(into.glob("*.ci")), f"{name}_step", address_taken)
    return Built(
        totals[".text"], totals[".rodata"], totals[".data"] + totals[".bss"], deepest,
        " ".join([board.compiler, _call(board.compiler, "-dumpfullversion").strip(),
                  *board.target, "-ffp-contract=off"]),
    )  # fmt: skip


def _compile_only(export: Path, board: Board, into: Path) -> Built:
    """Compile with a compiler whose sizes are not parsed, to check that it compiles."""
    for source in sources(export):
        includes = [f"--include_path={export / at}" for at in (".", "core/include", "core")]
        words = [*board.target, *includes, "--compile_only", f"--obj_directory={into}"]
        _call(board.compiler, *words, str(source))
    code = sum(path.stat().st_size for path in into.glob("*.obj"))
    return Built(code, 0, 0, None, f"{board.compiler} {' '.join(board.target)}, object files")


def sources(export: Path) -> list[Path]:
    """Return the files that a controller compiles, in alphabetical order."""
    return sorted([*export.glob("*.c"), *export.glob("core/src/*.c")])


def compiled(export: Path, board: Board, into: Path, *flags: str) -> list[Path]:
    """Compile each file of an export."""
    includes = [f"-I{export / at}" for at in (".", "core/include", "core")]
    made = []
    for source in sources(export):
        to = into / f"{source.stem}.o"
        words = [*FLAGS, *board.target, *includes, *flags, "-c", str(source), "-o", str(to)]
        _call(board.compiler, *words)
        made.append(to)
    return made


def firmware(export: Path, means: list[str], board: Board, into: Path, several: bool) -> Path:
    """Link an export with the loop for qemu; return the image."""
    into.mkdir(parents=True, exist_ok=True)
    objects = compiled(export, board, into)
    mean_fields = ", ".join(f"(out)->{field}" for field in means)
    defines = [
        f"-DSEVERAL={several:d}",
        f"-DSTATES={len(means)}",
        f"-DMEANS(out)={{{mean_fields}}}",
    ]
    includes = [f"-I{export / at}" for at in (".", "core/include", "core", "selftest")]
    tests = [str(path) for path in sorted((export / "selftest").glob(f"{PREFIX}_*.c"))]
    own = [str(HERE / file) for file in ("startup.c", "semihosting.c", "loop.c")]
    image = into / "loop.elf"
    link = ("-nostartfiles", "--specs=nano.specs", f"-T{HERE / 'm.ld'}", f"-I{HERE}")
    _call(
        board.compiler, *FLAGS, *board.target, *defines, *includes, *link, *own, *tests,
        *map(str, objects), "-o", str(image),
    )  # fmt: skip
    return image


_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "([^"]*)"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
# of the C library, which has no call graph: memcpy and memset save up to six registers
_OUTSIDE = 24
_BYTES = re.compile(r"(\d+) bytes \((\w+)\)")


def stack(graphs: list[Path], root: str, address_taken: set[str]) -> int | None:
    """Return the maximum stack of a call [bytes], by gcc's call graph and stack usage."""
    # A call by a pointer may reach every function whose address is taken and that is not active
    # already: no function here calls itself by a pointer.
    own: dict[str, int] = {}
    nodes: dict[str, int] = {}  # several if gcc has split a function, which calls its part
    calls: dict[str, set[str]] = {}
    for path in graphs:
        text = path.read_text(encoding="utf-8")
        for title, label in _NODE.findall(text):
            if (result := _BYTES.search(label)) is not None:
                if result[2] not in ("static", "bounded"):
                    return None
                own[title] = own.get(title, 0) + int(result[1])
                nodes[title] = nodes.get(title, 0) + 1
        for source, target in _EDGE.findall(text):
            calls.setdefault(source, set()).add(target)
    pointed = {title for title in own if title.rpartition(":")[2] in address_taken}

    def depth(title: str, above: frozenset[str]) -> int | None:
        if title in above:
            return None
        most = 0
        parts = {title} if nodes.get(title, 0) > 1 else set()
        for target in calls.get(title, set()) - parts:
            for item in pointed - above - {title} if target == "__indirect_call" else {target}:
                below = depth(item, above | {title})
                if below is None:
                    return None
                most = max(most, below)
        return own.get(title, _OUTSIDE) + most

    return depth(root, frozenset())


def _call(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise AmbkitError(f"{command[0]} failed:\n{done.stderr.strip()}")
    return done.stdout


ARM = "arm-none-eabi-"
QEMU = "qemu-system-arm"


class Board(NamedTuple):
    """A board for firmware."""

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
"""Boards by name, with the usual compiler flags."""

QEMU_BOARD = Board("Cortex-M4F in qemu", f"{ARM}gcc", (*M4F, "-O3"), _ARM_PACKAGES)


def in_qemu(board: Board) -> Board:
    """Return the build for qemu: the board's own, if that is for a Cortex-M4F."""
    return board if board.target[: len(M4F)] == M4F else QEMU_BOARD


def check(board: Board) -> None:
    """Reject a board without installed tools."""
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
    """Return the command that runs a firmware in a folder; an instruction takes 1 ns."""
    machine = ("-M", "mps2-an386", "-nographic", "-icount", "shift=0")
    semihosting = ("-semihosting-config", "enable=on,target=native")
    return [QEMU, *machine, *semihosting, "-kernel", str(image)]
