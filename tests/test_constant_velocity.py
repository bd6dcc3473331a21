"""The naive baseline: constant-velocity Kalman filter against the textbook, and how it is tuned."""

import numpy as np
import pytest
from effort import lines_run

import ambkit
from ambkit.data.recordings import folder
from ambkit.estimate.constant_velocity import tune
from ambkit.estimate.errors import prediction_error
from ambkit.judge.comparison import ConstantVelocityFilter

T = 1e-4


def textbook(y, q, R):
    """Full matrices and a prior so wide that the first two measurements decide."""
    F = np.array([[1, T], [0, 1]])
    Q = q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    X, P = np.zeros(2), np.diag([1e10 * R, 1e10 * R / T**2])
    out = []
    for k, z in enumerate(y):
        if k:
            X, P = F @ X, F @ P @ F.T + Q
        if not np.isnan(z):
            S = P[0, 0] + R
            K = P[:, 0] / S
            X, P = X + K * (z - X[0]), P - np.outer(K, P[0])
        out.append(X)
    return np.array(out).T


def walk(n, q, R, seed=0):
    rng = np.random.default_rng(seed)
    L = np.linalg.cholesky(q * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]]))
    w = rng.normal(size=(n, 2)) @ L.T
    v = np.cumsum(w[:, 1])
    x = np.cumsum(w[:, 0] + T * np.concatenate([[0.0], v[:-1]]))
    return x, v, x + rng.normal(0, np.sqrt(R), n)


@pytest.mark.parametrize("offset", [0.0, 1.0])
@pytest.mark.parametrize("q", [1e-6, 1.0, 1e3])
def test_it_is_the_textbook_filter_over_gaps_spikes_and_repeats_too(q, offset):
    R = 1e-12
    y = offset + walk(3000, q, R)[2]
    y[[0, 5, 1500, 1501, 2800]] = np.nan
    y[[700, 701, 702, 703, 2000]] += 1e-3  # 1000 standard deviations: nothing is left out
    y[1000:1050] = y[1000]
    x, v = ConstantVelocityFilter(T, q, R).run(y)
    X, V = textbook(y - offset, q, R)  # its prior is around 0
    X = X + offset
    assert np.isnan(x[0])
    scale = np.sqrt(R)
    np.testing.assert_allclose(x[3:], X[3:], atol=1e-4 * scale, rtol=0)  # the prior is not infinite
    np.testing.assert_allclose(v[3:], V[3:], atol=1e-4 * scale / T, rtol=0)
    np.testing.assert_allclose(x[100:], X[100:], atol=1e-6 * scale, rtol=0)


def test_innovations_are_as_large_as_expected_and_units_do_not_matter():
    _, _, y = walk(20_000, 1.0, 1e-12)
    e, S = ConstantVelocityFilter(T, 1.0, 1e-12).innovations(y)
    assert np.nanmean(e**2 / S) == pytest.approx(1, abs=4 * np.sqrt(2 / y.size))
    assert np.isnan(e[:2]).all()
    assert np.isfinite(e[2:]).all()
    x, _ = ConstantVelocityFilter(T, 1.0, 1e-12).run(y)
    micro, _ = ConstantVelocityFilter(T, 1e12, 1.0).run(1e6 * y)
    np.testing.assert_allclose(1e-6 * micro, x, rtol=1e-12, atol=1e-12 * np.abs(x).max())


def test_both_ways_of_tuning_find_what_the_record_was_made_with():
    made = [walk(20_000, 3.0, 1e-12, seed) for seed in range(3)]
    ys, xs = [m[2] for m in made], [m[0] for m in made]
    for kf in (tune(ys, T), tune(ys, T, R=1e-12), tune(ys, T, truth=xs, first=100)):
        assert kf.q == pytest.approx(3.0, rel=0.35)
        assert np.sqrt(kf.R) == pytest.approx(1e-6, rel=0.015)
    best = tune(ys[0], T, truth=xs[0])
    rms = [np.std(ConstantVelocityFilter(T, q, best.R).run(ys[0])[0] - xs[0])
           for q in (best.q, 0.5 * best.q, 2 * best.q)]  # fmt: skip
    assert rms[0] == min(rms)


def test_no_loop_of_python_goes_over_the_samples():
    y = walk(100_000, 1.0, 1e-12)[2]
    kf = ConstantVelocityFilter(T, 1.0, 1e-12)
    few = lines_run(lambda: kf.run(y[:2000]))
    assert lines_run(lambda: kf.run(y)) < few + 1000


def test_what_an_outside_check_saw_on_the_real_rig():
    record = ambkit.Record.load(folder() / "sinus_kalman.csv")
    first = round(1.5 / record.sampling_time)
    kf = tune(record["y"][:first], record.sampling_time, R=(16.8e-6) ** 2)
    errors = [prediction_error(kf.predict(record["y"], a), record, a, first) for a in (1, 10)]
    assert [round(1e6 * error, 1) for error in errors] == [15.8, 20.4]


def test_refusals_name_parameter_limit_and_value():
    with pytest.raises(ValueError, match=r"q must be greater than 0 m\^2/s\^3 and finite, is -1"):
        ConstantVelocityFilter(T, -1, 1.0)
    with pytest.raises(ValueError, match="ahead must be 1 sample or more, is 0"):
        ConstantVelocityFilter(T, 1.0, 1.0).predict(np.zeros(9), 0)
    with pytest.raises(ValueError, match="three measurements or more"):
        tune(np.zeros(9), T)
    with pytest.raises(ValueError, match="truth must have the shape of y"):
        tune(np.arange(9.0), T, truth=np.zeros(8))
    assert all(np.isnan(a).all() for a in ConstantVelocityFilter(T, 1.0, 1.0).run([np.nan] * 3))


# ---- the kind of estimator ----


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_the_kind_is_the_textbook_filter(precision):
    """Full matrices beside the C, from its start on: mean, covariance and innovations."""
    bearing = ambkit.preset("zittau_axial").replace(sensor__gain=1.07)
    record = ambkit.simulate(bearing, ambkit.Scenario(duration=0.2, seed=3)).record
    kf = ambkit.ConstantVelocity(bearing, acceleration="5 m^2/s^3", precision=precision)
    estimate = kf.run(record, covariance=True)
    assert [state.name for state in kf.states] == ["x", "v", "f_d"]
    F, H = np.array([[1, T], [0, 1]]), np.array([1.07, 0])
    Q = 5 * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    R = bearing.sensor.noise_variance
    X, P = np.array([record["y"][0] / 1.07, 0]), np.diag(np.square(kf.default_std()[:2]))
    for k, y in enumerate(record["y"]):
        if k:
            X, P = F @ X, F @ P @ F.T + Q
        S = H @ P @ H + R
        near = 1e-9 if precision == "float64" else 1e-3
        assert estimate.innovation[k] == pytest.approx(y - H @ X, abs=near * np.sqrt(S))
        assert estimate.innovation_variance[k] == pytest.approx(S, rel=near)
        K = P @ H / S
        X, P = X + K * (y - H @ X), P - np.outer(K, H @ P)
        assert (np.abs(estimate.mean[k, :2] - X) <= near * np.sqrt(np.diag(P))).all()
    assert (estimate["f_d"] == 0).all()
    np.testing.assert_allclose(kf.covariance[2, 2], kf.default_std()[2] ** 2, rtol=1e-3)


def test_the_kind_takes_a_machine():
    machine = ambkit.Machine.preset("tum_mlps")
    record = ambkit.simulate(machine, ambkit.Scenario(duration=0.2, seed=3)).record
    estimate = ambkit.ConstantVelocity(machine).run(record)
    H = estimate.mean[500:, :4] @ ambkit.KalmanFilter(machine).view.C[:, :4].T
    readings = np.column_stack([record[f"y_{r.name}"] for r in machine.readings])[500:]
    assert np.std(H - readings) < 1.2 * np.sqrt(machine.readings[0].sensor.noise_variance)
    assert np.isfinite(estimate.mean).all()


def test_the_kind_says_what_it_does_not_take():
    bearing = ambkit.preset("zittau_axial")
    with pytest.raises(ValueError, match="acceleration must be greater than 0 m"):
        ambkit.ConstantVelocity(bearing, acceleration=-1.0)
    with pytest.raises(ValueError, match="synchronous cannot be estimated"):
        ambkit.ConstantVelocity(ambkit.Machine.preset("tum_mlps"), synchronous=["unbalance"])
