"""The experiment for the sensitivity of a machine's axis: within its limits, and what it tells."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine
from ambkit.assessment.injection_experiment import design_injection
from ambkit.base.errors import AmbkitError
from ambkit.simulation.scenario import Scenario

TUM = Machine.preset("tum_mlps").replace(unbalance=[], speed="0 rpm")


@pytest.fixture(scope="module")
def designed():
    return design_injection(
        TUM, Scenario(duration=1.0, feedback="measurement"), axis="B1", band=(20.0, 1500.0)
    )


def test_it_keeps_within_the_limits_of_all_axes(designed):
    gap, travel = TUM.bearing[1].magnet.air_gap, TUM.bearing[1].clearance
    assert designed.name == "tum_mlps B1"
    assert designed.limits.displacement == pytest.approx(min(0.05 * gap, 0.5 * travel))
    assert np.abs(designed.record["x"]).max() <= designed.limits.displacement
    assert np.abs(designed.record["x"]).max() > 0.9 * designed.limits.displacement
    assert np.abs(designed.record["iu"]).max() <= designed.limits.current


def test_what_it_tells_is_the_models(designed):
    found = designed.expected
    S = np.abs(ambkit.assess(TUM, "none").loops["measurement"].loop.of_axis(2, found.frequency))
    distance = np.abs(np.abs(found.sensitivity) - S) / S
    assert np.median(distance) < 0.02  # noise, and what the amplitude adds
    assert distance.max() < 0.08
    assert designed.file()["injected_B1"].max() == pytest.approx(designed.added.max())


def test_commands_design_play_and_assess_it(designed, call):
    designed.file().save("injection.csv")
    TUM.save("still.toml")
    assert call("simulate", "still.toml", "--signal", "injection.csv", "--out", "l.csv").code == 0
    told = call("assess", "log", "l.csv", "--machine", "still.toml", "--filter", "none")
    assert told.code == 0
    assert "tum_mlps B1" in told.out
    told = call("simulate", "ufu_rig", "--signal", "l.csv")
    assert told.code == 0  # its axes have these names as well
    designed.record.save("other.csv")
    told = call("simulate", "still.toml", "--signal", "other.csv")
    assert told.code == 2
    assert "it has none of the signals injected_A1" in " ".join(told.err.split())
    for arguments, said in (
        (["tum_mlps"], "has the axes A1, A2, B1, B2: name one of them"),
        (["sensitivity", "tum_mlps", "--wander", "1 N"], "there is no option --wander"),
        (["zittau_axial", "--axis", "A1"], "zittau_axial has one axis: there is no axis A1"),
    ):
        told = call("excite", *arguments)
        assert told.code == 2
        assert said in " ".join(told.err.split())


def test_what_cannot_be_is_refused():
    with pytest.raises(AmbkitError, match="the axes A1, A2, B1, B2: there is no axis Q"):
        design_injection(TUM, Scenario(duration=1.0), axis="Q")
    with pytest.raises(AmbkitError, match="the limit of the current"):
        design_injection(TUM, Scenario(duration=1.0), current="99 A")
