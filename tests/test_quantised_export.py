"""Filters of sensors with steps, exported: warning-free C that passes its own self-test."""

import shutil
import subprocess

import pytest
from export_cases import BEARING, PRECISIONS, program

from ambkit import Scenario
from ambkit.export.c import export_c

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
STD = BEARING.sensor.noise_variance**0.5
FORMS = {"plain": {}, "editable": {"editable": True},
         "control": {"scenario": Scenario(duration=0.1)}}  # fmt: skip


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    ("form", "ratio", "kind"),
    [
        ("plain", 5, "extended"), ("editable", 1, "extended"), ("control", 20, "extended"),
        *(pytest.param("control", ratio, kind, marks=pytest.mark.study)
          for kind in ("linear", "ud", "observer", "augmented") for ratio in (5, 20, 50, 100)),
    ],
)  # fmt: skip
def test_it_compiles_without_a_warning_and_passes(form, ratio, kind, precision, tmp_path):
    bearing = BEARING.replace(sensor__quantisation=ratio * STD)
    made = export_c(bearing, None, tmp_path / "c", prefix="rig", kind=kind, precision=precision,
                    force=True, **FORMS[form])  # fmt: skip
    done = program("gcc", made.folder, tmp_path / "selftest")
    assert (done.returncode, done.stderr) == (0, "")
    said = subprocess.run([tmp_path / "selftest"], capture_output=True, text=True)
    assert said.returncode == 0, said.stdout
    assert "equal to the last bit" in said.stdout
