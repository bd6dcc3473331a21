"""Core and simulation for compilers that know C99 and nothing more, MSVC among them.

The vectors of `sim/lanes.c` are GCC's and clang's; without them one filter runs after the other.
"""

import re
import shutil
import subprocess
from itertools import product
from pathlib import Path

import pytest
from quick import quick

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted([*(ROOT / "core" / "src").glob("*.c"), *(ROOT / "sim").glob("*.c")])
INCLUDES = [f"-I{ROOT / folder}" for folder in ("core/include", "core", "sim")]
HEADERS = ROOT / "tests" / "export" / "headers"  # of a machine without extensions
STRING = """#include <stddef.h>
void *memcpy(void *to, const void *from, size_t n);
void *memset(void *to, int value, size_t n);
"""
BUILDS = [
    ("-DAMB_DOUBLE",), ("-DAMB_FLOAT",),
    ("-DAMB_DOUBLE", "-DAMB_MODEL_LOOPS"), ("-DAMB_FLOAT", "-DAMB_MODEL_LOOPS"),
]  # fmt: skip
COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(shutil.which(name) is None, reason=f"no {name}"))
    for name in ("gcc", "clang")
]


@pytest.fixture(scope="module")
def string_h(tmp_path_factory):
    """A folder with what of string.h is used, and no attributes of one C library."""
    folder = tmp_path_factory.mktemp("include")
    (folder / "string.h").write_text(STRING)
    return folder


def run(*command, cwd=None):
    return subprocess.run(
        [str(word) for word in command], cwd=cwd, capture_output=True, text=True, timeout=300
    )


@pytest.mark.parametrize(("compiler", "build"), quick(
    product(("gcc", "clang"), BUILDS), zip(("gcc", "clang"), BUILDS[::3], strict=True)
))  # fmt: skip
def test_nothing_but_c99(compiler, build):
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler}")
    flags = ["-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    done = run(compiler, *flags, "-U__GNUC__", *build, *INCLUDES, *SOURCES)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("compiler", COMPILERS)
def test_no_name_of_a_compilers_own(compiler, string_h):
    """Attributes and built-in functions pass -pedantic-errors; their names tell them."""
    includes = [f"-I{HEADERS}", f"-I{string_h}", *INCLUDES]
    for source in SOURCES:
        done = run(compiler, "-E", "-P", "-std=c99", "-undef", "-nostdinc", *includes, source)
        assert done.returncode == 0, done.stderr
        assert set(re.findall(r"\b__\w+|\basm\b|\btypeof\b", done.stdout)) == set(), source.name


@pytest.mark.skipif(shutil.which("clang") is None, reason="clang is not installed")
@pytest.mark.parametrize("build", BUILDS, ids=" ".join)
def test_a_compiler_as_msvc_takes_it(build, string_h, tmp_path):
    """Clang with MSVC's options, macros and ABI; of headers it needs those of the language."""
    like_msvc = ["clang", "--driver-mode=cl", "--target=x86_64-pc-windows-msvc", "/std:c11"]
    strict = ["/W4", "/WX", "/clang:-Wno-missing-field-initializers", "/clang:-ffreestanding"]
    made = "#ifdef __GNUC__\n#error this is GCC\n#endif\n#ifndef _MSC_VER\n#error MSVC\n#endif\n"
    (tmp_path / "probe.c").write_text(f"{made}int probe;\n")
    probe = run(*like_msvc, *strict, "/c", "probe.c", cwd=tmp_path)
    if probe.returncode:
        pytest.skip(f"this clang does not know Windows: {probe.stderr.strip()}")
    command = [*like_msvc, *strict, *build, f"-I{string_h}", *INCLUDES, "/c", "--", *SOURCES]
    done = run(*command, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(list(tmp_path.glob("*.obj"))) == len(SOURCES) + 1


@pytest.mark.long
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("precision", ["-DAMB_DOUBLE", "-DAMB_FLOAT"])
def test_lanes_without_vectors_have_the_same_bits(compiler, precision, tmp_path):
    """All estimators in lanes, faults and all, compiled both ways: one digest of all results."""
    both = [source for source in SOURCES if source.stem in {"batch", "lanes", "lanes_fuzzy"}]
    rest = [source for source in SOURCES if source not in both]
    tests = ROOT / "tests" / "c"
    flags = ["-std=c99", "-O1", "-ffp-contract=off", precision, *INCLUDES, f"-I{tests}"]
    done = run(compiler, *flags, "-c", *rest, tests / "axis.c", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    objects = sorted(tmp_path.glob("*.o"))
    said = {}
    for name, way in (("vectors", []), ("alone", ["-DAMB_NO_VECTORS"])):
        program = tmp_path / name
        sources = [*both, tests / "test_batch.c", *objects]
        done = run(compiler, *flags, *way, *sources, "-lm", "-o", program)
        assert done.returncode == 0, done.stderr
        done = run(program)
        assert done.returncode == 0, done.stderr
        said[name], digest = done.stdout.split()[0], done.stdout.split()[1]
        said[f"digest of {name}"] = digest
    assert (said["vectors"], said["alone"]) == ("vectors", "alone")
    assert said["digest of vectors"] == said["digest of alone"]
