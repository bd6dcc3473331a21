"""Axes of machines swept in the simulation, and measured from logs."""

import numpy as np
import pytest
from machine_cases import injected
from quick import quick

import ambkit
from ambkit import Machine, Record
from ambkit.assessment.assess import MEASUREMENT
from ambkit.base.errors import AmbkitError, RecordError

UFU = Machine.preset("ufu_rig")


# ---- swept, and measured


@pytest.mark.parametrize(("preset", "axis", "name"), quick(
    [("ufu_rig", "A1", None), ("tum_mlps", "B2", None), ("ufu_rig", "A1", "linear"),
     ("tum_mlps", "B2", "linear")],
    [("tum_mlps", "B2", "linear")],
))  # fmt: skip
def test_sweep_of_an_axis_is_the_models_within_two_percent(preset, axis, name):
    found = ambkit.assess_sweep(Machine.preset(preset), name, amplitudes=["1 um"], axis=axis)
    (swept,) = found.swept
    assert found.name == f"{preset} {axis}"
    assert found.model.name == axis
    assert not swept.limited
    assert len(swept.frequency) > 30
    assert swept.deviation < 0.02
    assert len(found.figure().panels) == 2


def test_a_sweep_of_a_loaded_machine_is_that_of_its_operating_point():
    load = {"A1": -25.0}
    (swept,) = ambkit.assess_sweep(
        UFU, "none", amplitudes=["0.5 um"], axis="A1", disturbance=load
    ).swept
    assert swept.deviation < 0.02
    free = ambkit.assess(UFU, "none").loops[MEASUREMENT].loop.of_axis(0, swept.frequency)
    assert np.max(np.abs(swept.sensitivity - free) / np.abs(free)) > 0.02


def test_a_machine_is_swept_at_an_axis_that_it_has():
    with pytest.raises(AmbkitError, match="has no axis C; there are A1, A2, B1, B2"):
        ambkit.assess_sweep(UFU, "none", axis="C")


@pytest.mark.study
def test_intervals_of_a_machines_log_hold_what_they_say():
    still, truth = injected(0, noise=False)
    size = np.abs(ambkit.assess_log(truth, still, "none").measured.sensitivity)
    held = []
    for seed in range(40):
        found = ambkit.assess_log(injected(seed)[1], still, "none")
        assert found.axis == 2
        low, high = found.measured.interval()
        held.append((low <= size) & (size <= high))
    assert 0.92 <= np.mean(held) <= 0.98


def test_a_machines_log_lies_on_its_model():
    still, record = injected(0, noise=False)
    found = ambkit.assess_log(record, still, "none")
    assert found.deviation[MEASUREMENT] < 0.02
    assert found.name == "ufu_rig B1"
    assert "injected_B1" in record
    assert len(found.figure().panels) == 4


def test_a_log_says_at_which_axis_something_was_injected():
    still, record = injected(0)
    signals = {name: record[name] for name in record.signals if not name.startswith("injected")}
    with pytest.raises(RecordError, match="has none of them"):
        ambkit.assess_log(Record(record.t, signals, dict.fromkeys(signals, "m")), still, "none")
    both = signals | {f"injected_{axis}": record["injected_B1"] for axis in ("A1", "B1")}
    with pytest.raises(RecordError, match="has injected_A1, injected_B1"):
        ambkit.assess_log(Record(record.t, both, dict.fromkeys(both, "m")), still, "none")
    few = {"injected_B1": record["injected_B1"], "y_A1": record["y_A1"]}
    with pytest.raises(RecordError, match="the record has no y_A2, y_B1, y_B2"):
        ambkit.assess_log(Record(record.t, few, dict.fromkeys(few, "m")), still, "none")
