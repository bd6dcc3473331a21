"""The examples of CONTRIBUTING.md, built as they stand, in a copy of the checkout's Python."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import ambkit._core

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


def changed(text, diff, name):
    """Apply a diff without line numbers: what it takes away and keeps must be there once."""
    for hunk in diff.split("@@\n"):
        lines = [(line[:1], line[1:]) for line in hunk.splitlines()]
        old = "".join(f"{line}\n" for sign, line in lines if sign in " -")
        new = "".join(f"{line}\n" for sign, line in lines if sign in " +")
        assert text.count(old) == 1, f"{name} does not hold once:\n{old}"
        text = text.replace(old, new)
    return text


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """The checkout's Python and headers with all examples, and the extension as it is built."""
    folder = tmp_path_factory.mktemp("contributing")
    away = shutil.ignore_patterns("__pycache__", "*.so")
    for part in ("src/ambkit", "models", "core"):
        shutil.copytree(ROOT / part, folder / part, ignore=away)
    (folder / "bindings").mkdir()
    shutil.copy(ROOT / ".clang-format", folder)
    for built in Path(ambkit._core.__file__).parent.glob("_*.so"):
        (folder / "src" / "ambkit" / built.name).symlink_to(built)
    # What leads imports of an editable install to the checkout.
    (folder / "sitecustomize.py").write_text(
        "import sys\n"
        "sys.meta_path = [f for f in sys.meta_path if 'ScikitBuild' not in type(f).__name__]\n"
    )
    for kind, block in BLOCKS:
        first, _, rest = block.partition("\n")
        if kind in ("python", "toml"):
            file = folder / first.removeprefix("# ")
            assert not file.exists()
            file.write_text(rest, encoding="utf-8")
        elif kind == "diff":
            file = folder / first.removeprefix("--- ")
            file.write_text(changed(file.read_text(encoding="utf-8"), rest, first))
    return folder


def run(copy, *command, cwd=None, timeout=300):
    """What a command of the copy prints; it must succeed."""
    environment = os.environ | {"PYTHONPATH": f"{copy / 'src'}{os.pathsep}{copy}"}
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd or copy, env=environment,
        capture_output=True, text=True, timeout=timeout,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def python(copy, text):
    """Run lines of Python; what they print."""
    where = "import ambkit, pathlib; assert pathlib.Path(ambkit.__file__).is_relative_to('.')\n"
    where = where.replace("'.'", repr(str(copy)))
    return run(copy, sys.executable, "-c", where + text)


def commands(copy, *lines, cwd=None):
    """What commands print, one after the other in one process."""
    text = f"""
import shlex
from ambkit.cli.main import main
for line in {lines!r}:
    try:
        main(shlex.split(line))
    except SystemExit as left:
        assert not left.code
"""
    return run(copy, sys.executable, "-c", text, cwd=cwd)


def test_there_is_an_example_for_each_thing_to_add():
    heads = re.findall(r"^## An? (.*)$", TEXT, re.MULTILINE)
    expected = [
        "magnet law",
        "state",
        "sensor",
        "estimator",
        "block of a controller",
        "preset",
        "file format",
        "command",
    ]
    assert heads == expected
    texts = re.split(r"^## An? .*$", TEXT, flags=re.MULTILINE)[1:]
    for head, text in zip(expected, texts, strict=True):
        assert "```python" in text or "```toml" in text, head


def test_files_that_are_named_are_there():
    named = re.findall(r"`((?:src|core|bindings|tests|docs|models|tools)/[\w/.]+\.\w+)`", TEXT)
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_the_examples_are_in_our_style(copy):
    files = [
        block.partition("\n")[0].removeprefix("# ") for kind, block in BLOCKS if kind == "python"
    ]
    shutil.copy(ROOT / "pyproject.toml", copy)
    ruff = Path(sys.executable).parent / "ruff"
    run(copy, ruff, "check", *files)
    run(copy, ruff, "format", "--diff", *files)


@pytest.fixture(scope="module")
def law(copy):
    """The copy with everything that follows from the new law."""
    run(copy, sys.executable, "-m", "models")
    return copy


@needs_cc
def test_the_law_becomes_c_that_computes_it(law, tmp_path):
    (tmp_path / "main.c").write_text(
        '#include "ambkit/lorentz.h"\n#include <stdio.h>\nint main(void) {\n'
        "  const amb_lorentz_law law = {12.0, 0.002, true, 1.0, 0.001};\n"
        "  const amb_magnet_methods m = amb_lorentz_magnet;\n"
        "  const amb_stiffness t = m.tangent(&law, 0.5, 0.001);\n"
        "  const amb_stiffness k = m.through_origin(&law, 0.5, 0.001);\n"
        '  printf("%.15g %.15g %.15g %.15g", m.force(&law, 0.5, 0.001), t.k_i, t.k_s,\n'
        "         k.k_i * 0.5 + k.k_s * 0.001);\n"
        "  return 0;\n}\n"
    )
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-DAMB_DOUBLE"]
    flags += [f"-I{law / folder}" for folder in ("core", "core/include")]
    run(law, "cc", *flags, law / "core/src/lorentz.c", "main.c", "-o", "main", cwd=tmp_path)
    assert run(law, tmp_path / "main").split() == ["4.5", "9", "-3000", "4.5"]


MAGNET = """
import ambkit
bearing = ambkit.preset("zittau_axial").replace(
    magnet__force_constant="12 N/A", magnet__stroke="2 mm"
)
magnet = ambkit.magnet_of(bearing)
"""


def test_the_law_has_its_class_and_keys(law):
    text = python(
        law,
        """
from types import SimpleNamespace
from ambkit.machine.parts import Magnet
from ambkit.machine.laws import LAWS
magnet = SimpleNamespace(saturation=None, force_constant=12.0, stroke=None)
print(*(law.parameters_of(magnet) for law in LAWS if law.holds_for(magnet)))
print("force_constant" in Magnet.model_fields, "stroke" in Magnet.model_fields)
""",
    )
    assert text == "{'c': 12.0, 'stroke': inf}\nTrue True\n"
    assert '"lorentz"' in (law / "bindings" / "laws.h").read_text()


@pytest.mark.long
@needs_cc
def test_the_law_flies_and_is_exported(law, tmp_path):
    """The extension with the law, built anew: plant, filter and exported C take it."""
    pytest.importorskip("nanobind")
    shutil.copytree(ROOT / "sim", law / "sim")
    shutil.copytree(ROOT / "bindings", law / "bindings", dirs_exist_ok=True,
                    ignore=shutil.ignore_patterns("laws.h"))  # fmt: skip
    for folder in ("examples/recordings", "docs/paper"):
        (law / folder).mkdir(parents=True)
    text = (ROOT / "CMakeLists.txt").read_text()
    assert text.count(" -O3 ") == 1  # the same bits, in less time, and with nanobind's own checks
    (law / "CMakeLists.txt").write_text(text.replace(" -O3 ", " -O0 "))
    cmake = [sys.executable, "-m", "nanobind", "--cmake_dir"]
    where = subprocess.run(cmake, capture_output=True, text=True, check=True).stdout.strip()
    run(law, "cmake", "-S", law, "-B", tmp_path / "build", f"-Dnanobind_DIR={where}",
        f"-DPython_EXECUTABLE={sys.executable}", "-DAMBKIT_VECTORS=OFF",
        "-DCMAKE_CXX_FLAGS_RELEASE=-O0", timeout=1800)  # fmt: skip
    run(law, "cmake", "--build", tmp_path / "build", "--target", "_core", timeout=1800)
    (built,) = (tmp_path / "build").glob("_core.*so")
    for old in (law / "src" / "ambkit").glob("_core.*so"):
        old.unlink()
    shutil.copy(built, law / "src" / "ambkit")
    text = python(
        law,
        f"""{MAGNET}
import numpy as np
from ambkit.export.c import export_c
scenario = ambkit.Scenario(duration=0.1, controller=ambkit.Control(feedback="measurement"))
record = ambkit.simulate(bearing, scenario).record
kf = ambkit.ExtendedKalmanFilter(bearing, magnet)
estimate = kf.run(record)
print(float(magnet.force(0.5, 0.001)), bool(np.abs(record["x"]).max() < 1e-4))
print(bool(np.std(estimate["x"] - record["x"]) < np.std(record["y"] - record["x"])))
export_c(bearing, ambkit.AdaptiveKalmanFilter(bearing, magnet), {str(tmp_path / "c")!r})
""",
    )
    assert text.split() == ["4.5", "True", "True"]
    assert (tmp_path / "c" / "core/src/lorentz.c").is_file()
    run(law, "cmake", "-S", tmp_path / "c", "-B", tmp_path / "c/build")
    run(law, "cmake", "--build", tmp_path / "c/build")
    assert "equal to the last bit" in run(law, tmp_path / "c/build/selftest")


def test_the_state_is_in_the_filter_and_in_its_c(copy, tmp_path):
    said = python(
        copy,
        f"""
import ambkit
from ambkit.simulation.recording import noise_samples
steady = ambkit.preset("zittau_axial")
bearing = steady.replace(sensor__drift="1e6 um^2/s")
record = ambkit.simulate(bearing, ambkit.Scenario(duration=0.1)).record
_, white = noise_samples(steady, ambkit.Scenario(), len(record))
zero = record["y"] - record["x_m"] - white[:, 0]
assert abs(zero[0]) < 1e-12 < abs(zero[1]) < 1e-4, zero
assert 1e-5 < abs(zero).max() < 2e-3, zero  # a random walk to 0.3 mm rms
estimate = ambkit.KalmanFilter(bearing).run(record, covariance=True)
assert estimate.mean.shape[1] == 5
print(estimate.states[-1].name, bool((estimate.std("drift") > 0).all()))
ambkit.export_c(bearing, "linear", out={str(tmp_path / "c")!r})
""",
    )
    assert said.split() == ["drift", "True"]
    assert "drift" in next((tmp_path / "c").glob("zittau_axial.h")).read_text()


def test_the_block_is_flown_and_assessed(copy):
    said = python(
        copy,
        """
import ambkit
from ambkit.judge.loop.loop_builder import LoopBuilder
bearing = ambkit.preset("zittau_axial")
for block in ([], [{"type": "first-order", "frequency": "500 Hz"}]):
    law = ambkit.Control(feedback="measurement", block=block)
    flown = ambkit.simulate(bearing, ambkit.Scenario(duration=0.02, controller=law)).record
    print(round(LoopBuilder(bearing, law).peak(), 1), bool(abs(flown["x"]).max() < 1e-4))
""",
    )
    (plain, held), (late, still) = map(str.split, said.splitlines())
    assert (held, still) == ("True", "True")
    assert float(late) > float(plain)


@needs_cc
def test_the_sensor_is_a_measurement_and_becomes_c(copy, tmp_path):
    header = tmp_path / "two_sensors.h"
    said = python(
        copy,
        f"""
import pathlib
from ambkit.models import compose, emit
from ambkit.models.parts import Amplifier, Disturbance, MagnetForce, Rotor, Sensor
from ambkit.models.parts.pick_up import PickUp
parts = [Rotor(1.0, 1.0, 1.0), MagnetForce(1.0), Disturbance(1.0, 1.0), Sensor(1.0, 1e-4, 1.0),
         Amplifier(1.0, None), PickUp(2.0, 0.05)]
model = compose(parts, 1e-4, name="two_sensors")
print(*(each.name for each in model.measurements))
text = emit.header(emit.Names(model, {{}}), "Two sensors", stem="two_sensors", by="hand")
pathlib.Path({str(header)!r}).write_text(text)
""",
    )
    assert said.split() == ["y", "y_v"]
    assert "#define AMB_SENSORS 2" in header.read_text()
    (tmp_path / "main.c").write_text(f'#include "ambkit/role.h"\n#include "{header.name}"\n')
    flags = ["-std=c99", "-DAMB_DOUBLE", "-DAMB_MODEL_LOOPS", "-fsyntax-only"]
    includes = [f"-I{copy / 'core' / part}" for part in ("include", "generated")]
    run(copy, "cc", *flags, *includes, "main.c", cwd=tmp_path)


def test_the_estimator_is_a_kind_everywhere(copy, tmp_path):
    told = commands(
        copy,
        "simulate zittau_axial --duration 0.1s --out run.csv",
        "filter run.csv --machine zittau_axial --filter halved --filter steady-state --json",
        "export c zittau_axial --filter halved --out c",
        cwd=tmp_path,
    )
    assert '"halved"' in told
    assert '"steady-state"' in told
    assert (tmp_path / "c" / "CMakeLists.txt").is_file()


def test_the_preset_is_there_and_flies(copy):
    text = python(
        copy,
        """
import ambkit
machine = ambkit.preset("heavy_axis")
record = ambkit.simulate(machine, duration=0.02).record
print(machine.single, bool(abs(record["x"]).max() < 1e-4), *ambkit.machine.presets.names())
""",
    )
    assert text.split()[:2] == ["True", "True"]
    assert "heavy_axis" in text.split()


def test_the_format_is_read_and_its_faults_have_a_line(copy, tmp_path):
    rows = [f'{{"t": {k * 1e-4:.4f}, "y": {1e-6 * k}, "u": 0.1}}' for k in range(50)]
    (tmp_path / "run.jsonl").write_text("\n".join(rows))
    (tmp_path / "bad.jsonl").write_text("\n".join([*rows[:3], "[1, 2]"]))
    said = python(
        copy,
        f"""
from ambkit.data.files.tables import read_log
from ambkit.base.errors import RecordError
print(read_log({str(tmp_path / "run.jsonl")!r}).contents)
try:
    read_log({str(tmp_path / "bad.jsonl")!r})
except RecordError as error:
    print(error)
""",
    )
    assert said.splitlines()[0] == "t, y, u"
    assert "bad.jsonl:4: is no JSON object of numbers" in said


def test_the_command_is_there_with_its_help(copy):
    told = commands(copy, "--help", "hover zittau_axial")
    assert "  hover " in told
    assert "control current" in told
