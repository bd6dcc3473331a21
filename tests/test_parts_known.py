"""What estimators gain by knowing a part of the bearing, and what judges them with it."""

from itertools import pairwise

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import Machine, Scenario, Sine, Step
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison import criteria
from ambkit.judge.comparison.bound import bearing_bound
from ambkit.judge.comparison.cases import CASES
from ambkit.judge.comparison.comparison import bench
from ambkit.judge.comparison.tuning import candidates
from ambkit.judge.faults.fault_test import inject_faults
from ambkit.workflow.tuning import default_disturbance, tune_disturbance

BEARING = Machine.preset("zittau_axial")
PARTS = {
    "amplifier": {"amplifier__bandwidth": "200 Hz"},
    "delay": {"delay": "0.15 ms"},
    "coloured noise": {"sensor__coloured_noise": {"variance": "400 um^2", "bandwidth": "100 Hz"}},
    "hum": {"sensor__hum": [{"frequency": "50 Hz", "amplitude": "30 um", "bandwidth": "0.5 Hz"}]},
}
MADE = [name for name in KINDS if KINDS[name].magnet is not None]  # Those that need no training.
EVERY = {key: value for of in PARTS.values() for key, value in of.items()}

GAINED = {"amplifier": (0.7, 0.25), "delay": (1.0, 0.85), "coloured noise": (0.95, 0.4),
          "hum": (0.55, 0.5)}  # fmt: skip
"""Most that is left of the errors of x and f_d for who knows, in the mean over the seeds."""


SHAKEN = Scenario(
    duration=0.5, reference=Sine(amplitude=200e-6, frequency=40.0),
    disturbance=Step(amplitude=2.0, time=0.3), controller=ambkit.PID.textbook(BEARING),
)  # fmt: skip
"""The control works at 40 Hz: what is late matters where something moves."""


def with_part(name):
    return BEARING.replace(**PARTS[name])


@pytest.fixture(scope="module")
def complete():
    return BEARING.replace(**EVERY)


def simulated(bearing, seed, duration=0.5):
    """A step, then a load; the loop is fed by the linear filter that knows."""
    scenario = Scenario(
        duration=duration, seed=seed,
        reference=Step(amplitude=3e-4, time=0.1), disturbance=Step(amplitude=2.0, time=0.3),
    )  # fmt: skip
    record = ambkit.simulate(bearing, scenario).record
    assert not record.meta["stop_touched"]
    return record


@pytest.mark.parametrize("name", PARTS)
def test_who_knows_the_part_is_better(name):
    bearing = with_part(name)
    left = {"x": [], "f_d": []}
    for seed in range(5):
        record = ambkit.simulate(bearing, SHAKEN.model_copy(update={"seed": seed})).record
        assert not record.meta["stop_touched"]
        knows, plain = (ambkit.ExtendedKalmanFilter(b).run(record) for b in (bearing, BEARING))
        for signal, shares in left.items():
            error = [criteria.rms((e[signal] - record[signal])[300:]) for e in (knows, plain)]
            shares.append(error[0] / error[1])
        assert 0.9 < np.mean(knows.nis[300:]) < 1.1
    for most, shares in zip(GAINED[name], left.values(), strict=True):
        assert np.mean(shares) < most, (name, left)


@pytest.mark.parametrize("name", quick(PARTS, ["delay", "hum"]))
def test_the_comparison_judges_all_and_nobody_is_below_the_limit(name):
    bearing = with_part(name)

    class Raw:
        """The sensor itself."""

        def step(self, y, _u):
            return y, np.nan, np.nan, y

    field = candidates(MADE, bearing, custom={"raw": lambda _bearing: Raw()})
    made = bench(bearing, CASES["model"], field, runs=6)
    assert made.stopped == 0
    right = made.best["extended"]
    assert right.mean("nees") == pytest.approx(0.95, abs=0.02)
    assert right.mean("nis") == pytest.approx(1.0, abs=0.05)
    assert right.mean("white") > 0.9
    assert right.mean("force") < 0.5 * made.best["linear"].mean("force")
    for kind, standing in made.best.items():
        assert standing.mean("lost") == 0, kind
        for signal in ("x", "v", "f_d"):
            if not np.isnan(standing.mean(signal)):
                # Six runs: their pooled error is known to 3 %, of a load that wanders to less.
                assert made.efficiency(kind, signal) < 1.1, (kind, signal)
    for signal in ("x", "v", "f_d"):
        assert made.efficiency("extended", signal) > 0.9, signal


@pytest.mark.parametrize("name", PARTS)
def test_the_limit_of_a_linear_machine_is_the_covariance_of_its_filter(name):
    """Held at one place the tangents hardly move, and the limit is the Riccati equation's."""
    bearing = with_part(name)
    record = ambkit.simulate(bearing, Scenario(duration=0.1, noise=False)).record
    kalman = ambkit.ExtendedKalmanFilter(bearing, frozen_limit=0)  # nothing moves: it hovers
    bound = bearing_bound(bearing, [record], kalman.variances, kalman.default_std())
    assert bound.shape == (len(record), len(kalman.states))
    found = kalman.run(record, covariance=True)
    for place, state in enumerate(kalman.states):
        std = found.std(state.name)[300:]
        np.testing.assert_allclose(bound[300:, place], std, rtol=5e-3, atol=1e-9 * state.size)


@pytest.mark.parametrize("kind", ["linear", "extended", "ud"])
def test_smoothing_is_that_of_the_textbook(complete, kind):
    """Rauch, Tung and Striebel (1965) on the filter's own linear models, in units of their own."""
    bearing = complete
    record = ambkit.simulate(
        bearing, Scenario(duration=0.05, seed=1, reference=Step(amplitude=2e-4, time=0.02))
    ).record
    kalman = KINDS[kind].make(bearing)
    kalman.law_error = np.zeros(0)  # no smoother takes it away
    filtered = kalman.run(record, covariance=True)
    smoothed = kalman.smooth(record)
    n, unit = len(kalman.states), np.array(kalman.default_std())
    upper = np.triu_indices(n)
    P = np.zeros((len(record), n, n))
    P[:, upper[0], upper[1]] = P[:, upper[1], upper[0]] = filtered.covariance
    P /= np.outer(unit, unit)
    mean, cov = filtered.mean / unit, P.copy()
    for k, after in reversed(list(pairwise(range(len(record))))):
        model = kalman.linear_model(filtered.k_i[after], filtered.k_s[after]).scaled(unit)
        ahead = model.A @ P[k] @ model.A.T + model.Q
        gain = (ahead @ model.H.T)[:, 0] / filtered.innovation_variance[after]
        predicted = filtered.mean[after] / unit - gain * filtered.innovation[after]
        size = np.sqrt(np.diag(ahead))
        inverse = np.linalg.pinv(ahead / np.outer(size, size), rcond=1e-13, hermitian=True)
        back = P[k] @ model.A.T @ (inverse / np.outer(size, size))
        mean[k] += back @ (mean[after] - predicted)
        cov[k] += back @ (cov[after] - ahead) @ back.T
    std = np.sqrt(np.einsum("kii->ki", cov))
    assert np.max(np.abs(smoothed.mean / unit - mean) / std) < 1e-3
    for place, state in enumerate(kalman.states):
        np.testing.assert_allclose(smoothed.std(state.name) / unit[place], std[:, place], rtol=1e-3)
    for signal in ("x", "f_d"):
        errors = [criteria.rms((e[signal] - record[signal])[200:]) for e in (smoothed, filtered)]
        assert errors[0] < errors[1]


def test_many_at_once_and_one_by_one_are_the_same(complete):
    bearing = complete
    records = [simulated(bearing, seed, 0.1) for seed in (1, 2)]
    y, u = (np.array([record[signal] for record in records]) for signal in ("y", "u"))
    for kind in MADE:
        estimator = KINDS[kind].make(bearing)
        together = ambkit.run_many([estimator, KINDS[kind].make(bearing)], y, u)
        for mean, record in zip(together.mean, records, strict=True):
            np.testing.assert_array_equal(mean, estimator.run(record).mean, err_msg=kind)


def test_a_filter_takes_over_from_one_of_the_same_states_alone():
    bearing = with_part("hum")
    record = simulated(bearing, 0, 0.1)
    old, new = ambkit.KalmanFilter(bearing), ambkit.ExtendedKalmanFilter(bearing)
    old.run(record)
    new.transfer_from(old)
    np.testing.assert_array_equal(new.mean, old.mean)
    np.testing.assert_array_equal(new.core.covariance, old.core.covariance)
    with pytest.raises((ValueError, TypeError)):
        ambkit.ExtendedKalmanFilter(BEARING).transfer_from(old)


def test_after_faults_all_come_back(complete):
    found = inject_faults(
        complete, ["linear", "extended", "observer"], steps=0,
        faults=["knock", "outage-10ms", "spikes", "stuck", "nan-u"],
    )  # fmt: skip
    assert not found.failures, found.failures


@pytest.mark.parametrize("name", PARTS)
def test_tuning_finds_how_the_load_wanders(name):
    """A tenth of what is assumed untuned: from the record alone, to a third of a decade."""
    bearing = with_part(name)
    growth = 0.1 * default_disturbance(bearing)
    n = 5001
    steps = np.random.default_rng(3).normal(0, np.sqrt(growth * bearing.sampling_time), n)
    times = bearing.sampling_time * np.arange(n)
    load = ambkit.Recorded(times=times, values=np.cumsum(steps) - steps[0])
    record = ambkit.simulate(
        bearing, Scenario(duration=float(times[-1]), seed=4, disturbance=load)
    ).record
    found = tune_disturbance(
        bearing,
        record,
        lambda d: ambkit.ExtendedKalmanFilter(bearing, noise=ambkit.FilterNoise(disturbance=d)),
    )
    assert abs(np.log10(found.intensity / growth)) < 0.35, found


@pytest.mark.parametrize("kind", ["low-pass", "observer"])
def test_who_predicts_little_follows_the_controls_all_the_same(kind):
    """The demanded currents of the samples before, and behind them a lag of first order."""
    bearing = BEARING.replace(delay="0.15 ms", amplifier__bandwidth="200 Hz")
    record = simulated(bearing, 0, 0.15)
    estimate = KINDS[kind].make(bearing).run(record)
    T, iu = bearing.sampling_time, bearing.amplifier.gain * record["u"]
    np.testing.assert_allclose(estimate["u_1"][1:], iu[:-1], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(estimate["u_2"][2:], iu[:-2], rtol=1e-12, atol=1e-15)
    half = np.exp(-2 * np.pi * 200 * T / 2)  # of a sample, in which the older of two acts
    holding = estimate["i"][0]  # what was demanded before the first sample, too
    assert holding == pytest.approx(bearing.levitation_current, abs=0.05)
    i = np.full(len(iu), holding)
    for k in range(2, len(iu)):
        older = half * i[k - 1] + (1 - half) * (iu[k - 3] if k > 2 else holding)
        i[k] = half * older + (1 - half) * iu[k - 2]
    np.testing.assert_allclose(estimate["i"], i, rtol=1e-9, atol=1e-12)
    late, true = record.t > 0.02, record["iu"]  # the truth has the control's noise, too
    assert criteria.rms((estimate["i"] - true)[late]) < 0.02 * np.ptp(true[late])


@pytest.mark.parametrize("kind", ["observer", "steady-state"])
def test_a_constant_gain_finds_a_line_that_stands_still(kind):
    still = BEARING.replace(sensor__hum=[{"frequency": "50 Hz", "amplitude": "30 um"}])
    estimator = KINDS[kind].make(still)
    assert np.isfinite(estimator.covariance).all()
    record = simulated(still, 0)
    estimate = estimator.run(record)
    assert 0.8 < np.mean(estimate.nis[1000:]) < 1.2
    if kind == "steady-state":
        noise = record["y"] - record["x_m"]
        left = criteria.rms((noise - estimate["hum_c"])[2000:])
        assert left < 0.6 * criteria.rms(noise[2000:])


@pytest.mark.parametrize("kind", ["low-pass", "observer"])
def test_who_knows_no_noise_says_nothing_of_it(kind):
    noisy = BEARING.replace(**PARTS["coloured noise"], **PARTS["hum"])
    record = simulated(noisy, 0)
    estimator = KINDS[kind].make(noisy)
    estimate = estimator.run(record, covariance=True)
    assert estimate.names == ("x", "v", "f_d", "x_m")
    assert estimate.sensor_noise is None
    poles = ("bandwidth", "damping") if kind == "observer" else ()  # they follow noise
    plain = KINDS[kind].make(BEARING, **{name: getattr(estimator, name) for name in poles})
    np.testing.assert_array_equal(estimate.mean, plain.run(record).mean)
    if kind == "observer":  # what it expects is that of the machine
        assert 0.85 < np.mean(estimate.nis[300:]) < 1.15
        assert 0.5 < criteria.rms(estimate.x - record["x"]) / np.mean(estimate.std("x")) < 2.0
