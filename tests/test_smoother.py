"""The smoother: Rauch, Tung and Striebel's, and what it does where samples are missing."""

import numpy as np
import pytest
from filter_cases import full

import ambkit
from ambkit import Machine, Record, Scenario, Status
from ambkit.base.errors import RecordError
from ambkit.estimate.registry import KINDS

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(
    BEARING,
    Scenario(
        duration=0.8,
        seed=4,
        reference=ambkit.Step(amplitude=3e-4, time=0.1),
        disturbance=ambkit.Sine(amplitude=3.0, frequency=3.0),
    ),
).record
SMOOTHED = ("linear", "closed-law", "extended", "ud")
smoothed = pytest.mark.parametrize("name", SMOOTHED)


def models_of(estimator, estimate):
    """The model with which each sample was predicted."""
    each = zip(estimate.k_i, estimate.k_s, strict=True)
    return [estimator.linear_model(k_i, k_s) for k_i, k_s in each]


def sigmas(estimate):
    return np.asarray(np.sqrt(estimate.covariance[:, [0, 4, 7, 9]]))


def textbook(estimator, filtered):
    """Rauch, Tung and Striebel 1965, with the inverse, in the states' own units."""
    units = np.array(estimator.default_std())
    X, P = filtered.mean / units, full(filtered.covariance) / np.outer(units, units)
    models = [m.scaled(units) for m in models_of(estimator, filtered)]
    for k in range(len(X) - 2, -1, -1):
        A, Q = models[k + 1].A, models[k + 1].Q
        predicted = A @ P[k] @ A.T + Q
        G = np.linalg.solve(predicted, A @ P[k]).T
        # What was predicted, from what the update made of it: for any force law.
        gain = predicted[:, 3] / (predicted[3, 3] + models[k + 1].R / units[3] ** 2)
        used = filtered.used[k + 1]
        ahead = filtered.mean[k + 1] / units
        ahead = ahead - gain * filtered.innovation[k + 1] / units[3] * used
        X[k] += G @ (X[k + 1] - ahead)
        P[k] += G @ (P[k + 1] - predicted) @ G.T
    return X * units, P * np.outer(units, units)


@smoothed
@pytest.mark.parametrize("missing", [False, True], ids=["whole", "with gaps"])
def test_it_is_the_textbook_s(name, missing):
    n = 1500
    y = RECORD["y"][:n].copy()
    if missing:
        y[[100, 101, 400, 1499]] = np.nan
        y[700:760] = np.nan
        y[900] += 5e-4  # an outlier
    record = Record(RECORD.t[:n], {"y": y, "u": RECORD["u"][:n]})
    estimator = KINDS[name].make(BEARING)
    estimator.law_error = np.zeros(0)  # no smoother takes it away
    filtered = estimator.run(record, covariance=True)
    assert (~filtered.used).sum() == (65 if missing else 0)
    made = estimator.smooth(record)
    X, P = textbook(estimator, filtered)
    sigma = sigmas(filtered)
    assert (np.abs(made.mean - X) <= 1e-8 * sigma).all()
    wide = np.einsum("ki,kj->kij", sigma, sigma)
    assert (np.abs(full(made.covariance) - P) <= 1e-8 * wide).all()
    np.testing.assert_array_equal(made.mean[-1], filtered.mean[-1])


@smoothed
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_it_knows_more_than_the_filter(name, precision):
    estimator = KINDS[name].make(BEARING, precision=precision)
    estimator.law_error = np.zeros(0)
    filtered, made = estimator.run(RECORD, covariance=True), estimator.smooth(RECORD)
    scale = sigmas(filtered)
    wide = np.einsum("ki,kj->kij", scale, scale)
    gained = (full(filtered.covariance) - full(made.covariance)) / wide
    least = -1e-9 if precision == "float64" else -1e-4
    assert np.linalg.eigvalsh(gained)[:, 0].min() > least
    assert np.linalg.eigvalsh(full(made.covariance) / wide)[:, 0].min() > least
    middle = slice(3000, 7000)
    if name != "linear":  # whose wrong stiffness no smoothing makes right
        assert made.std("f_d")[middle].max() < 0.8 * filtered.std("f_d")[middle].min()
        for state in ("v", "f_d"):
            before = np.std((filtered[state] - RECORD[state])[middle])
            assert np.std((made[state] - RECORD[state])[middle]) < 0.7 * before


def test_its_errors_are_what_it_says():
    """NEES over seeds, where the model is true: a load that wanders as assumed."""
    rng = np.random.default_rng(1)
    noise = ambkit.FilterNoise(disturbance=1.0)  # N^2/s
    nees = []
    for seed in range(20):
        wander = np.cumsum(rng.normal(0, np.sqrt(BEARING.sampling_time), 3000))
        t = BEARING.sampling_time * np.arange(3000)
        run = ambkit.simulate(
            BEARING,
            Scenario(duration=0.3, seed=seed, disturbance=ambkit.Recorded(times=t, values=wander)),
        ).record
        made = KINDS["extended"].make(BEARING, noise=noise).smooth(run)
        for k in (1000, 1500, 2000):
            error = np.array([made[s][k] - run[s][k] for s in ("x", "v", "f_d")])
            P = full(made.covariance[k : k + 1])[0][:3, :3]
            nees.append(error @ np.linalg.solve(P, error))
    assert 2.2 < np.mean(nees) < 3.9  # 3 expected; 60 draws


def test_over_an_outage_that_held_the_filter_nothing_is_carried():
    y = RECORD["y"].copy()
    y[3000:6500] = np.nan
    estimator = KINDS["extended"].make(BEARING)
    broken = Record(RECORD.t, {"y": y, "u": RECORD["u"]})
    filtered, made = estimator.run(broken, covariance=True), estimator.smooth(broken)
    held = np.flatnonzero(filtered.status & Status.HELD)
    assert np.isfinite(made.mean).all()
    # The last one held is the first that is measured again.
    assert held[-1] == 6500
    assert (made.mean[held[:-1]] == filtered.mean[held[:-1]]).all()
    assert (made.mean[6500:6600] != filtered.mean[6500:6600]).any(axis=1).all()
    assert (made.mean[held[0] - 500 : 3000] != filtered.mean[held[0] - 500 : 3000]).any()


@pytest.mark.parametrize("name", ["low-pass", "observer", "steady-state"])
def test_what_has_no_covariance_of_its_own_is_refused(name):
    with pytest.raises(ValueError, match="cannot be smoothed"):
        KINDS[name].make(BEARING).smooth(RECORD)


def test_a_short_record():
    for n in (2, 3):
        few = Record(RECORD.t[:n], {"y": RECORD["y"][:n], "u": RECORD["u"][:n]})
        made = KINDS["linear"].make(BEARING).smooth(few)
        assert len(made.x) == n
        assert np.isfinite(made.mean).all()


def test_it_asks_for_the_record_s_own_sampling_time():
    slow = Record(2 * RECORD.t, {"y": RECORD["y"], "u": RECORD["u"]})
    with pytest.raises(RecordError, match="sampling_time"):
        KINDS["linear"].make(BEARING).smooth(slow)
