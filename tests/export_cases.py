"""Every kind of estimator as an exported folder of C, and what compiles it; for several tests."""

from __future__ import annotations

import ctypes
import functools
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from exporting import export_c

from ambkit import Machine
from ambkit.arguments import filter_to_export
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.registry import KINDS as REGISTRY
from ambkit.export.c import CExport

BEARING = Machine.preset("zittau_axial")
# "tabulated" is the expert of "adaptive" as a table, in the same C as the map of "table"; what is
# steady-state is an observer.
KINDS = (*(n for n in REGISTRY if n not in ("table", "steady-state")), "tabulated")
PRECISIONS = ("float", "double")
# Every kind in float; double differs in the core's real.h and exponential.h, which all have.
CASES = (*((kind, "float") for kind in KINDS), ("adaptive", "double"))

CORE_PRECISION: dict[str, Any] = {"float": "float32", "double": "float64"}
STRICT = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror")
SAME_BITS = ("-O0", "-ffp-contract=off", "-DAMB_NO_CONTRACTION")
COMPILER = shutil.which("gcc") or shutil.which("clang")
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler (gcc or clang) here")
INCLUDES = ("-I.", "-Icore/include", "-Icore", "-Iselftest")


@functools.cache
def magnet_of(kind: str) -> Any:
    """What ``ambkit export --filter`` takes for the magnet."""
    return filter_to_export(BEARING, "adaptive" if kind == "tabulated" else kind)[1].magnet


def export(kind: str, out: Path, **options: Any) -> CExport:
    return export_of(BEARING, kind, out, **options)


def export_of(bearing: Machine, kind: str, out: Path, **options: Any) -> CExport:
    """Export a kind that asks what it asks of the magnet of `BEARING`."""
    form = {"kind": "adaptive", "expert_form": "tabulated"} if kind == "tabulated" else {}
    return export_c(bearing, magnet_of(kind), out, **{"kind": kind} | form | options)


def estimator(kind: str, made: CExport) -> Estimator:
    """What was exported, in Python."""
    of = REGISTRY["adaptive" if kind == "tabulated" else kind]
    magnet = made.table or magnet_of(kind)
    return of.make(BEARING, magnet, precision=CORE_PRECISION[made.precision])


def flight_files(made: CExport) -> list[str]:
    """The C files and headers that a controller's firmware takes."""
    others = ("selftest/", "proof/")
    return [f for f in made.files if f.endswith((".c", ".h")) and not f.startswith(others)]


def command(compiler: str, flags: tuple[str, ...] = SAME_BITS) -> list[str]:
    """Return what compiles in an export's folder, with all warnings."""
    return [compiler, "-std=c99", *STRICT, *flags, *INCLUDES]


def understood(compiler: str, folder: Path, file: Path) -> subprocess.CompletedProcess[str]:
    """Let a compiler look at a file in an export's folder, with all warnings."""
    words = [*command(compiler), str(file), "-fsyntax-only"]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120)


def program(
    compiler: str, folder: Path, out: Path, flags: tuple[str, ...] = SAME_BITS
) -> subprocess.CompletedProcess[str]:
    """Compile an exported folder with its self-test, by hand: every C file that is there."""
    files = sorted(path.relative_to(folder) for path in folder.rglob("*.c"))
    words = [*command(compiler, flags), *files, "-lm", "-o", out]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)


def printed_by(
    folder: Path, compiler: str | None = COMPILER, flags: tuple[str, ...] = SAME_BITS
) -> str:
    """What the self-test of an exported folder prints, which compiles without a warning."""
    done = program(str(compiler), folder, folder / "selftest.out", flags)
    assert (done.returncode, done.stderr) == (0, "")
    return subprocess.run([folder / "selftest.out"], capture_output=True, text=True).stdout


SIZES = """#include "{0}.h"

size_t {0}_state_size(void);
size_t {0}_estimates_size(void);

size_t {0}_state_size(void)
{{
  return sizeof({0}_state);
}}

size_t {0}_estimates_size(void)
{{
  return sizeof({0}_estimates);
}}
"""  # Python does not read headers.


class Filters:
    """Exports in one shared library, called through their own headers."""

    def __init__(self, folder: Path, made: dict[str, CExport], precision: str) -> None:
        self.real = ctypes.c_float if precision == "float" else ctypes.c_double
        folders = [one.folder for one in made.values()]
        # By their names: what they share is compiled once.
        files = {file: one.folder / file for one in made.values() for file in one.sources}
        (folder / "sizes.c").write_text("".join(map(SIZES.format, made)))
        includes = [f"-I{one / part}" for one in folders for part in (".", "core/include", "core")]
        library = folder / "filters.so"
        flags = (*SAME_BITS, "-fPIC", *includes)
        words = [
            *command(str(COMPILER), flags),
            *files.values(),
            "sizes.c",
            "-shared",
            "-o",
            library,
        ]
        subprocess.run(words, cwd=folder, check=True)
        self.library = ctypes.CDLL(str(library))

    def start(self, name: str) -> Filter:
        return Filter(self, name)


class Filter:
    """One instance of an exported filter, which is started."""

    def __init__(self, filters: Filters, name: str) -> None:
        self.real, library = filters.real, filters.library
        state, estimates = (
            getattr(library, f"{name}_{what}_size")() for what in ("state", "estimates")
        )
        self.state = ctypes.create_string_buffer(state)
        self.estimates = (self.real * (estimates // ctypes.sizeof(self.real)))()
        self.functions = {
            what: getattr(library, f"{name}_{what}")
            for what in ("init", "reset", "step", "deviations", "deenergise")
            if hasattr(library, f"{name}_{what}")
        }
        self.started = self.functions["init"](self.state)  # a status, where numbers are editable

    def reset(self, y: float) -> int:
        return int(self.functions["reset"](self.state, self.real(y), self.estimates))

    def step(self, y: float, u: float) -> int:
        """Take a sample in; return the status."""
        inputs = self.real(y), self.real(u)
        return int(self.functions["step"](self.state, *inputs, self.estimates))

    def deenergise(self) -> None:
        self.functions["deenergise"](self.state)

    @property
    def feed_back(self) -> bool:
        """Whether the estimate may be fed back: behind its eight numbers."""
        return bool(bytes(self.estimates)[8 * ctypes.sizeof(self.real)])

    def deviations(self) -> list[float]:
        std = (self.real * 4)()
        self.functions["deviations"](self.state, std)
        return list(std)
