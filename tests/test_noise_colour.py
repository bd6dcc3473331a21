"""Noise at rest: white noise passes for white, coloured noise is told with its correlation."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambkit import Record
from ambkit.identification.noise import measurement_noise


def at_rest(noise):
    t = 1e-3 * np.arange(noise.size)
    return Record(t, {"y": 1e-3 + 1e-3 * t + noise}, {"y": "m"})


def test_white_noise_is_called_white_about_as_often_as_it_should():
    rng = np.random.default_rng(4)
    found = [measurement_noise(at_rest(rng.normal(0, 1e-5, 4000)), "y") for _ in range(40)]
    assert np.mean([noise.white for noise in found]) > 0.9
    correlations = np.array([noise.correlation for noise in found])
    assert np.all(np.abs(correlations.mean(axis=0)) < 4 * found[0].bound / 1.96 / np.sqrt(40))
    assert np.mean(np.abs(correlations) <= found[0].bound) == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("a", [0.3, -0.4])
def test_the_colour_of_first_order_noise_is_found(a):
    rng = np.random.default_rng(1)
    noise = measurement_noise(at_rest(lfilter([1e-5], [1, -a], rng.normal(size=60_000))), "y")
    assert not noise.white
    np.testing.assert_allclose(noise.correlation[:3], [a, a**2, a**3], atol=0.03)
    assert f"1 sample apart it correlates by {noise.correlation[0]:+.2f}" in noise.colour
