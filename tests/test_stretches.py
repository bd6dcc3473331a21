"""A loop in stretches, and filters that take over from others in flight."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine
from ambkit.estimate.registry import KINDS
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import Loop, samples, simulate_run

BEARING = Machine.preset("zittau_axial")
STEP = ambkit.Scenario(
    duration=0.1,
    reference=ambkit.Step(amplitude=3e-4, time=0.01),
    disturbance=ambkit.Step(amplitude=-3.0, time=0.05),
)
CUTS = (0.0123, 0.05, 0.0777, None)
PLAIN = ("linear", "closed-law", "extended", "unscented")


def make(kind, k=1.0):
    constant = k * BEARING.magnet.magnet_constant
    return KINDS[kind].make(BEARING.replace(magnet__magnet_constant=constant), None)


def simulated(loop, change=False):
    """States of plant and filter along the stretches; at each cut another filter takes over."""
    runs = []
    for until in CUTS:
        runs.append(loop.run(until))
        if change:
            new = type(loop.estimator)(BEARING, loop.estimator.magnet)
            new.transfer_from(loop.estimator)
            loop.estimator = new
    rows = [np.column_stack([r.record[s] for s in ("x", "v", "y", "u", "f_mag")]) for r in runs]
    return np.concatenate(rows), np.concatenate([r.estimate.mean for r in runs])


@pytest.mark.parametrize("kind", ["linear", "ud", "multiple-model"])
def test_a_run_in_stretches_is_the_run_in_one_go(kind):
    drift = ExternalInputs(magnet_scale=np.linspace(1, 0.9, samples(BEARING, STEP)))
    whole = simulate_run(BEARING, STEP, estimator=make(kind), external_inputs=drift)
    truth, mean = simulated(Loop(BEARING, STEP, estimator=make(kind), external_inputs=drift))
    for column, name in enumerate(("x", "v", "y", "u", "f_mag")):
        assert np.array_equal(truth[:, column], whole.record[name])
    assert np.array_equal(mean, whole.estimate.mean)


@pytest.mark.parametrize("kind", [*PLAIN, "ud"])
def test_a_twin_that_takes_over_changes_no_bit(kind):
    twin = simulated(Loop(BEARING, STEP, estimator=make(kind)), change=True)
    one = simulated(Loop(BEARING, STEP, estimator=make(kind)))
    assert np.array_equal(twin[0], one[0])
    assert np.array_equal(twin[1], one[1])


def test_mean_covariance_and_counts_carry_over_between_kinds():
    record = simulate_run(BEARING, STEP, estimator=make("linear")).record
    old = make("linear")
    old.run(record)
    old.step(float("nan"), 0.0)  # a status to be taken over
    for kind in PLAIN:
        new = make(kind, 0.8)
        new.transfer_from(old)
        assert np.array_equal(new.mean, old.mean)
        assert np.array_equal(new.core.covariance, old.core.covariance)
        assert new.status == old.status
        assert not np.array_equal(new.step(record["y"][-1], 0.1), old.mean)


@pytest.mark.parametrize(
    ("old", "new"), [("linear", "ud"), ("observer", "observer"), ("linear", "augmented")]
)
def test_who_keeps_something_else_does_not_take_over(old, new):
    with pytest.raises(ValueError, match="can take over from each other"):
        make(new).transfer_from(make(old))


def test_refusals():
    with pytest.raises(ValueError, match="one precision, got float64 and float32"):
        make("linear").transfer_from(ambkit.KalmanFilter(BEARING, precision="float32"))
    loop = Loop(BEARING, STEP)
    loop.run(until=0.05)
    with pytest.raises(ValueError, match=r"2 samples or more after 0\.05 s"):
        loop.run(until=0.05)
    loop.run()
    with pytest.raises(ValueError, match=r"the run ends at 0\.1 s; is None"):
        loop.run()
