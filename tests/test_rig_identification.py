"""A real rig: identified from a part of one closed loop, judged on another that it never saw."""

from pathlib import Path

import pytest

import ambkit
from ambkit.data import recordings
from ambkit.identification.maximum_likelihood import maximum_likelihood
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.validation import validate

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "closed_loop"
FREE = ("measurement_noise", "control_noise", "disturbance_noise", "current_offset")


def log(name, begin, end):
    channels = recordings.folder() / "closed_loop.toml"
    return ambkit.load(RIG / f"{name}.mat", channels).between(begin, end)


@pytest.mark.skipif(not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)")
def test_a_model_from_four_seconds_predicts_another_log():
    begun = log("sinusoidal_slow_linear-LQR_tracking-KF", 2.0, 6.0)
    found = maximum_likelihood(begun, LoopModel(ambkit.preset("inteco_ml")), FREE)
    assert found.converged
    # 15.6 um; the lift-offs and the log as a whole say 16.8 (docs/explanation/rig.md).
    assert 13e-6 < found["measurement_noise"] ** 0.5 < 20e-6
    steps = log("step-LQI-KF", 2.0, 8.0)  # another controller, and it goes farther
    check = validate(found.model, steps, start=found.start, horizons=(1, 10), settling=0.2)
    assert check.samples > 5000
    for ahead in (1, 10):
        assert check.fit()[ahead] > check.fit("held")[ahead] + 0.3
    assert check.fit()[10] > 97
    assert check.fit("of_start")[10] < check.fit("held")[10]  # the start alone does not get there
    assert check.gain > 0.1
    # What docs/explanation/rig.md says of the model's limits is said here, too.
    assert not check.good
    assert "not white" in check.verdict
