"""Tuning: what it finds, what that gains on data it did not see, and what it says of itself."""

from __future__ import annotations

import numpy as np
import pytest

import ambkit
from ambkit import Bearing, Estimator, FilterNoise, Record
from ambkit.base.errors import AmbkitError
from ambkit.judge.comparison.cases import CASES, trials
from ambkit.workflow.tuning_tasks import NOISE

BEARING = Bearing.preset("zittau_axial")


@pytest.fixture(scope="module")
def walks() -> list[Record]:
    """Runs whose load is the walk that the filters assume, and whose noise is the bearing's."""
    return [each.record for each in trials(CASES["model"], BEARING, 3, 5)]


def test_likelihood_finds_the_noise_that_there_was(walks: list[Record]) -> None:
    found = ambkit.tune(BEARING, walks[:2], "extended", validate=walks[2:], budget=50)
    usual = ambkit.ExtendedKalmanFilter(BEARING).variances
    assert [each.name for each in found.free] == list(NOISE)
    assert found.values["noise.measurement"] == pytest.approx(usual.measurement, rel=0.1)
    assert 0.3 < found.values["noise.disturbance"] / usual.disturbance < 5
    assert len(found.trace) == 50
    assert found.trace[0].values["noise.measurement"] == pytest.approx(usual.measurement)


def test_what_is_wrong_is_mended_on_records_that_it_did_not_see(walks: list[Record]) -> None:
    wrong = BEARING.replace(sensor__noise_variance=9 * BEARING.sensor.noise_variance)
    found = ambkit.tune(wrong, walks[:2], "linear", validate=walks[2:], budget=40)
    assert found.kept
    assert found.by == "likelihood"
    for figure in ("minus log likelihood a sample", "error of x"):
        before, after = found.unseen[figure]
        assert after < before, figure
    before, after = found.unseen["nis"]
    assert before < 0.3
    assert after == pytest.approx(1, abs=0.1)


def test_simulated_truth_is_tuned_by_without_records() -> None:
    found = ambkit.tune(BEARING, kind="extended", budget=24, runs=3)
    assert found.by == "truth"
    before, after = found.unseen["error over the untuned linear filter's"]
    assert found.kept == (after < before)
    assert after < before  # a load that stays is followed with less noise
    again = ambkit.tune(BEARING, kind="extended", budget=24, runs=3)
    assert [each.cost for each in again.trace] == [each.cost for each in found.trace]


def test_a_load_that_rests_does_not_make_a_filter_that_follows_none() -> None:
    still = ambkit.simulate(BEARING, ambkit.scenario_for(BEARING, step=0.1e-3, duration=1.0))
    found = ambkit.tune(BEARING, still, "linear", free=["noise.disturbance"], budget=30)
    least = min(found.trace, key=lambda each: each.cost).values["noise.disturbance"]
    assert found.values["noise.disturbance"] >= least
    if found.kept:
        assert any("the likelihood knows nothing of the loop" in text for text in found.warnings)


def test_the_file_is_the_filter(walks: list[Record], tmp_path) -> None:
    found = ambkit.tune(BEARING, walks[:1], "linear", budget=12, source="walk.csv")
    found.save(tmp_path / "f.toml")
    read = Estimator.load(tmp_path / "f.toml")
    np.testing.assert_array_equal(read.run(walks[1]).mean, found.estimator.run(walks[1]).mean)
    if found.kept:
        assert set(read.origin) == set(NOISE)
        assert "likelihood of walk.csv; ambkit tune" in read.origin[NOISE[0]]


def test_what_cannot_be_tuned_is_said(walks: list[Record]) -> None:
    with pytest.raises(AmbkitError, match="the low-pass filter has no idea of its innovations"):
        ambkit.tune(BEARING, walks, "low-pass")
    with pytest.raises(AmbkitError, match='there is no estimator "kalman"'):
        ambkit.tune(BEARING, walks, "kalman")
    with pytest.raises(AmbkitError, match='the linear filter has no tunable "q"; it has: noise'):
        ambkit.tune(BEARING, walks, "linear", free=["q"])
    with pytest.raises(AmbkitError, match=r"a record to tune on must be .* long at least"):
        ambkit.tune(BEARING, walks[0].between(None, 0.01), "linear")


def test_a_value_at_its_bound_is_told(walks: list[Record]) -> None:
    wrong = BEARING.replace(sensor__noise_variance=1e4 * BEARING.sensor.noise_variance)
    found = ambkit.tune(wrong, walks[:1], "linear", free=["noise.measurement"], budget=16)
    assert any("noise.measurement ran into the end of its range" in w for w in found.warnings)


def test_the_picture_and_the_figures(walks: list[Record], tmp_path) -> None:
    from ambkit.show import plots

    found = ambkit.tune(BEARING, walks[:1], "linear", budget=12)
    plots.save_figure(found.figure(), tmp_path / "t.png")
    assert (tmp_path / "t.png").stat().st_size > 10_000
    data = found.to_dict()
    assert data["bounds"]["noise.measurement"]["unit"] == "m^2"
    assert len(data["trace"]) == 12


def test_a_filter_of_a_file_stands_beside_the_kinds(walks: list[Record], tmp_path) -> None:
    noise = FilterNoise(disturbance=3.0)
    ambkit.ExtendedKalmanFilter(BEARING, noise=noise).save(tmp_path / "f.toml")
    name = str(tmp_path / "f.toml")
    found = ambkit.filter(BEARING, walks[0], ["linear", name])
    assert found[name].noise.disturbance == 3.0
    own = Estimator.load(name).run(walks[0])
    np.testing.assert_array_equal(found[name].evaluation.estimate.mean, own.mean)
    slow = BEARING.replace(sampling_time="0.2 ms")
    with pytest.raises(AmbkitError, match=r"steps every 0\.1 ms, and bearing .* every 0\.2 ms"):
        ambkit.filter(slow, walks[0], [name])
