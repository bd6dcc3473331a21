"""What an estimator says about a record: names, standard deviations, and the way into a file."""

import numpy as np
import pytest

import ambkit
from ambkit import KalmanFilter, Machine, Record, Scenario, Status

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(BEARING, Scenario(duration=0.5, seed=1)).record


@pytest.fixture(scope="module")
def estimate():
    y = RECORD["y"].copy()
    y[1000:1010] = np.nan
    kf = KalmanFilter(BEARING)
    return kf.run(Record(RECORD.t, {"y": y, "u": RECORD["u"]}), covariance=True)


def test_states_have_names(estimate):
    assert estimate.names == ("x", "v", "f_d", "x_m")
    for column, name in enumerate(estimate.names):
        assert (estimate[name] == estimate.mean[:, column]).all()
        assert (getattr(estimate, name) == estimate[name]).all()
    assert (estimate["k_s"] == 7537.5).all()
    with pytest.raises(KeyError, match="'q'; known: x, v, f_d, x_m, k_i, k_s, innovation"):
        estimate["q"]


def test_standard_deviations_are_those_of_the_errors(estimate):
    """Where the disturbance is the random walk that the filter takes it for."""
    noise = ambkit.FilterNoise(disturbance=4.0)
    t = BEARING.sampling_time * np.arange(20_001)
    squares = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        steps = rng.normal(0, 2 * np.sqrt(BEARING.sampling_time), t.size)
        walk = ambkit.Recorded(times=t, values=np.cumsum(steps) - steps[0])
        record = ambkit.simulate(
            BEARING, Scenario(duration=2.0, disturbance=walk, seed=seed)
        ).record
        own = ambkit.ExtendedKalmanFilter(BEARING, noise=noise).run(record, covariance=True)
        errors = np.column_stack([(own[name] - record[name])[1000:] for name in own.names])
        squares.append(np.mean(errors**2, axis=0))
    for name, mean in zip(own.names, np.mean(squares, axis=0), strict=True):
        assert np.sqrt(mean) == pytest.approx(own.std(name)[-1], rel=0.06), name
    without = KalmanFilter(BEARING).run(RECORD)
    with pytest.raises(ValueError, match="covariance=True"):
        without.std("x")


def test_the_normalised_innovation_is_one_where_the_measurement_was_used(estimate):
    assert estimate.nis[estimate.used][100:].mean() == pytest.approx(1, abs=0.1)
    assert (estimate.nis[~estimate.used] == 0).all()
    assert np.flatnonzero(~estimate.used).tolist() == list(range(1000, 1010))
    assert (estimate.status[~estimate.used] == Status.MISSING).all()


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_saved_estimates_come_back(estimate, tmp_path, ending):
    path = tmp_path / f"estimate{ending}"
    estimate.save(path)
    back = Record.load(path)
    for name in (*estimate.names, "k_i", "k_s", "innovation", "innovation_variance"):
        assert (back[name] == estimate[name]).all()
    assert (back["status"] == estimate.status).all()
    assert back.units["innovation_variance"] == "m^2"
    assert back.meta["estimator"] == "linear Kalman filter"
    assert not back.has_truth
