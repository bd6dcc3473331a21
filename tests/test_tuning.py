"""Tuning by likelihood: it finds what the record was made with."""

import numpy as np
import pytest

from ambkit import Bearing, FilterNoise, KalmanFilter, Record
from ambkit.tuning import log_likelihood, most_likely_disturbance


def wandering(bearing, growth, n=20_000, seed=3):
    """A record that the linear filter's own model makes, with a disturbance that wanders."""
    rng = np.random.default_rng(seed)
    kf = KalmanFilter(bearing, noise=FilterNoise(disturbance=growth))
    T, m = bearing.sampling_time, bearing.rotor.mass
    keep = np.exp(-T / bearing.sensor.lag)
    k_i, k_s = kf.source.k_i, kf.source.k_s
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
    bearing = Bearing.preset("zittau_axial")
    record = wandering(bearing, growth)
    found = most_likely_disturbance(
        bearing, record, lambda g: KalmanFilter(bearing, noise=FilterNoise(disturbance=g))
    )
    assert 0.5 * growth < found < 2 * growth


def test_likelihood_is_that_of_the_innovations_taken_in():
    bearing = Bearing.preset("zittau_axial")
    record = wandering(bearing, 100.0, n=500)
    y = record["y"].copy()
    y[100:150] = np.nan
    holes = Record(record.t, {"y": y, "u": record["u"]}, {"y": "m", "u": "V"})
    estimate = KalmanFilter(bearing).run(holes)
    e, S = estimate.innovation, estimate.innovation_variance
    taken = [k for k in range(1, 500) if not 100 <= k < 150]
    naive = -0.5 * sum(np.log(S[k]) + e[k] ** 2 / S[k] for k in taken)
    assert log_likelihood(estimate) == pytest.approx(naive, rel=1e-12)
