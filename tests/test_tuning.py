"""Tuning by likelihood: it finds what the record was made with."""

import re
from pathlib import Path

import numpy as np
import pytest

from ambkit import PID, FilterNoise, KalmanFilter, LowPass, Machine, Record, Scenario, simulate
from ambkit.judge.evaluation import evaluate
from ambkit.workflow.tuning import (
    DECADES,
    TunedDisturbance,
    default_disturbance,
    log_likelihood,
    tune_disturbance,
)


def wandering(bearing, growth, n=20_000, seed=3):
    """A record that the linear filter's own model makes, with a disturbance that wanders."""
    rng = np.random.default_rng(seed)
    kf = KalmanFilter(bearing, noise=FilterNoise(disturbance=growth))
    T, m = bearing.sampling_time, bearing.rotor.mass
    keep = np.exp(-T / bearing.sensor.lag)
    k_i, k_s = kf.magnet.k_i, kf.magnet.k_s
    x = v = f_d = x_m = 0.0
    y, u = np.empty(n), np.empty(n)
    for k in range(n):
        y[k] = x_m + rng.normal(0, bearing.sensor.noise_variance**0.5)
        # Any stabilising feedback of the true state will do: it is not what is identified.
        u[k] = -bearing.weight / k_i - 3000 * x - 12 * v
        w = rng.normal(0, bearing.amplifier.noise_variance**0.5)
        force = k_i * (u[k] + w) + k_s * x + f_d + bearing.weight
        x, v, x_m = (
            x + T * v + T**2 / (2 * m) * force,
            v + T / m * force,
            (1 - keep) * x + keep * x_m,
        )
        f_d += rng.normal(0, (growth * T) ** 0.5)
    return Record(T * np.arange(n), {"y": y, "u": u}, {"y": "m", "u": "V"})


@pytest.mark.parametrize("growth", [1.0, 100.0])
def test_the_growth_that_made_the_record_is_found(growth):
    bearing = Machine.preset("zittau_axial")
    record = wandering(bearing, growth)
    found = tune_disturbance(
        bearing, record, lambda g: KalmanFilter(bearing, noise=FilterNoise(disturbance=g))
    )
    assert 0.5 * growth < found.intensity < 2 * growth


def test_likelihood_is_that_of_the_innovations_taken_in():
    bearing = Machine.preset("zittau_axial")
    record = wandering(bearing, 100.0, n=500)
    y = record["y"].copy()
    y[100:150] = np.nan
    holes = Record(record.t, {"y": y, "u": record["u"]}, {"y": "m", "u": "V"})
    estimate = KalmanFilter(bearing).run(holes)
    e, S = estimate.innovation, estimate.innovation_variance
    taken = [k for k in range(1, 500) if not 100 <= k < 150]
    naive = -0.5 * sum(np.log(S[k]) + e[k] ** 2 / S[k] for k in taken)
    assert log_likelihood(estimate) == pytest.approx(naive, rel=1e-12)


SPINDLE = Machine.load(Path(__file__).parent.parent / "examples" / "spindle.toml")


def hovering(noise=1.0, stretch=0.1, seed=1):
    """The spindle at rest, its sensor `noise` times as loud (variance) as it is described."""
    louder = SPINDLE.replace(sensor__noise_variance=noise * SPINDLE.sensor.noise_variance)
    loop = Scenario(duration=0.1 + stretch, seed=seed, controller=PID.for_bearing(SPINDLE))
    return simulate(louder, loop).record.between(0.1, None)


def tuned(record):
    def make(growth):
        return KalmanFilter(SPINDLE, noise=FilterNoise(disturbance=growth))

    likely = {
        decade: log_likelihood(make(default_disturbance(SPINDLE) * 10.0**decade).run(record))
        for decade in np.arange(DECADES[0], DECADES[1] + 0.5)
    }
    found = tune_disturbance(SPINDLE, record, make)
    return found, log_likelihood(make(found.intensity).run(record)), likely


@pytest.mark.parametrize("seed", range(3))
def test_where_nothing_wanders_the_largest_likely_growth_is_taken(seed):
    """And not the end of the range, at which a filter would be sure of whatever it saw."""
    found, likelihood, likely = tuned(hovering(seed=seed))
    assert "nearly constant in this interval" in found.why
    assert max(likely.values()) - likely[DECADES[0]] < 2
    assert likelihood == pytest.approx(max(likely.values()) - 2, abs=0.4)
    assert -6 < np.log10(found.intensity / default_disturbance(SPINDLE)) < -3


@pytest.mark.parametrize(("noise", "seed"), [(9.0, 0), (9.0, 1), (12.0, 2), (50.0, 2)])
def test_what_no_load_explains_is_not_made_a_load(noise, seed):
    """The sensor is three to seven times as loud as described: load noise would run to any end."""
    found, _, _ = tuned(hovering(noise=noise, seed=seed))
    assert found.intensity == default_disturbance(SPINDLE)
    assert "no process noise explains this interval" in found.why
    told = float(re.search(r"are ([0-9.]+) times what the filter expects", found.why)[1])
    assert told == pytest.approx(noise**0.5, rel=0.1)
    assert "--measurement-noise" in found.why


@pytest.mark.parametrize("seed", range(2))
def test_a_sensor_a_little_louder_still_gives_a_load_noise(seed):
    found, _, _ = tuned(hovering(noise=2.0, seed=seed))
    assert found.intensity < 0.1 * default_disturbance(SPINDLE)


def test_a_stretch_that_does_not_tell_leaves_the_default():
    found, _, likely = tuned(hovering(stretch=0.002))
    assert max(likely.values()) - likely[0.0] < 2
    assert found.intensity == default_disturbance(SPINDLE)
    assert "does not determine" in found.why


def test_a_low_pass_has_nothing_to_be_tuned_and_is_not_consistent_with_anything():
    record = hovering(stretch=0.02)
    found = tune_disturbance(SPINDLE, record, lambda _: LowPass(SPINDLE))
    assert found == TunedDisturbance(default_disturbance(SPINDLE))
    evaluation = evaluate(LowPass(SPINDLE), record)
    assert np.isnan(evaluation.nis)
    assert evaluation.prediction[1] > 0
