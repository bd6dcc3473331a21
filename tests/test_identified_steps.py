"""Steps of a sensor that a record shows reach the bearing that is identified, and its filter."""

import pytest

import ambkit
from ambkit.identification.maximum_likelihood.estimate import maximum_likelihood
from ambkit.identification.noise import position_step, with_steps
from ambkit.simulation.run import simulate_run

BEARING = ambkit.preset("zittau_axial").replace(sensor__noise_variance=1e-14)


def recorded(step):
    true = BEARING if step is None else BEARING.replace(sensor__quantisation=step)
    return simulate_run(true, ambkit.Scenario(duration=0.3, seed=1)).record


def test_steps_of_three_standard_deviations_and_the_noise_below_them():
    record = recorded(3e-7)
    found = maximum_likelihood(record, BEARING, ["measurement_noise"], improve_start=False)
    sensor = found.isolated.sensor
    assert sensor.quantisation == pytest.approx(3e-7)
    assert sensor.noise_variance**0.5 == pytest.approx(1e-7, rel=0.1)
    written = ambkit.ExtendedKalmanFilter(found.isolated).core.parameters["set"]
    assert written["step"][0] == pytest.approx(3e-7)


def test_what_has_no_steps_or_has_them_stated_stays():
    assert with_steps(BEARING, position_step([recorded(None)])) == BEARING
    stated = BEARING.replace(sensor__quantisation=1e-7)
    assert with_steps(stated, 3e-7, has_noise=False) == stated
