"""The errors that are predicted before an experiment are those that its estimates then have."""

import numpy as np
import pytest
from scipy.stats import chi2

import ambkit
from ambkit import Machine, Record, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.identification.maximum_likelihood.information import expect
from ambkit.identification.maximum_likelihood.likelihood import (
    BLOCK,
    Data,
    Likelihood,
    between_blocks,
)
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Coordinates, named
from ambkit.machine.magnets import own_time

BEARING = Machine.preset("zittau_axial")
CALM = LoopModel(BEARING, disturbance_noise=1e-4)
FREE = ("magnet_constant", "air_gap", "sensor_lag", "position_offset", "measurement_noise")
SHAKEN = Scenario(
    duration=0.8,
    reference=ambkit.Sine(amplitude=2e-4, frequency=20.0)
    + ambkit.Sine(amplitude=4e-5, frequency=90.0),
    controller=ambkit.PID.textbook(BEARING),
)


def scaled(scenario, by):
    return scenario.replace(
        reference=ambkit.Sine(amplitude=2e-4 * by, frequency=20.0)
        + ambkit.Sine(amplitude=4e-5 * by, frequency=90.0)
    )


def test_predicted_errors_are_the_scatter_of_estimates():
    """One step of Gauss and Newton from the truth, over 60 seeds, against one seed's prediction."""
    parameters = named(FREE)
    coordinates = Coordinates(CALM, parameters)
    predicted = expect(ambkit.simulate(BEARING, SHAKEN.replace(seed=1000)).record, CALM, FREE)
    assert [p.name for p in predicted.parameters] == [p.name for p in parameters]
    assert not predicted.held
    steps = []
    for seed in range(60):
        record = ambkit.simulate(BEARING, SHAKEN.replace(seed=seed)).record
        local = Likelihood(Data([record], 0.01), coordinates).local(np.zeros(len(FREE)))
        steps.append(np.linalg.solve(local.information, local.score))
    found = np.array(steps) * [p.of(CALM) if p.positive else p.coarse(CALM) for p in parameters]
    ratio = found.std(axis=0, ddof=1) / predicted.errors
    low, high = np.sqrt(chi2.ppf([0.0005, 0.9995], 59) / 59)
    assert ((low < ratio) & (ratio < high)).all(), dict(zip(FREE, ratio, strict=True))
    # And they hang together as predicted: k and the gap most of all.
    correlation = np.corrcoef(found.T)
    assert np.abs(correlation - predicted.correlation).max() < 0.45
    assert predicted.correlation[0, 1] > 0.8


def test_what_scores_scatter_by_holds_all_that_correlates_them_within_a_block():
    """Scores that are one for a block each, with its sign: the variance is that of their sums."""
    length = round(BLOCK * own_time(BEARING) / BEARING.sampling_time)
    signs = np.random.default_rng(4).choice([-1.0, 1.0], 100)
    scores = np.repeat(signs, length)[None, :]
    assert between_blocks(scores, BEARING) == pytest.approx(100 * length**2, rel=1e-12)


@pytest.mark.parametrize("name", FREE[:4])
def test_more_excitation_and_more_time_give_smaller_errors(name):
    def error(by, duration=0.8):
        scenario = scaled(SHAKEN, by).replace(duration=duration)
        return expect(ambkit.simulate(BEARING, scenario).record, CALM, FREE)[name]

    assert error(1.0) < error(0.5) < error(0.2)
    assert error(1.0, 3.2) == pytest.approx(error(1.0) / 2, rel=0.2)


def test_what_one_experiment_cannot_tell_is_named():
    """Mass and magnet constant: their ratio alone, but for noises and loads that are forces."""
    record = ambkit.simulate(BEARING, SHAKEN).record
    # The start of the load counts as known to the weight; without noise of the current and without
    # a load nothing has the unit of a force.
    still = BEARING.replace(amplifier__noise_variance="1e-20 V^2")
    silent = LoopModel(still, disturbance_noise=1e-20)
    expectation = expect(record, silent, ("magnet_constant", "mass"))
    assert set(expectation.held) == {"mass"}
    assert "magnet_constant and mass cannot be told apart" in expectation.held["mass"]
    assert expectation["mass"] == np.inf
    assert expectation["magnet_constant"] < 0.01 * BEARING.magnet.magnet_constant


def test_the_certainty_counts_what_cannot_be_told_as_nothing():
    record = ambkit.simulate(BEARING, SHAKEN).record
    one = expect(record, CALM, ("magnet_constant",)).certainty
    both = expect(record, CALM, ("magnet_constant", "current_lag")).certainty
    assert np.isfinite(both)
    assert both == pytest.approx(one, abs=1e-6)  # a lag of zero has no logarithm to move


def test_sensitivity_adds_up_to_the_information():
    record = ambkit.simulate(BEARING, SHAKEN).record
    alone = expect(record, CALM, ("magnet_constant",))
    assert alone.sensitivity.shape == (1, len(record))
    # The noise that enters the variance tells of k as well, but next to nothing.
    assert 1 / np.sqrt(np.sum(alone.sensitivity**2)) == pytest.approx(alone.errors[0], rel=0.01)


def test_a_record_without_measurements_is_reported():
    record = ambkit.simulate(BEARING, SHAKEN.replace(duration=0.05)).record
    nothing = Record(record.t, {"y": np.full(len(record), np.nan), "u": record["u"]})
    with pytest.raises(AmbkitError, match="no measurement"):
        expect(nothing, CALM, FREE)
