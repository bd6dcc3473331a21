"""Filters of machines, tuned by records or truth, below a peak of the sensitivity."""

import math
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit import FilterNoise, KalmanFilter, Machine
from ambkit.base.errors import AmbkitError
from ambkit.judge.comparison.tuning import candidate_of_kind
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario
from ambkit.workflow.tuning import log_likelihood
from ambkit.workflow.tuning_tasks import _with_few_modes

TUM = Machine.preset("tum_mlps")


@pytest.fixture(scope="module")
def record():
    return simulate_run(TUM, Scenario(duration=0.4)).record


def test_variances_of_axes_keep_their_ratios():
    candidate = candidate_of_kind("linear", TUM, all_noise=True)
    own = KalmanFilter(TUM).variances
    (growth,) = (each for each in candidate.tunable if each.name == "noise.disturbance")
    assert growth.default == pytest.approx(np.exp(np.mean(np.log(own.disturbance))))
    made = candidate.build(**{"noise.disturbance": 3 * growth.default}).variances
    assert made.disturbance == pytest.approx([3 * each for each in own.disturbance])
    assert made.measurement == own.measurement
    assert candidate.build(**candidate.defaults).variances.disturbance == pytest.approx(
        own.disturbance
    )
    with pytest.raises(ValueError, match=r"noise.control must be one number or 4, is 2"):
        KalmanFilter(TUM, noise=FilterNoise(control=[1e-6, 1e-6]))
    axis = ambkit.preset("zittau_axial")
    with pytest.raises(ValueError, match=r"noise.control must be one number, is 2"):
        KalmanFilter(axis, noise=FilterNoise(control=[1e-6, 1e-6]))
    assert KalmanFilter(axis, noise=FilterNoise(control=[1e-6])).variances.control == 1e-6


def test_the_likelihood_is_that_of_all_readings(record):
    estimate = KalmanFilter(TUM).run(record)
    e, S = estimate.innovation[5:], estimate.innovation_variance[5:]
    expected = -0.5 * np.sum(np.log(S) + e**2 / S)
    assert log_likelihood(estimate, 5) == pytest.approx(expected, rel=1e-9)
    # Of all scales of R the true one is about the likeliest.
    R = KalmanFilter(TUM).variances.measurement[0]
    scales = np.geomspace(0.25, 4, 9)
    told = [
        log_likelihood(KalmanFilter(TUM, noise=FilterNoise(measurement=k * R)).run(record), 500)
        for k in scales
    ]
    assert 0.7 < scales[int(np.argmax(told))] < 1.5


@pytest.mark.long
def test_a_records_likelihood_tunes_below_a_ceiling(record):
    free = ambkit.tune(TUM, record, "linear", budget=8)
    assert free.peak > free.peaks[0]  # a load that rests: slower, and with less margin
    held = ambkit.tune(TUM, record, "linear", budget=8, max_sensitivity=1.8)
    assert held.peak < 1.8
    assert (
        free.unseen["negative log-likelihood per sample"][1]
        <= (held.unseen["negative log-likelihood per sample"][1])
    )
    assert len(free.estimator.variances.disturbance) == 4


def test_what_margin_costs_a_machine():
    traded = ambkit.tune_trade_off(TUM, peaks=[1.72, 2.2], filter="linear", seeds=2, budget=8)
    low, high = traded.points
    assert low.peak < 1.72
    assert high.peak < 2.2
    assert high.errors["f_d"] < low.errors["f_d"]
    assert len(traded.figure().panels) == 2
    assert math.isfinite(high.errors["x"])


def test_what_cannot_be_tuned_is_refused(record):
    with pytest.raises(AmbkitError, match="takes one axis"):
        ambkit.tune(TUM, record, "observer")
    one = ambkit.simulate(ambkit.preset("zittau_axial")).record
    with pytest.raises(AmbkitError, match="the record has no y_"):
        ambkit.tune(TUM, one, "linear")


def test_one_expert_is_kept_for_all_bearings(call):
    """The filter's file names the expert that it was tuned with, and reads it back."""
    ambkit.train(TUM.isolated_axis("A1")).expert.save("expert.json")
    few = ("--budget", "1", "--seeds", "1", "--max-sensitivity", "2")
    done = call(
        "tune", "tum_mlps", "--filter", "adaptive@expert.json", *few, "--out", "filter.toml"
    )
    assert done.code == 0, done.err
    read = ambkit.FilterFile.load("filter.toml")
    assert {Path(each.file).name for each in read.magnets.values()} == {"expert.json"}
    assert list(read.magnets) == [each.name for each in TUM.bearings]
    assert len(read.make().magnet.models) == 4


@pytest.mark.parametrize(("arguments", "code", "message"), [
    (["tune", "tum_mlps", "--filter", "linear", "--budget", "3", "--seeds", "1"], 0,
     "Peak of |S| in the loop"),
    (["tune", "tum_mlps", "--filter", "low-pass"], 2, "takes one axis"),
])  # fmt: skip
def test_commands(arguments, code, message, call):
    told = call(*arguments)
    assert told.code == code, told.err
    assert message in " ".join((told.out + told.err).split())


def test_the_same_filter_of_another_machine_keeps_its_noise():
    still = TUM.model_copy(update={"speed": 0.0})
    noise = FilterNoise(measurement=1e-12)
    for made in (KalmanFilter(TUM, noise=noise), KalmanFilter(machine=TUM, noise=noise)):
        other = made.for_machine(still)
        assert other.machine == still
        assert other.variances == made.variances
    around = ambkit.AdaptiveNoise(made, memory=0.2)
    assert around.for_machine(still).nominal.machine == still
    assert around.for_machine(still).options["memory"] == 0.2


def test_a_search_leaves_out_modes_beyond_the_range_of_the_standard():
    rotor = Machine.preset("compressor").rotor.model_copy(update={"modes_up_to": 9000.0})
    many = Machine.preset("compressor").model_copy(update={"rotor": rotor})
    found = _with_few_modes(many)
    assert len(found.bending.frequency) < len(many.bending.frequency)
    assert _with_few_modes(found) is found
