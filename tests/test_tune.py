"""Tuning: what it finds, what that gains on data it did not see, and what it says of itself."""

import numpy as np
import pytest

import ambkit
from ambkit import Estimator, FilterNoise, Machine
from ambkit.base.errors import AmbkitError
from ambkit.judge.comparison.cases import CASES, trials
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.workflow.tuning_tasks import NOISE

BEARING = Machine.preset("zittau_axial")


@pytest.fixture(scope="module")
def walks():
    """Runs whose load is the walk that the filters assume, and whose noise is the bearing's."""
    return [each.record for each in trials(CASES["model"], BEARING, 3, 5)]


def test_likelihood_finds_the_noise_that_there_was(walks):
    found = ambkit.tune(BEARING, walks[:2], "extended", validate=walks[2:], budget=50)
    usual = ambkit.ExtendedKalmanFilter(BEARING).variances
    assert [each.name for each in found.free] == list(NOISE)
    assert found.values["noise.measurement"] == pytest.approx(usual.measurement, rel=0.1)
    assert 0.3 < found.values["noise.disturbance"] / usual.disturbance < 5
    assert len(found.trace) == 50
    assert found.trace[0].values["noise.measurement"] == pytest.approx(usual.measurement)


def test_what_is_wrong_is_mended_on_records_that_it_did_not_see():
    """In the mean over eight records: on a single one the error of x may be luck."""
    walks = [each.record for each in trials(CASES["model"], BEARING, 10, 5)]
    wrong = BEARING.replace(sensor__noise_variance=9 * BEARING.sensor.noise_variance)
    found = ambkit.tune(wrong, walks[:2], "linear", validate=walks[2:], budget=40)
    assert found.kept
    assert found.by == "likelihood"
    for figure in ("negative log-likelihood per sample", "error of x"):
        before, after = found.unseen[figure]
        assert after < before, figure
    before, after = found.unseen["nis"]
    assert before < 0.3
    assert after == pytest.approx(1, abs=0.1)


def test_simulated_truth_is_tuned_by_without_records():
    found = ambkit.tune(BEARING, filter="extended", budget=24, seeds=3)
    assert found.by == "truth"
    before, after = found.unseen["error over the untuned linear filter's"]
    assert found.kept == (after < before)
    assert after < before  # a load that stays is followed with less noise
    again = ambkit.tune(BEARING, filter="extended", budget=24, seeds=3)
    assert [each.cost for each in again.trace] == [each.cost for each in found.trace]


def test_a_load_that_rests_does_not_make_a_filter_that_follows_none():
    still = ambkit.simulate(BEARING, ambkit.scenario_for(BEARING, step=0.1e-3, duration=1.0)).record
    found = ambkit.tune(BEARING, still, "linear", free=["noise.disturbance"], budget=30)
    least = min(found.trace, key=lambda each: each.cost).values["noise.disturbance"]
    assert found.values["noise.disturbance"] >= least
    if found.kept:
        assert any("does not consider the loop" in text for text in found.warnings)


def test_the_file_is_the_filter(walks, tmp_path):
    walks[0].save(tmp_path / "walk.csv")
    found = ambkit.tune(BEARING, tmp_path / "walk.csv", "linear", budget=12)
    found.save(tmp_path / "f.toml")
    read = Estimator.load(tmp_path / "f.toml")
    np.testing.assert_array_equal(read.run(walks[1]).mean, found.estimator.run(walks[1]).mean)
    if found.kept:
        assert set(read.origin) == set(NOISE)
        assert "likelihood of walk.csv; ambkit tune" in read.origin[NOISE[0]]


def test_what_cannot_be_tuned_is_reported(walks):
    with pytest.raises(AmbkitError, match="the low-pass filter has no innovation variance"):
        ambkit.tune(BEARING, walks, "low-pass")
    with pytest.raises(AmbkitError, match='there is no filter "kalman"'):
        ambkit.tune(BEARING, walks, "kalman")
    with pytest.raises(AmbkitError, match='the linear filter has no tunable "q"; it has: noise'):
        ambkit.tune(BEARING, walks, "linear", free=["q"])
    with pytest.raises(AmbkitError, match=r"a record to tune on must be .* long at least"):
        ambkit.tune(BEARING, walks[0].between(None, 0.01), "linear")


def test_a_value_at_its_bound_is_reported(walks):
    wrong = BEARING.replace(sensor__noise_variance=1e4 * BEARING.sensor.noise_variance)
    found = ambkit.tune(wrong, walks[:1], "linear", free=["noise.measurement"], budget=16)
    assert any("noise.measurement ran into the end of its range" in w for w in found.warnings)


def test_the_picture_and_the_figures(walks, tmp_path):

    found = ambkit.tune(BEARING, walks[:1], "linear", budget=12)
    found.figure().save(tmp_path / "t.png")
    assert (tmp_path / "t.png").is_file()
    data = found.to_dict()
    assert data["bounds"]["noise.measurement"]["unit"] == "m^2"
    assert len(data["trace"]) == 12


def test_a_filter_of_a_file_stands_beside_the_kinds(walks, tmp_path):
    noise = FilterNoise(disturbance=3.0)
    ambkit.ExtendedKalmanFilter(BEARING, noise=noise).save(tmp_path / "f.toml")
    name = str(tmp_path / "f.toml")
    found = ambkit.filter(walks[0], ["linear", name], machine=BEARING)
    assert found[name].noise.disturbance == 3.0
    own = Estimator.load(name).run(walks[0])
    np.testing.assert_array_equal(found[name].evaluation.estimate.mean, own.mean)
    slow = BEARING.replace(sampling_time="0.2 ms")
    with pytest.raises(AmbkitError, match=r"steps every 0\.1 ms, and .* every 0\.2 ms"):
        ambkit.filter(walks[0], [name], machine=slow)


# ---- the peak of the sensitivity


LATE = BEARING.replace(
    name="late", rotor__gravity="none", sensor__noise_variance="0.25 um^2", sensor__lag="16 us",
    delay="0.15 ms", amplifier__bandwidth="2 kHz",
)  # fmt: skip


NOISY = BEARING.replace(delay="0.15 ms", amplifier__bandwidth="2 kHz")
STIFF = ambkit.PID.textbook(NOISY)


@pytest.fixture(scope="module")
def calm():
    """A run whose load rests, so that likelihood asks for a filter that trusts its model."""
    steps = ambkit.scenario_for(LATE, step="5 um", duration="1 s", from_estimate=False)
    return ambkit.simulate(LATE, steps).record


def test_likelihood_takes_the_loop_s_margin_and_a_ceiling_keeps_it(calm):
    free = ambkit.tune(LATE, calm, "linear", budget=24)
    assert free.kept
    untuned = free.peaks[0]
    assert free.peak > 1.25 * untuned
    assert any("does not consider the loop" in text for text in free.warnings)
    ceiling = 1.05 * untuned
    held = ambkit.tune(LATE, calm, "linear", budget=24, max_sensitivity=ceiling)
    assert held.peak < ceiling
    loop = ambkit.assess(LATE, {"it": held.estimator}).loops["it"]
    assert held.peak == pytest.approx(loop.peak, rel=1e-4)
    assert not any("does not consider the loop" in text for text in held.warnings)
    assert len(held.peaks) == len(held.trace) == 24
    below = [each.cost for each, peak in zip(held.trace, held.peaks, strict=True) if peak < ceiling]
    judge = "negative log-likelihood per sample"
    assert held.unseen[judge][1] <= held.unseen[judge][0]
    assert min(below) <= held.trace[0].cost
    assert len(held.figure().panels) == 3
    assert held.to_dict()["max_sensitivity"] == ceiling


def test_a_ceiling_is_kept_even_where_the_untuned_filter_is_the_better_one():
    untuned = ambkit.assess(NOISY, "linear", STIFF).loops["linear"].peak
    held = ambkit.tune(NOISY, filter="linear", budget=24, seeds=2, controller=STIFF,
                       max_sensitivity=0.95 * untuned)  # fmt: skip
    assert held.kept
    assert held.peak < 0.95 * untuned
    judge = "error over the untuned linear filter's"
    assert held.unseen[judge][1] > held.unseen[judge][0]


def test_the_controller_of_the_loop_is_the_one_that_is_given():
    soft = ambkit.PID(kp=2000.0, ki=5000.0, kd=8.0)
    found = ambkit.tune(LATE, filter="linear", budget=1, seeds=1, controller=soft)
    expected = ambkit.assess(LATE, "linear", soft).loops["linear"].peak
    assert found.peaks[0] == pytest.approx(expected, rel=1e-4)


def test_a_ceiling_that_cannot_be_kept_is_refused():
    with pytest.raises(
        AmbkitError, match=r"none keeps the peak of \|S\| below 1.1, the least is"
    ) as left:
        ambkit.tune(LATE, filter="linear", budget=4, seeds=1, max_sensitivity=1.1)
    nearest = left.value.nearest  # a design takes it, without a second search
    assert len(nearest.trace) == 4
    assert min(nearest.peaks) <= nearest.peak < 1.05 * min(nearest.peaks)
    with pytest.raises(AmbkitError, match=r"max_sensitivity must be above 1\.0"):
        ambkit.tune(LATE, filter="linear", budget=4, seeds=1, max_sensitivity=1.0)
    with pytest.raises(AmbkitError, match="no steady-state gain"):
        ambkit.tune(LATE, filter="multiple-model", budget=1, seeds=1, max_sensitivity=2.0)
    assert np.isnan(ambkit.tune(LATE, filter="multiple-model", budget=1, seeds=1).peak)


def test_trade_off_is_a_curve_from_which_to_pick():
    untuned = ambkit.assess(NOISY, "linear", STIFF).loops["linear"].peak
    ceilings = [1.1, 0.9 * untuned, 1.2 * untuned]
    found = ambkit.tune_trade_off(
        NOISY, peaks=ceilings, filter="linear", budget=16, seeds=2, controller=STIFF
    )
    never, tight, wide = found.points
    assert never.tuned is None
    assert never.zone == "–"
    assert tight.peak < 0.9 * untuned < wide.peak < 1.2 * untuned
    assert wide.errors["f_d"] < tight.errors["f_d"]
    assert len(found.figure().panels) == 2
    points = found.to_dict()["points"].values()
    assert [each["reached"] for each in points] == [False, True, True]
    assert f"below {ceilings[1]:g}" in repr(found)
    with pytest.raises(AmbkitError, match="none keeps the peak"):
        ambkit.tune_trade_off(NOISY, peaks=[1.1], filter="linear", budget=2, seeds=1)
    with pytest.raises(AmbkitError, match="one value or more"):
        ambkit.tune_trade_off(NOISY, peaks=[], filter="linear")


def test_no_peak_is_computed_that_nobody_asked_for(monkeypatch):
    computed = []
    old = LoopBuilder.peak

    def spy(self, *given):
        computed.append(1)
        return old(self, *given)

    monkeypatch.setattr(LoopBuilder, "peak", spy)
    found = ambkit.tune(BEARING, filter="linear", seeds=1, budget=6)
    assert len(computed) <= 2  # of the untuned and of the tuned filter, for the warning
    told = found.to_dict()
    assert found.peaks[0] == told["loop"]["untuned"]["peak"] > 1
    assert len(found.peaks) == len(found.trace) == 6
