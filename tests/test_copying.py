"""Copies and pickles of estimators go on from where the original is, and alone."""

import copy
import pickle

import numpy as np
import pytest

import ambkit
from ambkit.estimate.registry import KINDS

COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda each: pickle.loads(pickle.dumps(each)),
}


@pytest.fixture(scope="module")
def record(bearing):
    step = ambkit.Step(amplitude=0.3e-3, time=5e-3)
    return ambkit.simulate(bearing, ambkit.Scenario(duration=0.04, reference=step)).record


@pytest.fixture(scope="module")
def stiffness(bearing):
    return ambkit.stiffness_map(bearing)


def stepped(estimator, record, samples):
    y, u = record["y"], record["u"]
    return np.array([estimator.step(y[k], u[k]) for k in samples])


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("kind", KINDS)
def test_a_copy_goes_on_as_the_original_would(bearing, record, stiffness, kind, precision):
    magnet = stiffness if KINDS[kind].magnet is None else None
    original = KINDS[kind].make(bearing, magnet, precision=precision)
    stepped(original, record, range(200))
    copies = {how: made(original) for how, made in COPIES.items()}
    for other in copies.values():
        assert (other.status, other.innovation) == (original.status, original.innovation)
        assert np.array_equal(other.covariance, original.covariance)
    expected = stepped(original, record, range(200, 400))
    for how, other in copies.items():
        assert type(other) is type(original)
        assert np.array_equal(stepped(other, record, range(200, 400)), expected), how


@pytest.mark.parametrize("how", COPIES)
def test_what_a_copy_does_leaves_the_original_alone(bearing, how):
    original = ambkit.ExtendedKalmanFilter(bearing)
    before, live = original.step(1e-5, 0.1), original.core.state
    other = COPIES[how](original)
    assert not np.array_equal(other.step(3e-5, -0.2), before)
    assert original.core.state == live
    assert np.array_equal(original.mean, before)


def test_a_copy_keeps_what_was_set_on_it(bearing):
    original = ambkit.KalmanFilter(bearing)
    original.name = "upper bearing"
    assert {made(original).name for made in COPIES.values()} == {"upper bearing"}


@pytest.mark.parametrize("of", [ambkit.Adaline, ambkit.RecursiveLeastSquares])
def test_a_learner_is_copied_with_what_it_has_learned(bearing, record, of):
    original = of(bearing, start=6e-6)
    y, u = record["y"], record["u"]
    for k in range(300):
        original.step(y[k], u[k])
    copies = [made(original) for made in COPIES.values()]
    expected = [original.step(y[k], u[k]) for k in range(300, 400)]
    for other in copies:
        assert [other.step(y[k], u[k]) for k in range(300, 400)] == expected


def test_the_state_of_another_version_is_refused(bearing, monkeypatch):
    kept = pickle.dumps(ambkit.KalmanFilter(bearing))
    monkeypatch.setattr("ambkit.base.pickling.own_version", lambda: "99.0")
    with pytest.raises(ValueError, match=r"pickled by ambkit .*, this is 99\.0; make it anew"):
        pickle.loads(kept)


def test_the_state_of_another_kind_is_refused(bearing):
    linear, k = ambkit.KalmanFilter(bearing), ambkit.AugmentedKalmanFilter(bearing)
    with pytest.raises(ValueError, match=r"a state has .* bytes, expected"):
        linear.core.state = k.core.state


# Complex numbers


def refused_complex(name):
    return pytest.raises(ValueError, match=f"{name} must hold real numbers, holds complex128")


def test_complex_arrays_are_refused_everywhere(bearing, record):
    kalman = ambkit.KalmanFilter(bearing)
    y = record["y"] + 0j
    with pytest.raises(ambkit.RecordError, match="signal y holds complex numbers"):
        ambkit.Record(record.t, {"y": y}, {"y": "m"})
    with pytest.raises(ambkit.RecordError, match="signal t holds complex numbers"):
        ambkit.Record(record.t + 0j, {"y": record["y"]}, {"y": "m"})
    with refused_complex("mean"):
        kalman.reset([0, 0, 1j, 0])
    with refused_complex("std"):
        kalman.reset([0, 0, 0, 0], [1, 1, 1, 1 + 0j])
    with refused_complex("y"):
        ambkit.run_many(kalman, y, record["u"])
    with refused_complex("u"):
        ambkit.run_many(kalman, record["y"], record["u"] + 0j)
    with refused_complex("truth"):
        ambkit.run_many(kalman, record["y"], record["u"], truth=np.zeros((len(y), 3), complex))
    with refused_complex("start mean"):
        start = np.zeros(4, complex), np.ones(4)
        ambkit.run_many(kalman, record["y"], record["u"], start=start)
    with refused_complex("iu"):
        ambkit.ClosedLaw(bearing).force(1j, 0.0)
    with refused_complex("t"):
        ambkit.Step(amplitude=1.0).sample([0j, 1.0])
    with refused_complex("disturbance"):
        ambkit.Adaline(bearing).run(record, disturbance=1j)
    with pytest.raises(TypeError):
        kalman.step(1j, 0.0)


def test_a_filter_names_its_machine():
    bearing = ambkit.preset("zittau_axial")
    assert repr(ambkit.KalmanFilter(bearing)) == "<KalmanFilter of zittau_axial>"
