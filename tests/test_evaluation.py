"""Judging a filter by a record."""

import numpy as np
import pytest

import ambkit
from ambkit.judge.comparison import rmse
from ambkit.judge.evaluation import evaluate, logged_predictions
from ambkit.machine.magnets import own_time
from ambkit.simulation.waveforms import Sequence
from benchmarks.sensors import drawn


@pytest.fixture(scope="module")
def record(bearing):
    scenario = ambkit.Scenario(
        duration=1.0, disturbance=ambkit.Step(amplitude=-3.0, time=0.1), seed=3
    )
    return ambkit.simulate(bearing, scenario).record


def changed(record, **signals):
    return ambkit.Record(record.t, {**record.signals, **signals}, record.units, record.meta)


def test_right_model_and_noise_give_white_innovations_and_predict_better_than_holding(bearing):
    # The filter takes the disturbance for a random walk: then let it be one.
    T, noise = bearing.sampling_time, ambkit.FilterNoise(disturbance=1.0)
    t = T * np.arange(10_001)
    walk = np.cumsum(np.random.default_rng(1).normal(0, np.sqrt(noise.disturbance * T), t.size))
    scenario = ambkit.Scenario(
        duration=1.0, disturbance=ambkit.Recorded(times=t, values=walk - walk[0]), seed=3
    )
    record = ambkit.simulate(bearing, scenario).record
    found = evaluate(ambkit.KalmanFilter(bearing, noise=noise), record)
    assert found.samples == found.used == len(record) - 1
    assert found.nis == pytest.approx(1.0, abs=0.05)
    assert found.whiteness.share_within >= 0.9
    assert found.innovation_std == pytest.approx(found.expected_std, rel=0.05)
    assert found.prediction[1] < 0.8 * found.held[1]
    # One step ahead is what the innovation is.
    assert found.prediction[1] == pytest.approx(found.innovation_std, rel=0.02)
    assert found.status == {}
    assert found.logged == {}


def test_a_filter_that_expects_too_much_noise_shows_in_the_nis(bearing, record):
    noise = ambkit.FilterNoise(measurement=4 * bearing.sensor.noise_variance)
    assert evaluate(ambkit.KalmanFilter(bearing, noise=noise), record).nis < 0.5


def test_truth_is_judged_as_compare_judges_it(bearing, record):
    found = evaluate(ambkit.KalmanFilter(bearing), record)
    for name in ("x", "v", "f_d"):
        assert found.rmse[name] == pytest.approx(rmse(found.estimate, record, name), rel=1e-2)
    assert evaluate(ambkit.KalmanFilter(bearing), record.select("y", "u")).rmse == {}


def test_settling_leaves_out_the_start(bearing, record):
    late = evaluate(ambkit.KalmanFilter(bearing), record, settling=0.5)
    assert late.samples == len(record) - 5000
    assert late.disturbance_mean == pytest.approx(-3.0, abs=0.2)
    assert late.disturbance_std < evaluate(ambkit.KalmanFilter(bearing), record).disturbance_std


def test_what_settles_is_in_no_figure(bearing, record):
    y = record["y"].copy()
    y[100:2000] += np.random.default_rng(2).normal(0, 1e-4, 1900)
    clean, disturbed = (
        evaluate(ambkit.KalmanFilter(bearing), one, settling=0.5)
        for one in (record, changed(record, y=y))
    )
    for name in ("prediction", "held"):
        assert getattr(disturbed, name) == pytest.approx(getattr(clean, name), rel=0.01)
    for name in ("nis", "innovation_std", "disturbance_std"):
        assert getattr(disturbed, name) == pytest.approx(getattr(clean, name), rel=0.01)


def test_missing_samples_are_counted_and_the_last_one_held(bearing, record):
    y = record["y"].copy()
    y[1000:1010] = np.nan
    found = evaluate(ambkit.KalmanFilter(bearing), changed(record, y=y))
    assert found.status["missing"] == 10
    assert found.used == found.samples - 10
    assert np.isfinite([*found.prediction.values(), *found.held.values()]).all()


def test_a_sensor_that_hangs_is_judged_by_what_came_before(bearing, record):
    y = record["y"].copy()
    y[100:] = y[100]
    found = evaluate(ambkit.KalmanFilter(bearing), changed(record, y=y))
    assert found.status["frozen"] > 9000
    assert found.whiteness is None


def test_logged_estimates_are_judged_held_and_with_their_velocity(record):
    t = record.t
    y = 1e-3 * t
    signals = {"y": y, "u": 0 * t, "x_logged": y, "v_logged": np.full_like(t, 1e-3)}
    log = ambkit.Record(t, signals, {"x_logged": "m", "v_logged": "m/s"})
    errors = logged_predictions(log, (1, 10))
    assert errors["x_logged held"][10] == pytest.approx(1e-3 * 10 * 1e-4)
    assert errors["x_logged and v_logged"][10] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizons": (0,)}, "horizon must be 1 sample or more, is 0"),
        ({"settling": -1.0}, "settling must be 0 s or more"),
    ],
)
def test_arguments_out_of_range_are_refused(bearing, record, options, message):
    with pytest.raises(ValueError, match=message):
        evaluate(ambkit.KalmanFilter(bearing), record, **options)


def test_a_record_too_short_or_without_measurements_is_refused(bearing, record):
    with pytest.raises(ambkit.RecordError, match="10001 samples, 10011 are needed"):
        evaluate(ambkit.KalmanFilter(bearing), record, settling=1.0)
    nothing = changed(record, y=np.full(len(record), np.nan))
    with pytest.raises(ambkit.RecordError, match="of 10000 samples 10000 missing"):
        evaluate(ambkit.KalmanFilter(bearing), nothing)


@pytest.mark.parametrize(("spike", "flag"), [(0.5e-3, "outlier"), (-1.0, "missing")])
def test_a_measurement_left_out_is_not_predicted(bearing, record, spike, flag):
    y = record["y"].copy()
    y[5000] += spike
    clean, spike = (evaluate(ambkit.KalmanFilter(bearing), changed(record, y=values))
                    for values in (record["y"], y))  # fmt: skip
    assert spike.status == {flag: 1}
    for figures in ("prediction", "held"):
        for ahead, error in getattr(spike, figures).items():
            assert error == pytest.approx(getattr(clean, figures)[ahead], rel=0.01)


def test_a_filter_of_a_file_is_not_said_to_be_tuned(bearing, record, tmp_path):
    ambkit.ExtendedKalmanFilter(bearing).save(tmp_path / "kf.toml")
    measured = ambkit.Record(record.t, {of: record[of] for of in "yu"}, {"y": "m", "u": "V"})
    file = str(tmp_path / "kf.toml")
    found = ambkit.filter(measured, file, machine=bearing)
    assert found.stretch is None
    assert not any("Tuned" in text for text in found.remarks)
    beside = ambkit.filter(measured, [file, "linear"], machine=bearing)
    assert any("s (linear), judged on the rest" in text for text in beside.remarks)


def test_a_spike_that_all_leave_out_does_not_undo_the_tuning(bearing, record):
    y = record["y"].copy()
    y[7000] += 5e-3
    clean, spike = (
        ambkit.filter(
            ambkit.Record(record.t, {"y": values, "u": record["u"]}), "linear", machine=bearing
        )["linear"]
        for values in (record["y"], y)
    )
    assert spike.tuning.kept == clean.tuning.kept
    assert spike.noise == clean.noise
    assert spike.evaluation.nis == pytest.approx(clean.evaluation.nis, rel=0.01)


@pytest.mark.parametrize(("factor", "loads", "outside"), [
    (0.5, 0.0, True), (0.7, 0.0, False), (1.0, 0.3, False), (1.3, 0.0, False), (1.8, 0.3, True),
])  # fmt: skip
def test_multiple_models_say_that_the_magnet_is_beyond_them(factor, loads, outside):
    """From steps of the position, and while a load changes, too."""
    known = drawn(12)
    own, T = own_time(known), known.sampling_time
    at, random = 10 * own * np.arange(1, 12), np.random.default_rng(1)
    steps = 0.3 * known.clearance * np.tile([1, -1], 6)[:11]
    forces = known.rotor.mass * 9.81 * random.uniform(-loads, loads, 11)
    record = ambkit.simulate(
        known.replace(magnet__magnet_constant=factor * known.magnet.magnet_constant),
        ambkit.Scenario(
            duration=120 * own, seed=5,
            reference=Sequence(times=at, values=steps),
            disturbance=Sequence(times=at - 4 * own, values=forces),
        ),
    ).record  # fmt: skip
    measured = ambkit.Record(record.t, {of: record[of] for of in "yu"})
    result = ambkit.filter(measured, "multiple-model", machine=known, disturbance_noise=None)
    status = result["multiple-model"].evaluation.estimate.status & ambkit.Status.OUTSIDE
    assert status.any() == outside
    assert any("beyond all of its models" in text for text in result.remarks) == outside
    if outside and not loads:
        assert np.argmax(status) * T < 40 * own
