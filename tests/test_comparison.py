"""Several estimators judged alike: what the figures are, and that only the seed decides them."""

from functools import partial

import numpy as np
import pytest

import ambkit
from ambkit import AdaptiveKalmanFilter, ClosedLaw, KalmanFilter, Machine, Record, Scenario
from ambkit.estimate.errors import prediction_error, whiteness
from ambkit.judge.comparison import compare, rmse
from ambkit.simulation.run import simulate_run

BEARING = Machine.preset("zittau_axial")
FIELD = {
    "linear": partial(KalmanFilter, BEARING),
    "closed law": partial(AdaptiveKalmanFilter, BEARING, ClosedLaw(BEARING)),
}


def loaded(amplitude, **changes):
    """The paper's step, with 3 N on top of it."""
    return Scenario(
        duration=0.5,
        reference=ambkit.Step(amplitude=amplitude, time=0.02),
        disturbance=ambkit.Step(amplitude=3.0, time=0.2),
        **changes,
    )


def test_what_the_right_stiffness_buys():
    """First calculated apart from this code: 0.58 N linear, 0.33 N adaptive, position alike."""
    scores = compare(BEARING, loaded(5e-4), FIELD, range(6))
    linear, law = scores["linear"], scores["closed law"]
    assert linear.mean("f_d") == pytest.approx(0.58, abs=0.08)
    assert law.mean("f_d") == pytest.approx(0.33, abs=0.05)
    assert (law.figures["f_d"] < linear.figures["f_d"]).all()  # seed by seed
    assert law.mean("x") == pytest.approx(linear.mean("x"), rel=0.15)
    assert law.mean("nis") == pytest.approx(1, abs=0.05)


def test_near_the_centre_there_is_nothing_to_gain():
    scores = compare(BEARING, loaded(2e-5), FIELD, range(4))
    assert scores["closed law"].mean("f_d") == pytest.approx(scores["linear"].mean("f_d"), rel=0.03)


def test_the_scores_do_not_depend_on_the_threads():
    one, many = (compare(BEARING, loaded(3e-4), FIELD, range(5), threads=n) for n in (1, 4))
    for name in FIELD:
        assert (one[name].figures["nis"] == many[name].figures["nis"]).all()
        for signal in ("x", "v", "f_d"):
            assert (one[name].figures[signal] == many[name].figures[signal]).all()


def test_a_score_is_that_of_the_single_runs():
    done = []
    scenario = loaded(3e-4)
    score = compare(BEARING, scenario, FIELD, [7, 8], done=lambda: done.append(1))["linear"]
    assert len(done) == 4
    singles = []
    for seed in (7, 8):
        run = simulate_run(BEARING, scenario.replace(seed=seed), estimator=KalmanFilter(BEARING))
        error = run.estimate.f_d - run.record["f_d"]
        singles.append(np.sqrt(np.mean(error**2)))
        assert rmse(run.estimate, run.record, "f_d") == singles[-1]
    assert (score.figures["f_d"] == singles).all()
    assert score.mean("f_d") == pytest.approx(np.mean(singles))
    assert score.spread("f_d") == pytest.approx(abs(singles[0] - singles[1]) / np.sqrt(2))
    assert compare(BEARING, scenario, FIELD, [7])["linear"].spread("f_d") == 0


# ---- whiteness ----


def test_white_innovations_pass_and_coloured_ones_do_not():
    rng = np.random.default_rng(4)
    white = rng.normal(3.0, 2.0, 20_000)  # neither mean nor size matters
    found = whiteness(white, lags=200)
    assert found.bound == pytest.approx(1.96 / np.sqrt(20_000))
    assert found.share_within == pytest.approx(0.95, abs=0.05)
    coloured = np.convolve(white, [1, 0.9], mode="valid")
    found = whiteness(coloured, lags=5)
    assert found.correlation[0] == pytest.approx(0.9 / 1.81, abs=0.02)
    assert np.abs(found.correlation[1:]).max() < 0.03
    assert found.share_within <= 0.8


def test_the_correlation_is_the_plain_sum():
    e = np.array([1.0, -2.0, 4.0, -1.0, -2.0])
    assert whiteness(e, lags=2).correlation == pytest.approx([-12 / 26, -2 / 26])


# ---- prediction ----


def test_the_prediction_error_counts_what_was_predicted_and_measured():
    y = np.array([0.0, 1.0, 2.0, np.nan, 4.0, 5.0])
    record = Record(np.arange(6) * 1e-4, {"y": y})
    predicted = np.array([2.0, 0.0, 1.0, 9.0])  # of y[2], y[3] (missing), y[4], y[5]
    assert prediction_error(predicted, record, 2) == pytest.approx(np.sqrt((0 + 9 + 16) / 3))
    assert prediction_error(predicted, record, 2, skip=1) == pytest.approx(np.sqrt((9 + 16) / 2))


def test_the_right_model_predicts_better_and_errors_grow_with_the_distance():
    scenario = Scenario(duration=0.5, reference=ambkit.Sine(amplitude=4e-4, frequency=10.0))
    record = ambkit.simulate(BEARING, scenario).record
    errors = {}
    for name, make in FIELD.items():
        kf = make()
        estimate = kf.run(record)
        for ahead in (1, 10, 50):
            predicted = kf.forecast(estimate, record, ahead)
            errors[name, ahead] = prediction_error(predicted, record, ahead, skip=500)
    noise = np.sqrt(BEARING.sensor.noise_variance)
    assert errors["closed law", 1] == pytest.approx(noise, rel=0.25)
    for name in FIELD:
        assert errors[name, 1] < errors[name, 10] < errors[name, 50]
    assert errors["closed law", 50] < errors["linear", 50]
