"""Filters of bearings with other parts, exported: warning-free C that passes its own self-test."""

import fe_map
import iron
import pytest
from export_cases import BEARING, PRECISIONS, compiled, printed_by
from exporting import export_c

from ambkit import Bearing, Scenario

pytestmark = compiled
STD = BEARING.sensor.noise_variance**0.5
FORMS = {
    "plain": {}, "editable": {"editable": True}, "control": {"scenario": Scenario(duration=0.1)},
}  # fmt: skip


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    ("form", "ratio", "kind"),
    [
        ("plain", 5, "extended"), ("editable", 1, "extended"), ("control", 20, "extended"),
        *(pytest.param("control", ratio, kind, marks=pytest.mark.study)
          for kind in ("linear", "ud", "observer", "augmented") for ratio in (5, 20, 50, 100)),
    ],
)  # fmt: skip
def test_a_sensor_with_steps(form, ratio, kind, precision, tmp_path):
    bearing = BEARING.replace(sensor__quantisation=ratio * STD)
    export_c(bearing, None, tmp_path / "c", prefix="rig", kind=kind, precision=precision,
             force=True, **FORMS[form])  # fmt: skip
    assert "equal to the last bit" in printed_by(tmp_path / "c")


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("part", ["iron", "force map", "eddy current"])
def test_a_magnet_that_is_not_the_papers(part, precision, tmp_path):
    bearing = {
        "iron": lambda: iron.TWO_SIDED,
        "force map": lambda: Bearing.load(fe_map.written(tmp_path)),
        "eddy current": lambda: BEARING.replace(magnet__eddy_current_lag=0.3e-3),
    }[part]()
    made = export_c(bearing, None, tmp_path / "c", kind="extended", precision=precision, force=True)
    assert ("core/src/saturating.c" in made.sources) == (part == "iron")
    assert "equal to the last bit" in printed_by(made.folder)
