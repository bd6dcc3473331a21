"""Settings, starts and records that make no sense: told with name, limit and value."""

import numpy as np
import oracles
import pytest
from filter_cases import made

import ambkit
from ambkit import FilterNoise, KalmanFilter, Machine, Record, Scenario
from ambkit.base.errors import RecordError
from ambkit.machine.magnets import core_module

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(BEARING, Scenario(duration=0.3, seed=2)).record


@pytest.mark.parametrize(
    ("noise", "message"),
    [
        ({"measurement": 0.0}, r"noise.measurement must be greater than 0 m\^2, got 0.0"),
        ({"measurement": -1e-9}, r"noise.measurement must be greater than 0 m\^2, got -1e-09"),
        ({"measurement": np.nan}, "noise.measurement must be .* got nan"),
        ({"control": -1.0}, r"noise.control must be 0 or greater V\^2, got -1.0"),
        ({"disturbance": np.inf}, r"noise.disturbance must be 0 or greater N\^2/s, got inf"),
    ],
)
def test_a_variance_out_of_range_is_reported_with_name_limit_and_value(noise, message):
    with pytest.raises(ValueError, match=message):
        KalmanFilter(BEARING, noise=FilterNoise(**noise))


def test_no_noise_where_none_is_needed():
    """Zero is a variance for the process: certain control, constant disturbance."""
    quiet = KalmanFilter(BEARING, noise=FilterNoise(control=0.0, disturbance=0.0))
    estimate = quiet.run(RECORD, covariance=True)
    assert np.isfinite(estimate.mean).all()
    assert not estimate.status.any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gravity": "up"}, "gravity must be 'known' or 'disturbance', got 'up'"),
        ({"precision": "float16"}, "precision must be 'float64' or 'float32', got 'float16'"),
        ({"frozen_limit": -1}, "frozen_limit must be 0 or more, got -1"),
        ({"outlier_limit": -1}, "outlier_limit must be 0 or more, got -1"),
        ({"gate": 0.0}, "gate must be greater than 0 standard deviations, got 0.0"),
    ],
)
def test_an_option_out_of_range_is_reported(options, message):
    with pytest.raises(ValueError, match=message):
        KalmanFilter(BEARING, **options)


@pytest.mark.parametrize("name", ["T", "m", "T_sen", "x_max", "var_y", "gate"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_the_core_refuses_settings_that_make_no_filter(name, value):
    settings_ = oracles.settings_of(BEARING) | {name: value}
    told = "T, m and T_sen must be" if name in ("T", "m", "T_sen") else "outside its range"
    with pytest.raises(ValueError, match=told):
        made(core_module(), "Kalman", core_module().Constant(10.0, 7e3), settings_)


@pytest.mark.parametrize(
    ("mean", "std"),
    [([np.nan, 0, 0, 0], [1, 1, 1, 1]), ([0] * 4, [1, 0, 1, 1]), ([0] * 3, [1] * 4)],
)
def test_a_start_that_makes_no_sense_is_refused_and_leaves_the_state(mean, std):
    kf = KalmanFilter(BEARING)
    kf.step(1e-5, 0.5)
    before = kf.mean, kf.covariance
    with pytest.raises(ValueError, match="mean"):
        kf.reset(mean, std)
    assert (kf.mean == before[0]).all()
    assert (kf.covariance == before[1]).all()


def test_stiffnesses_that_are_no_numbers_are_not_predicted_with():
    n = 200
    core = core_module()
    kf = made(core, "Kalman", core.Constant(10.0, 7e3), oracles.settings_of(BEARING))
    kf.reset(np.zeros(4), np.array([1e-5, 1e-2, 5.0, 1e-5]))
    k_i, k_s = np.full(n, 10.05), np.full(n, 7537.5)
    k_i[100], k_s[120], k_s[140] = np.nan, np.inf, -np.inf
    out = kf.run(RECORD["y"][:n], RECORD["u"][:n], k_i, k_s)
    assert np.flatnonzero(out["status"]).tolist() == [101, 121, 141]
    assert set(out["status"][[101, 121, 141]]) == {core.BAD_PARAMETER}
    assert np.isfinite(out["mean"]).all()


def test_a_record_that_does_not_fit_is_reported():
    slow = Record(np.arange(100) * 1e-3, {"y": np.zeros(100), "u": np.zeros(100)})
    with pytest.raises(RecordError, match=r"sampled every 0.001 s, .* sampling_time = 0.0001 s"):
        KalmanFilter(BEARING).run(slow)
    without_u = Record(RECORD.t, {"y": RECORD["y"]})
    with pytest.raises(ambkit.RecordError, match="no signal u; it has y"):
        KalmanFilter(BEARING).run(without_u)
    core = KalmanFilter(BEARING).core
    with pytest.raises(ValueError, match="u has 3 samples, expected 2"):
        core.run(np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="k_s has 1 samples, expected 2"):
        core.run(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(1))
    with pytest.raises(ValueError, match="together or not at all"):
        core.run(np.zeros(2), np.zeros(2), np.zeros(2))
