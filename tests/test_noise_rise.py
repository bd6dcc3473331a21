"""Sensor noise that depends on the position: simulated, filtered, identified."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine
from ambkit.estimate.registry import KINDS
from ambkit.identification.maximum_likelihood import maximum_likelihood
from benchmarks.identification import TRUTH, closed_loops

RISE = -700.0  # 1/m
BEARING = Machine.preset("zittau_axial").replace(sensor__position_noise=RISE)


def test_it_goes_with_a_bearing_through_its_file():
    assert Machine.from_toml(BEARING.to_toml()).sensor.position_noise == RISE
    assert "position_noise" not in Machine.preset("zittau_axial").to_toml()


@pytest.mark.parametrize("kind", ["linear", "extended", "ud", "unscented"])
@pytest.mark.parametrize("at", [0.6e-3, -0.6e-3, -0.99e-3])
def test_a_filter_expects_the_noise_of_where_the_rotor_is(kind, at):
    """S is that of a sensor of this variance everywhere, at one place."""
    std = [1e-5, 1e-2, 1.0, 1e-5]
    share = min(max(1 + RISE * at, 1 / 8), 8.0)
    even = BEARING.replace(
        sensor__position_noise=0.0, sensor__noise_variance=share**2 * BEARING.sensor.noise_variance
    )
    rising, level = (KINDS[kind].make(b) for b in (BEARING, even))
    for one in (rising, level):
        one.reset([at, 0.0, 0.0, at], std)
        one.update(at + 2e-5)
    assert rising.innovation == level.innovation
    np.testing.assert_allclose(rising.innovation_variance, level.innovation_variance, rtol=1e-12)
    np.testing.assert_allclose(rising.mean, level.mean, rtol=1e-12)
    np.testing.assert_allclose(rising.covariance, level.covariance, rtol=1e-9, atol=1e-25)


def test_a_simulated_sensor_is_noisier_on_one_side():
    spread = {}
    for at in (-0.4e-3, 0.4e-3):
        scenario = ambkit.Scenario(duration=0.6, reference=ambkit.Constant(value=at))
        record = ambkit.simulate(BEARING, scenario).record
        steady = record.t > 0.2
        spread[at] = float(np.std((record["y"] - record["x_m"])[steady]))
        expected = (1 + RISE * at) * BEARING.sensor.noise_variance**0.5
        assert spread[at] == pytest.approx(expected, rel=0.05)
    assert spread[-0.4e-3] > 1.6 * spread[0.4e-3]


@pytest.mark.study
def test_it_is_found_beside_all_else_with_an_honest_error():
    truth = TRUTH.replace(sensor__position_noise=4000.0)
    records = closed_loops(truth, 2, first=3)
    start = TRUTH.replace(known={"position_noise": (0.0, 5000.0)})
    found = maximum_likelihood(records, start, improve_start=False)
    error = found.standard_error("position_noise")
    assert error < 1000
    assert abs(found["position_noise"] - 4000) < 3 * error
    assert abs(found["measurement_noise"] / 4e-12 - 1) < 3 * found.errors[-3]
    low, high = found.interval("position_noise")
    assert low > 0
    assert high < 8000
