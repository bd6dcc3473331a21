"""The C tests: each public function with good and bad input, under ASan and UBSan, in all builds.

Compiled as the controller's build would be (C99, no warnings), and run here: in both precisions,
with the paper's axis built in and with loops over the same axis written as arrays.
"""

import os
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from quick import quick

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = sorted(path.stem for path in (ROOT / "tests" / "c").glob("test_*.c"))
SOURCES = sorted([*(ROOT / "core" / "src").glob("*.c"), *(ROOT / "sim").glob("*.c")])
INCLUDES = [f"-I{ROOT / folder}" for folder in ("core/include", "core", "sim", "tests/c")]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover"]


@dataclass(frozen=True)
class Build:
    """A precision, and the axis built in or loops over any model."""

    precision: str
    loops: bool

    def __str__(self):
        return f"{self.precision}{' loops' if self.loops else ''}"

    @property
    def flags(self):
        """What the compiler is told of it."""
        return [f"-D{self.precision}", *(["-DAMB_MODEL_LOOPS"] if self.loops else [])]


Compiled = Callable[[Build], list[Path]]
BUILDS = [
    Build(precision, loops) for precision in ("AMB_DOUBLE", "AMB_FLOAT") for loops in (False, True)
]
ONLY_IN_LOOPS = {"test_loops"}
ALL = [
    (name, build)
    for name in PROGRAMS
    for build in BUILDS[1:3]
    if build.loops or name not in ONLY_IN_LOOPS
]
# The axis in the precision that flies is quick; loops in the other one are long. All four builds
# are flown through Python, and an expression is the same text in each.
CASES = quick(ALL, [(name, build) for name, build in ALL if build == BUILDS[2]])
# What core and simulation may ask for that is not theirs, and what compilers write themselves.
LIBC = {"memcpy", "memset", "memcmp", "memmove", "sqrt", "sqrtf"}
OF_COMPILERS = {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


GCC = ["gcc", "-std=c99", "-O0", "-g1", "-ffp-contract=off", *WARNINGS, *SANITIZERS]


def gcc(*arguments):
    return subprocess.run([*GCC, *map(str, arguments)], capture_output=True, text=True)


def run(program):
    # Nothing here allocates; looking for leaks needs rights that a container may not give.
    settings = os.environ | {
        "ASAN_OPTIONS": "detect_leaks=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
    return subprocess.run([program], capture_output=True, text=True, env=settings, timeout=120)


@pytest.fixture(scope="session")
def objects(tmp_path_factory):
    """The core and the simulation, compiled once for each build that is asked for."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("c")
    (folder / "empty.c").write_text("int main(void)\n{\n  return 0;\n}\n")
    probe = gcc(folder / "empty.c", "-o", folder / "empty")
    if probe.returncode or run(folder / "empty").returncode:
        pytest.skip(f"gcc has no working sanitizers: {probe.stderr.strip()}")

    @cache
    def compiled(build):
        # The axis of the tests takes its numbers from the model that is built in.
        built_in = Build(build.precision, loops=False)
        objects = []
        for source in [*SOURCES, ROOT / "tests" / "c" / "axis.c"]:
            flags = built_in.flags if source.stem == "axis" else build.flags
            objects.append(folder / f"{build} {source.stem}.o")
            done = gcc(*flags, *INCLUDES, "-c", source, "-o", objects[-1])
            assert (done.returncode, done.stderr) == (0, "")
        return objects

    return compiled


@pytest.mark.parametrize(("name", "build"), CASES, ids=str)
def test_c(name, build, objects, tmp_path):
    source, program = ROOT / "tests" / "c" / f"{name}.c", tmp_path / name
    built = gcc(*build.flags, *INCLUDES, source, *objects(build), "-lm", "-o", program)
    assert built.returncode == 0, built.stderr
    done = run(program)
    assert done.returncode == 0, done.stderr


def foreign(folder, build, sources):
    """What these sources ask for that is in none of them, compiled as the package's build is.

    The optimiser asks for more than the text does; one of two builds shows that as well.
    """
    optimised = "-O3" if build == BUILDS[0] else "-O0"
    flags = [optimised, "-fPIC", "-ffp-contract=off", "-fno-trapping-math", *build.flags, *INCLUDES]
    paths = [str(source) for source in sources]
    subprocess.run(["gcc", "-std=c99", *flags, "-c", *paths], cwd=folder, check=True)
    asked, defined = set[str](), set[str]()
    for made in folder.glob("*.o"):
        names = subprocess.run(
            ["nm", "-P", made], capture_output=True, text=True, check=True
        ).stdout
        for line in names.splitlines():
            name, kind = line.split()[:2]
            (asked if kind in "Uvw" else defined).add(name)
    return asked - defined


@pytest.mark.skipif(
    shutil.which("gcc") is None or shutil.which("nm") is None, reason="there is no gcc or no nm"
)
@pytest.mark.long
@pytest.mark.parametrize("build", [BUILDS[0], BUILDS[3]], ids=str)
def test_of_libm_there_is_only_the_root(build, tmp_path):
    """A controller's libm is another one: what rounds differently there may not be used."""
    assert foreign(tmp_path, build, SOURCES) - OF_COMPILERS <= LIBC
    wrong = tmp_path / "wrong" / "wrong.c"
    wrong.parent.mkdir()
    wrong.write_text("#include <math.h>\ndouble f(double a)\n{\n  return exp(a);\n}\n")
    assert foreign(wrong.parent, build, [wrong]) - OF_COMPILERS == {"exp"}


def test_the_sanitizers_would_stop_a_program(objects, tmp_path):
    """An overflow, an index beyond an array, NaN made an integer: each must be fatal."""
    faults = {
        "overflow": "int i = 2147483647; i += argc; return i == 0;",
        "index": "int a[2] = {1, 2}; return a[argc + 1] == 0;",
        "conversion": "const double zero = argc - 1; return (int)(zero / zero) == 0;",
    }
    for name, body in faults.items():
        source = tmp_path / f"{name}.c"
        source.write_text(f"int main(int argc, char **argv)\n{{\n  (void)argv;\n  {body}\n}}\n")
        built = gcc(source, "-o", tmp_path / name)
        assert built.returncode == 0, built.stderr
        assert run(tmp_path / name).returncode != 0, name


def test_a_failed_check_fails_the_program(objects, tmp_path):
    source = tmp_path / "wrong.c"
    checks = "CHECK(1 < 0);\n  CHECK_NEAR(1, 2);\n  CHECK(same(1, 1));"
    source.write_text(f'#include "check.h"\nint main(void)\n{{\n  {checks}\n'
                      "  CHECK(all_finite(NULL, 0));\n  return failures;\n}\n")  # fmt: skip
    built = gcc("-DAMB_DOUBLE", *INCLUDES, source, "-o", tmp_path / "wrong")
    assert built.returncode == 0, built.stderr
    done = run(tmp_path / "wrong")
    assert done.returncode == 2
    assert "wrong.c:4: 1 < 0" in done.stderr
    assert "is 1, expected 2" in done.stderr
