"""Exports that meet: several in one firmware, and in C++; names that a linker or compiler has."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from export_cases import INCLUDES, STRICT, command, export
from exporting import export_c
from machine_cases import machine

from ambkit.base.errors import AmbkitError
from ambkit.export import core_sources
from ambkit.export.c import exporter

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
needs_gpp = pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")

MAIN = """#include <stdio.h>
{includes}
int main(void)
{{
{calls}
  return 0;
}}
"""
ONE = """int try_{0}(void);

#include "{0}_selftest.h"

int try_{0}(void)
{{
  {0}_selftest_result found;
  {0}_selftest(&found);
  return {0}_selftest_passed(&found, true) ? 0 : 1;
}}
"""


def objects_of(made, folder):
    """Compile an export with its self-test, in its own folder as in a makefile of its own."""
    tests = [f"selftest/{made.name}_{part}.c" for part in ("selftest", "vectors")]
    trial = folder / f"{made.name}_try.c"
    trial.write_text(ONE.format(made.name))
    found = []
    for source in [*made.sources, *tests, str(trial)]:
        found.append(folder / f"{made.name}_{len(found)}_{Path(source).stem}.o")
        words = [*command("gcc"), "-c", source, "-o", found[-1]]
        subprocess.run(words, cwd=made.folder, check=True)
    return found


def symbols(objects):
    words = ["nm", "--extern-only", "--defined-only", "--just-symbols", "--quiet"]
    done = subprocess.run([*words, *map(str, objects)], check=True, capture_output=True, text=True)
    return {line for line in done.stdout.split() if not line.endswith(":")}


@pytest.fixture
def of_another_version(monkeypatch, tmp_path):
    """From here on, another text of the core: a struct has its fields in another order."""
    changed = tmp_path / "another core"
    shutil.copytree(core_sources.folder(), changed)
    header = changed / "include" / "ambkit" / "kalman.h"
    last, lines = "  amb_kalman_settings set;\n", header.read_text()
    assert lines.count(last) == 1
    header.write_text(lines.replace(last, "").replace("} amb_kalman;", f"{last}}} amb_kalman;"))
    monkeypatch.setattr(core_sources, "folder", lambda: changed)


@pytest.mark.long
@needs_gcc
def test_float_double_another_model_and_another_version_in_one_firmware(tmp_path, request):
    made = [
        export("linear", tmp_path / "a", prefix="a"),
        export("adaptive", tmp_path / "b", prefix="b", precision="double"),
        export_c(machine(), None, tmp_path / "c", prefix="c"),
        export_c(machine(), None, tmp_path / "d", prefix="d", loops=False),
    ]
    request.getfixturevalue("of_another_version")
    made.append(export("linear", tmp_path / "e", prefix="e"))
    parts = [objects_of(one, tmp_path) for one in made]
    for n, mine in enumerate(parts):
        for other in parts[n + 1 :]:
            assert symbols(mine) & symbols(other) == set()
    calls = "\n".join(f'  (void)printf("%d", try_{one.name}());' for one in made)
    main = tmp_path / "main.c"
    main.write_text(
        MAIN.format(includes="".join(f"int try_{m.name}(void);\n" for m in made), calls=calls)
    )
    linked = ["gcc", str(main), *(str(o) for part in parts for o in part), "-o", "all"]
    done = subprocess.run(linked, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert subprocess.run([tmp_path / "all"], capture_output=True, text=True).stdout == "00000"


def test_what_is_equal_is_shared(tmp_path, request):
    place = "core/include/ambkit/precision.h"
    first = export("linear", tmp_path / "first")
    again = export("adaptive", tmp_path / "again")
    assert (first.folder / place).read_text() == (again.folder / place).read_text()
    request.getfixturevalue("of_another_version")
    other = export("linear", tmp_path / "other")
    assert (first.folder / place).read_text() != (other.folder / place).read_text()


@needs_gpp
@pytest.mark.parametrize("kind", ["linear", "multiple-model", "linear-adaptive-noise", "machine"])
def test_a_main_in_c_plus_plus_links(tmp_path, kind):
    """With all headers of the export, before and after those of the library of C++."""
    if kind == "machine":
        made = export_c(machine(), None, tmp_path / "c", prefix="axis")
    else:
        made = export(kind, tmp_path / "c", prefix="axis")
    headers = [
        file.removeprefix("core/include/")
        for file in made.files
        if file.endswith(".h") and file.startswith(("core/include/", "axis", "selftest/"))
    ]
    includes = "".join(
        f'#include "{Path(h).name if "/" in h and "ambkit" not in h else h}"\n' for h in headers
    )
    (tmp_path / "main.cpp").write_text(
        f"{includes}#include <cmath>\n#include <cstdio>\n\nint main()\n{{\n"
        "  axis_selftest_result found;\n  axis_selftest(&found);\n"
        '  std::printf("%d", axis_selftest_passed(&found, true) ? 0 : 1);\n  return 0;\n}\n'
    )
    parts = [str(part) for part in objects_of(made, tmp_path)]
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", *INCLUDES,
             str(tmp_path / "main.cpp"), *parts, "-o", str(tmp_path / "run")]  # fmt: skip
    done = subprocess.run(words, cwd=made.folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert subprocess.run([tmp_path / "run"], capture_output=True, text=True).stdout == "0"


def test_includes_stand_outside_of_extern_c():
    for header in sorted((core_sources.folder() / "include" / "ambkit").glob("*.h")):
        block = re.search(r'extern "C" \{(.*)', header.read_text(), re.DOTALL)
        if block is not None:
            assert "#include" not in block[1], header.name
    assert {"-Wall"} <= set(STRICT)


# ---- Prefixes ----


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("amb", 'the core start with "amb_"'),
        ("AMB_x", 'the core start with "amb_"'),
        ("ambkit_kalman", 'the core start with "amb_"'),
        ("float", "a header of C"),
        ("restrict", "a word of C"),
        ("class", "a word of C"),
        ("Test", "a target of the build"),
        ("all", "a target of the build"),
        ("main", "a target of the build"),
        ("NUL", "no file, on Windows"),
        ("_x", "a letter first"),
        ("2nd", "a letter first"),
        ("a2345678901234567", "at most 16 characters"),
    ],
)
def test_a_prefix_that_cannot_be_is_refused(tmp_path, given, said):
    with pytest.raises(AmbkitError, match=re.escape(said)):
        export("linear", tmp_path / "c", prefix=given)
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("name", "made"),
    [
        ("float", "axis_float"),
        ("amb", "axis_amb"),
        ("test", "axis_test"),
        ("int", "axis_int"),
        ("2nd bearing", "axis_2nd_bearing"),
        ("a rather long name of a bearing", "a_rather_long_na"),
        ("Größe", "Gr__e"),
        ("öl", "axis__l"),
    ],
)
def test_a_name_that_cannot_be_one_gives_another(name, made):
    assert exporter.checked(None, name) == made


# ---- Headers of two exports in one file ----


@needs_gcc
def test_headers_of_another_precision_are_refused_when_they_are_compiled(tmp_path):
    """The first include folder has the core's headers, for both."""
    made = [
        export("linear", tmp_path / "a", prefix="a"),
        export("linear", tmp_path / "b", prefix="b", precision="double"),
        export("extended", tmp_path / "c", prefix="c"),
    ]
    includes = [f"-I{one.folder / at}" for one in made for at in (".", "core/include", "core")]

    def compiled(*names):
        main = tmp_path / "main.c"
        main.write_text("".join(f'#include "{name}.h"\n' for name in names) + "int main(void);\n")
        words = ["gcc", "-std=c99", "-fsyntax-only", *includes, str(main)]
        return subprocess.run(words, capture_output=True, text=True)

    assert compiled("a", "c").returncode == 0  # of one core
    both = compiled("a", "b")
    assert both.returncode != 0
    assert "b.h: the core's headers come from another export" in both.stderr
