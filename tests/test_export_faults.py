"""Fault isolation in an export: the bits of Python's, and the fault that a controller names."""

import shutil
import subprocess

import numpy as np
import pytest
from export_cases import BEARING, INCLUDES, SAME_BITS, STRICT
from exporting import export_c
from machine_cases import machine

import ambkit
from ambkit import Scenario
from ambkit.base.errors import AmbkitError
from ambkit.estimate.registry import KINDS
from ambkit.judge.isolation.isolation import FaultIsolation
from ambkit.workflow.diagnose import distinguished

compiled = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")

USER = """#include "rig_faults.h"
#include <stdio.h>
static rig_faults faults;
int main(void)
{
  static rig_state state;
  static amb_isolation_result found[RIG_FAULTS];
  rig_estimates now;
  double y, u;
  rig_init(&state);
  rig_faults_init(&faults);
  for (int k = 0; scanf("%lf %lf", &y, &u) == 2; k++) {
    const amb_status status = rig_step(&state, (amb_real)y, (amb_real)u, &now);
    rig_faults_put(&faults, &state, &now, status);
    if (((k + 1) % 200 == 0) && (rig_faults_search(&faults, found) > 0))
      for (int j = 0; j < RIG_FAULTS; j++)
        if (rig_faults_certain(found, j))
          (void)printf("%d %s %.17g\\n", k, rig_fault_names[j], (double)found[j].size[0]);
  }
  return 0;
}
"""


def built(made, folder, *files):
    """Compile an export with further files; returns the program."""
    includes = [f"-I{made.folder / flag[2:]}" for flag in INCLUDES]
    sources = [str(made.folder / file) for file in made.sources]
    out = folder / "user.out"
    words = ["gcc", "-std=c99", *STRICT, *SAME_BITS, *includes, *sources, *map(str, files)]
    subprocess.run([*words, "-o", str(out)], check=True, timeout=120)
    return out


@compiled
@pytest.mark.parametrize("precision", ["float", "double"])
def test_the_controller_names_the_fault_that_python_names(precision, tmp_path):
    made = export_c(BEARING, None, tmp_path / "out", prefix="rig", kind="extended",
                    precision=precision, faults=True)  # fmt: skip
    T, n = BEARING.sampling_time, 3000
    run = ambkit.simulate(BEARING, Scenario(duration=(n - 1) * T)).record
    y = run["y"] + np.where(np.arange(n) < 2000, 0.0, 1e-4)
    record = ambkit.Record(run.t, {"y": y, "u": run["u"]}, {"y": "m", "u": "V"})
    of = {"float": "float32", "double": "float64"}[precision]
    searches = FaultIsolation(KINDS["extended"].make(BEARING, precision=of)).run(record)
    (tmp_path / "user.c").write_text(USER)
    before = np.append(0.0, run["u"][:-1])
    text = "".join(f"{a!r} {b!r}\n" for a, b in zip(y.tolist(), before.tolist(), strict=True))
    program = built(made, tmp_path, tmp_path / "user.c")
    said = subprocess.run([program], input=text, capture_output=True, text=True, timeout=60).stdout
    expected = [
        f"{200 * k + 199} {searches.signatures[j].name} {searches.size[k, j, 0]:.17g}"
        for k in np.flatnonzero(searches.alarms) for j in np.flatnonzero(searches.named[k])
    ]  # fmt: skip
    assert said.splitlines() == expected
    assert any("sensor offset" in line for line in expected)


@compiled
@pytest.mark.parametrize("of", ["axis", "controller of an axis", "machine"])
def test_its_self_test_compares_searches_to_the_last_bit_and_can_fail(of, tmp_path):
    rig = machine() if of == "machine" else BEARING
    scenario = Scenario() if of.startswith("controller") else None
    made = export_c(rig, None, tmp_path / "out", prefix="rig", kind="extended", faults=True,
                    scenario=scenario)  # fmt: skip
    passed = subprocess.run([built(made, tmp_path, *map(made.folder.joinpath, made_tests(made)))],
                            capture_output=True, text=True, timeout=60)  # fmt: skip
    assert passed.returncode == 0
    assert "pass: faults of rig" in passed.stdout
    # The constants change their checksum, the search only its results.
    for file, there, broken in (
        ("rig_faults.c", ".margin = 16", ".margin = 60"),
        ("core/src/isolation_sweep.c", "w->g[j] += s * own", "w->g[j] += s * along"),
    ):
        source = made.folder / file
        text = source.read_text()
        source.write_text(text.replace(there, broken))
        assert source.read_text() != text
        program = built(made, tmp_path, *map(made.folder.joinpath, made_tests(made)))
        failed = subprocess.run([program], capture_output=True, text=True, timeout=60)
        assert "FAIL: faults of rig" in failed.stdout
        assert failed.returncode == 1
        source.write_text(text)


def made_tests(made):
    return [file for file in made.files if file.startswith("selftest/") and file.endswith(".c")]


def test_the_readme_has_the_table_of_what_cannot_be_told_apart(tmp_path):
    made = export_c(BEARING, None, tmp_path / "out", prefix="rig", kind="extended", faults=True)
    readme = (made.folder / "README.md").read_text()
    filter = KINDS["extended"].make(BEARING, precision="float32")
    table = distinguished(BEARING, filter).table
    for row in table["rows"]:
        assert readme.count(f"| {row[0]} | {row[1]} |") == 1


def test_parameters_that_can_change_are_refused(tmp_path):
    with pytest.raises(AmbkitError, match="no editable"):
        export_c(BEARING, None, tmp_path / "out", kind="extended", faults=True, editable=True)
