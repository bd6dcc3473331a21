"""Exported C through gcc and clang, linked as a controller's firmware would, and run."""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from export_cases import (
    BEARING,
    CASES,
    KINDS,
    PRECISIONS,
    Filters,
    command,
    estimator,
    export,
    program,
    understood,
)

import ambkit
from ambkit.export.c import CExport

COMPILERS = [
    pytest.param(name, marks=pytest.mark.skipif(not shutil.which(name), reason=f"no {name}"))
    for name in ("gcc", "clang")
]
Exported = Callable[..., CExport]
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


pytestmark = pytest.mark.long


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize(
    ("kind", "precision"), [*CASES, ("linear", "double"), ("tabulated", "double")]
)
def test_it_compiles_without_a_warning_and_passes(exported, tmp_path, kind, precision, compiler):
    done = program(compiler, exported(kind, precision).folder, tmp_path / "selftest")
    assert (done.returncode, done.stderr) == (0, "")
    said = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert re.fullmatch(
        r"pass: zittau_axial, \d{3} samples, two instances: equal to the last bit\n", said.stdout
    )
    assert said.returncode == 0


def cpu_flags():
    try:
        return set(Path("/proc/cpuinfo").read_text().split())
    except OSError:
        return set()


@needs_gcc
@pytest.mark.skipif("fma" not in cpu_flags(), reason="this processor has no fused multiply-add")
@pytest.mark.parametrize("kind", KINDS)
def test_where_the_compiler_contracts_it_passes_within_its_bound(exported, tmp_path, kind):
    flags = ("-O2", "-mfma", "-ffp-contract=fast")
    done = program("gcc", exported(kind).folder, tmp_path / "selftest", flags)
    assert (done.returncode, done.stderr) == (0, "")
    said = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert said.returncode == 0
    assert re.match(r"pass: .* samples, two instances\n[1-9]\d* numbers differ: ", said.stdout)


@needs_gcc
@pytest.mark.parametrize(
    ("file", "pattern", "changed"),
    [
        ("selftest/{}_vectors.c", r"_expected\[.*\{\s+\{[^,]*", "an expected state"),
        ("selftest/{}_vectors.c", r"_y\[.*\{\s+(?:[^,]*,){50}[^,]*", "a measurement"),
        ("selftest/{}_vectors.c", r"_u\[.*\{\s+(?:[^,]*,){50}[^,]*", "a control signal"),
        ("selftest/{}_vectors.c", r"_status\[.*\{\s+[^,U]*", "a status"),
        ("{}_data.c", r"\.var_y = \{\s*[^,}]*", "a setting"),
        ("{}_data.c", r"_std\[.*\{\s+[^,]*", "a start"),
        ("core/src/kalman_sensor.h", r"unchanged >= ", "the frozen sensor"),
    ],
)
def test_the_selftest_fails_where_something_is_wrong(exported, tmp_path, file, pattern, changed):
    made = exported("adaptive")
    shutil.copytree(made.folder, tmp_path / "out")
    path = tmp_path / "out" / file.format(made.name)
    text = path.read_text()
    match = re.search(pattern, text)
    assert match, changed
    # The number that the match ends with, or the comparison.
    found = match[0]
    if found.endswith(">= "):
        spoilt = found.replace(">=", "<")
    elif "status" in found:
        spoilt = re.sub(r"\d$", lambda digit: str((int(digit[0]) + 1) % 10), found)
    else:
        spoilt = re.sub(
            r"([\d.]+)(e-?\d+)?F$", lambda n: f"{1.001 * float(n[1]):.9g}{n[2] or ''}F", found
        )
    assert spoilt != found, changed
    path.write_text(text[: match.start()] + spoilt + text[match.end() :])
    done = program("gcc", tmp_path / "out", tmp_path / "selftest")
    assert (done.returncode, done.stderr) == (0, "")
    said = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert said.returncode == 1, changed
    assert said.stdout.startswith("FAIL: zittau_axial")


@needs_gcc
@pytest.mark.parametrize("kind", KINDS)
def test_the_example_of_its_readme_compiles(exported, tmp_path, kind):
    made = exported(kind)
    examples = re.findall(r"```c\n(.*?)```", (made.folder / "README.md").read_text(), re.DOTALL)
    assert len(examples) == 2
    text = "\n".join(examples).replace("now);", "now); (void)status;")
    (tmp_path / "example.c").write_text(text)
    done = understood("gcc", made.folder, tmp_path / "example.c")
    assert (done.returncode, done.stderr) == (0, "")


@needs_gcc
@pytest.mark.parametrize("name", ["filter_task", "two_tasks"])
def test_the_tasks_of_the_docs_compile(exported, name):
    task = Path(__file__).parents[1] / "examples" / "controller" / f"{name}.c"
    done = understood("gcc", exported("linear").folder, task)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
@pytest.mark.parametrize("kind", KINDS)
def test_its_header_is_c_plus_plus_as_well(exported, tmp_path, kind):
    made = exported(kind)
    name = made.name
    (tmp_path / "user.cpp").write_text(
        f'#include "{name}.h"\n\nvoid start({name}_state &state)\n{{\n  {name}_init(&state);\n}}\n'
    )
    words = ["g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-I.",
             "-Icore/include", "-Icore", str(tmp_path / "user.cpp")]  # fmt: skip
    done = subprocess.run(words, cwd=made.folder, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


# ---- Linked into a program, called as a controller would ----


@needs_gcc
@pytest.mark.parametrize("precision", PRECISIONS)
def test_instances_of_several_filters_run_side_by_side(tmp_path, precision):
    """One program, each kind with a prefix of its own, two instances of each, in any order."""
    built_in = [kind for kind in KINDS if kind != "constant-velocity"]  # of one core
    kinds = {f"f{n}": kind for n, kind in enumerate(built_in)}
    made = {
        name: export(kind, tmp_path / name, prefix=name, precision=precision)
        for name, kind in kinds.items()
    }
    filters = Filters(tmp_path, made, precision)
    scenario = ambkit.Scenario(
        duration=0.03, reference=ambkit.Step(amplitude=4e-4, time=5e-3), seed=2
    )
    record = ambkit.simulate(BEARING, scenario).record
    backwards = ambkit.Record(
        record.t,
        {"y": record["y"][::-1].copy(), "u": record["u"][::-1].copy()},
        {"y": "m", "u": "V"},
    )
    runs = [(name, log) for name in kinds for log in (record, backwards)]
    instances = [filters.start(name) for name, _ in runs]
    found = np.zeros((len(runs), len(record.t), 5))
    taken = np.zeros(len(runs), dtype=int)
    for turn in np.random.default_rng(0).permutation(np.repeat(range(len(runs)), len(record.t))):
        k, log = taken[turn], runs[turn][1]
        one, y = instances[turn], float(log["y"][k])
        status = one.step(y, float(log["u"][k - 1])) if k else one.reset(y)
        found[turn, k] = (*one.estimates[:4], status)
        taken[turn] += 1
    for (name, log), got in zip(runs, found, strict=True):
        expected = estimator(kinds[name], made[name]).run(log)
        np.testing.assert_array_equal(got[:, :4], expected.mean, kinds[name])
        np.testing.assert_array_equal(got[:, 4], expected.status)


@needs_gcc
@pytest.mark.skipif(shutil.which("nm") is None, reason="nm is not installed")
@pytest.mark.parametrize("kind", KINDS)
def test_every_name_has_the_prefix_and_nothing_is_borrowed(exported, tmp_path, kind):
    made = export(kind, tmp_path / "out", prefix="Axis_2")
    assert {f"{made.name}{ending}" for ending in (".h", ".c", "_data.h", "_data.c")} <= set(
        made.files
    )
    compiled = []
    for name in made.sources:
        compiled.append(str(tmp_path / f"{Path(name).stem}.o"))
        words = [*command("gcc"), "-c", name, "-o", compiled[-1]]
        subprocess.run(words, cwd=made.folder, check=True)

    def symbols(*options):
        words = ["nm", "--extern-only", "--just-symbols", "--quiet", *options, *compiled]
        done = subprocess.run(words, check=True, capture_output=True, text=True)
        return {line for line in done.stdout.split() if not line.endswith(":")}

    own = symbols("--defined-only")
    assert {f"Axis_2_{function}" for function in ("init", "reset", "step")} <= own
    assert [name for name in own if not name.startswith(("Axis_2_", "amb_"))] == []
    # What a compiler may call of itself, and nothing else: no libm, no malloc, no stdio.
    assert symbols("--undefined-only") - own <= {"memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}
    # C99 promises 31 significant characters.
    assert len({name[:31] for name in own}) == len(own)


@needs_gcc
@pytest.mark.parametrize("kind", ["linear", "extended", "observer", "augmented", "low-pass"])
def test_init_is_all_there_is_to_do_at_power_on(exported, tmp_path, kind):
    """The first measurement is where it starts; what may be fed back is said."""
    made = exported(kind)
    flies = Filters(tmp_path, {made.name: made}, "float").start(made.name)
    header = (made.folder / f"{made.name}.h").read_text()
    settling = int(re.search(r"_SETTLING (\d+)U", header)[1])
    flies.step(float("nan"), 0.0)
    assert not flies.feed_back
    for k in range(3 * settling):  # the rotor lies on the stop; an observer takes that long
        flies.step(-0.8e-3 + 1e-6 * (k % 3), -1.5)
        if k == 0:
            assert flies.estimates[0] == pytest.approx(-0.8e-3, rel=1e-3)
            assert not flies.feed_back
    assert flies.feed_back
    for _ in range(settling):
        assert flies.feed_back
        flies.step(float("nan"), -1.5)
    assert not flies.feed_back
