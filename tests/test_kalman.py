"""The filter against its textbook form, other libraries, and its own other forms."""

import numpy as np
import oracles
import pytest
from filter_cases import BEARING, SETTINGS, START, STD, core_filter, full, moving_record, off

import ambkit
from ambkit import ClosedLaw
from ambkit.machine.magnets import core_module

# ---- against the textbook ----


@pytest.mark.parametrize("as_printed", [False, True])
def test_eq_9_to_13_with_full_matrices(as_printed):
    """With (I - K H) P as in eq. 13, for as long as that keeps its symmetry."""
    s = SETTINGS | {"as_printed": as_printed}
    r = {name: values[:400] for name, values in moving_record(0.05).items()}
    naive = oracles.Kalman(s, START, STD, joseph=False).run(**r)
    ours = core_filter(s).run(**r, covariance=True)
    assert off(ours["mean"], naive["mean"]).max() < 1e-10
    np.testing.assert_allclose(ours["variance"], naive["variance"], rtol=1e-10)
    scale = np.sqrt(np.einsum("kii->ki", naive["covariance"]))
    correlation = (full(ours["covariance"]) - naive["covariance"]) / np.einsum(
        "ki,kj->kij", scale, scale
    )
    assert np.abs(correlation).max() < 1e-9


def test_the_adaptive_filter_asks_the_law_at_its_estimate():
    """Fig. 8 written plainly: stiffness at the estimate and the current, then predict, update."""
    r = moving_record(0.3)
    y, u = r["y"], r["u"]
    naive = oracles.Kalman(SETTINGS, START, STD)
    mean, k = np.empty((len(y), 4)), np.empty((len(y), 2))

    def force(iu, x):
        return oracles.magnet_force(BEARING, iu, x)

    for i in range(len(y)):
        if i > 0:
            iu = min(max(u[i - 1], SETTINGS["iu_min"]), SETTINGS["iu_max"])
            at = naive.X[0] + naive.X[1] * SETTINGS["T"] / 2
            # 0.1 mA and 0.1 um: near the limit of the paper's least squares, not yet noise
            k[i] = oracles.least_squares_stiffness(force, iu, at, 1e-4, 1e-7)
            naive.predict(*k[i], u[i - 1])
        naive.update(y[i])
        mean[i] = naive.X
    law = ClosedLaw(BEARING).in_core(core_module())
    ours = core_filter(SETTINGS, magnet=law).run(y, u)
    assert off(ours["mean"], mean).max() < 1e-6
    np.testing.assert_allclose(ours["k_s"][1:], k[1:, 1], rtol=1e-5)
    np.testing.assert_allclose(ours["k_i"][1:], k[1:, 0], rtol=1e-5)


# ---- one filter, said in several ways ----


def test_a_run_is_its_steps_and_a_step_is_predict_and_update():
    r = moving_record(0.05)
    y, u = r["y"], r["u"]
    law = ClosedLaw(BEARING).in_core(core_module())
    whole, steps, halves = (core_filter(SETTINGS, magnet=law) for _ in range(3))
    mean = whole.run(y, u)["mean"]
    steps.update(y[0])
    halves.update(y[0])
    for k in range(1, len(y)):
        steps.step(y[k], u[k - 1])
        halves.predict(u[k - 1])
        halves.update(y[k])
        assert (steps.mean == mean[k]).all()
        assert (halves.mean == mean[k]).all()
    assert (steps.covariance == whole.covariance).all()
    assert steps.innovation == halves.innovation == whole_innovation(y, u, law)
    assert steps.k_s == halves.k_s


def whole_innovation(y, u, law):
    return float(core_filter(SETTINGS, magnet=law).run(y, u)["innovation"][-1])


def test_a_forecast_goes_on_without_measurements():
    r = moving_record(0.02)
    y, u = r["y"], r["u"]
    kf = core_filter(SETTINGS)
    mean = kf.run(y, u)["mean"]
    ahead = 10
    forecast = kf.forecast(mean, u, ahead)
    assert forecast.shape == (len(y) - ahead, 1)
    naive = oracles.Kalman(SETTINGS, START, STD)
    for k in (0, 17, len(y) - ahead - 1):
        naive.X = mean[k].copy()
        for j in range(ahead):
            naive.predict(10.05, 7537.5, u[k + j])
        assert forecast[k, 0] == pytest.approx(naive.X[3], rel=1e-12)
    assert kf.forecast(mean, u, len(y) + 5).shape == (0, 1)


def test_the_filters_of_the_package_are_set_up_from_the_bearing():
    r = moving_record(0.05)
    record = ambkit.Record(
        BEARING.sampling_time * np.arange(len(r["y"])), {"y": r["y"], "u": r["u"]}
    )
    kf = ambkit.KalmanFilter(BEARING)
    estimate = kf.run(record, covariance=True)
    naive = oracles.Kalman(
        SETTINGS, np.array([r["y"][0], 0, 0, r["y"][0]]), np.array(kf.default_std())
    )
    constant = np.full_like(r["y"], 10.05), np.full_like(r["y"], 7537.5)
    expected = naive.run(r["y"], r["u"], *constant)
    assert off(estimate.mean, expected["mean"]).max() < 1e-10
    assert kf.core.covariance[2, 2] == pytest.approx(naive.P[2, 2], rel=1e-9)
    # In eq. 15-16 the weight is left out: the same motion then shows it as a disturbance.
    paper = ambkit.KalmanFilter(BEARING, gravity="disturbance").run(record)
    settled = slice(200, None)
    assert np.mean(estimate.f_d[settled] - paper.f_d[settled]) == pytest.approx(
        0.518 * 9.81, rel=0.02
    )


def test_a_state_that_is_known_less_surely():
    kalman = ambkit.ExtendedKalmanFilter(BEARING)
    record = moving_record(0.01)
    kalman.core.run(record["y"], record["u"])
    P, mean = kalman.core.covariance, kalman.core.mean
    kalman.core.widen(np.array([1e-5, 2e-3, 0.0, 3e-5]))
    np.testing.assert_array_equal(kalman.core.mean, mean)
    added = np.diag(np.square([1e-5, 2e-3, 0.0, 3e-5]))
    np.testing.assert_allclose(kalman.core.covariance, P + added, rtol=1e-12)
    with pytest.raises(ValueError, match="std"):
        kalman.core.widen(np.ones(3))
