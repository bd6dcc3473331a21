"""The C tests: each public function with good and bad input, under ASan and UBSan, in both builds.

Compiled as the controller's build would be (C99, no warnings), and run here.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PROGRAMS = sorted(path.stem for path in (ROOT / "tests" / "c").glob("test_*.c"))
SOURCES = sorted([*(ROOT / "core" / "src").glob("*.c"), *(ROOT / "sim").glob("*.c")])
INCLUDES = [f"-I{ROOT / folder}" for folder in ("core/include", "core", "sim", "tests/c")]
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
SANITIZERS = ["-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover"]
PRECISIONS = ["AMB_DOUBLE", "AMB_FLOAT"]


def gcc(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = ["gcc", "-std=c99", "-O1", "-g", "-ffp-contract=off", *WARNINGS, *SANITIZERS]
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True)


def run(program: Path) -> subprocess.CompletedProcess[str]:
    # Nothing here allocates; looking for leaks needs rights that a container may not give.
    settings = os.environ | {
        "ASAN_OPTIONS": "detect_leaks=0",
        "UBSAN_OPTIONS": "print_stacktrace=1",
    }
    return subprocess.run([program], capture_output=True, text=True, env=settings, timeout=120)


@pytest.fixture(scope="session")
def objects(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    """The core and the simulation, compiled once for each precision."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    folder = tmp_path_factory.mktemp("c")
    (folder / "empty.c").write_text("int main(void)\n{\n  return 0;\n}\n")
    probe = gcc(folder / "empty.c", "-o", folder / "empty")
    if probe.returncode or run(folder / "empty").returncode:
        pytest.skip(f"gcc has no working sanitizers: {probe.stderr.strip()}")
    compiled: dict[str, list[Path]] = {}
    for precision in PRECISIONS:
        compiled[precision] = [folder / f"{precision}_{source.stem}.o" for source in SOURCES]
        for source, target in zip(SOURCES, compiled[precision], strict=True):
            done = gcc(f"-D{precision}", *INCLUDES, "-c", source, "-o", target)
            assert done.returncode == 0, done.stderr
    return compiled


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("name", PROGRAMS)
def test_c(name: str, precision: str, objects: dict[str, list[Path]], tmp_path: Path) -> None:
    source, program = ROOT / "tests" / "c" / f"{name}.c", tmp_path / name
    built = gcc(f"-D{precision}", *INCLUDES, source, *objects[precision], "-lm", "-o", program)
    assert built.returncode == 0, built.stderr
    done = run(program)
    assert done.returncode == 0, done.stderr


def test_the_sanitizers_would_stop_a_program(
    objects: dict[str, list[Path]], tmp_path: Path
) -> None:
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


def test_a_failed_check_fails_the_program(objects: dict[str, list[Path]], tmp_path: Path) -> None:
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
