"""Lines in the measured position: found where they are, and not where they are not."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine, Scenario, Sine, simulate
from ambkit.identification.maximum_likelihood import line_noise, maximum_likelihood
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.machine.accessories import Hum

BALL = Machine.preset("inteco_ml").replace(sensor__noise_variance="9e-12 m^2")
LINES = [{"frequency": f, "amplitude": "25 um"} for f in ("170 Hz", "230 Hz")]
HUMMING = BALL.replace(sensor__hum=LINES)
FREE = ("magnet_constant", "measurement_noise", "control_noise", "disturbance_noise")


def run(plant, seed, duration):
    reference = Sine(amplitude=1e-3, frequency=0.7)
    return simulate(plant, Scenario(duration=duration, seed=seed, reference=reference)).record


def found_of(record, known=BALL, *, lines=False):
    start = LoopModel(known, disturbance_noise=1e-4, substeps=1)
    return maximum_likelihood(
        record, start, FREE, improve_start=False, profile=False, lines=lines
    )  # fmt: skip


def error(found, record, ahead):
    miss = record["y"][ahead:] - found.model.predict(record, ahead)
    return float(np.sqrt(np.mean(miss[500:] ** 2)))


def test_two_lines_are_found_and_taken_out_of_the_prediction():
    found = found_of(run(HUMMING, 1, 3.0), lines=True)
    for line, true in zip(sorted(found.lines, key=lambda h: h.frequency), (170, 230), strict=True):
        assert line.frequency == pytest.approx(true, abs=0.05)
        assert line.amplitude == pytest.approx(25e-6, rel=0.1)
    other = run(HUMMING, 101, 3.0)
    held = float(np.sqrt(np.mean(np.diff(other["y"])[500:] ** 2)))
    assert error(found, other, 1) < held / 4
    # What filters of the bearing carry, and its C.
    states = [s.name for s in ambkit.ExtendedKalmanFilter(found.isolated).states]
    assert {"hum_c", "hum_s", "hum2_c", "hum2_s"} < set(states)
    assert [h["frequency"] for h in found.to_dict()["lines"]] == [h.frequency for h in found.lines]


def test_a_line_that_the_likelihood_hardly_gains_by_is_not_taken_in(monkeypatch):
    """Whatever the periodogram says: three figures more are likelier by chance alone."""
    monkeypatch.setattr(
        line_noise, "_candidate",
        lambda records, model: Hum(frequency=190.0, amplitude=3e-7, bandwidth=0.1),
    )  # fmt: skip
    record = run(BALL, 3, 1.0)
    found = found_of(record)
    model = line_noise.with_lines(Data([record], found.settling), found.model, [])
    assert model == found.model


@pytest.mark.study
def test_with_lines_it_is_nearly_as_good_as_the_filter_that_knows_and_without_no_worse():
    for seed in (1, 2):
        record, other = run(HUMMING, seed, 8.0), run(HUMMING, seed + 100, 8.0)
        found, knows = found_of(record, lines=True), found_of(record, HUMMING)
        assert error(found, other, 10) < 1.1 * error(knows, other, 10)
    for seed in range(20):
        quiet = found_of(run(BALL, seed, 4.0), lines=True)
        assert not quiet.lines
