"""What a filter's force law leaves out stands in its covariance, by one text in Python and C."""

import numpy as np
import pytest

import ambkit
from ambkit import Scenario, Step
from ambkit.estimate.estimate import packed
from ambkit.estimate.law_error import law_errors
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison.default_study import CONSISTENT, score_defaults
from ambkit.machine.axes import isolated_axes
from ambkit.machine.magnets import ConstantStiffness, evaluate_force, magnet_of
from benchmarks.sensors import drawn

MACHINES = ("zittau_axial", "inteco_ml", "tum_mlps", "heart_pump")


@pytest.mark.parametrize("name", MACHINES)
def test_it_is_the_difference_of_the_laws(name):
    """To the digits that are kept, wherever a rotor can be."""
    machine = ambkit.preset(name)
    rows = ambkit.KalmanFilter(machine).law_error.reshape(-1, 22)
    for axis, row in zip(isolated_axes(machine), rows, strict=True):
        span = np.linspace(-0.9, 0.9, 8)
        i, x = (a.ravel() for a in np.meshgrid(span, span))
        i = np.where(i < 0, -axis.current_min, axis.current_max) * i
        x = axis.clearance * x
        known, true = ConstantStiffness.of(axis), magnet_of(axis)
        error = evaluate_force(known, i, x) - evaluate_force(true, i, x)
        terms = ((p, q) for p in range(5, -1, -1) for q in range(5 - p, -1, -1))
        fitted = sum(c * i**p * x**q for c, (p, q) in zip(row[:-1], terms, strict=True))
        fitted /= (1 - row[-1] * x**2) ** 2
        assert np.abs(fitted - error).max() <= 1e-4 * np.abs(error).max()


def test_a_filter_with_the_machines_law_has_none():
    machine = ambkit.preset("zittau_axial")
    for kind in ("extended", "closed-law", "low-pass", "constant-velocity"):
        assert not KINDS[kind].make(machine).law_error.size, kind
    assert not law_errors(machine, magnet_of(machine)).size


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_covariance_and_deviation_are_one_statement(name, precision):
    """Along a record and step by step alike; the gain does not know of it."""
    machine = ambkit.preset(name)
    step = Step(amplitude=0.2 * isolated_axes(machine)[0].clearance, time=0.01)
    parts = {"reference": step} if machine.single else {}
    record = ambkit.simulate(machine, Scenario(duration=0.03, seed=1, **parts)).record
    kf = ambkit.KalmanFilter(machine, precision=precision)
    estimate = kf.run(record, covariance=True)
    live, raw, n = kf.covariance, kf.core.covariance, len(kf.states)
    for k, state in enumerate(kf.states):
        assert estimate.covariance[-1, packed(k, k, n)] == live[k, k]
        assert estimate.std(state.name)[-1] == np.sqrt(live[k, k])
    bias = kf._bias(raw)
    assert bias.any()
    assert np.array_equal(live, raw + np.outer(bias, bias))


@pytest.mark.parametrize("kind", ["linear", "observer", "linear-adaptive-noise"])
def test_it_is_carried_from_sample_to_sample(kind):
    """Asked for after every step it is that of the record; asked for once, that at rest."""
    machine = ambkit.preset("zittau_axial")
    record = ambkit.simulate(machine, Scenario(duration=0.03, seed=1)).record
    often, once = (KINDS[kind].make(machine) for _ in range(2))
    along = often.run(record, covariance=True).covariance[:, packed(1, 1, len(often.states))]
    for kf in (often, once):
        kf.reset(kf.initial_state(record["y"]))
        kf.update(record["y"][0])
    assert often.covariance[1, 1] == along[0]
    for k, (y, u) in enumerate(zip(record["y"][1:], record["u"][:-1], strict=True), 1):
        for kf in (often, once):
            kf.step(y, u)
        assert often.covariance[1, 1] == along[k]
    assert once.covariance[1, 1] == once.core.covariance[1, 1] < along[-1]


@pytest.mark.parametrize("seed", [20032, 20090])
@pytest.mark.parametrize("kind", ["linear", "observer"])
def test_stated_errors_hold_where_the_velocity_is_off(seed, kind):
    """With the bias at rest alone 82 to 86 % of the samples were within their bound."""
    machine = drawn(seed)
    score = score_defaults(machine, (kind,), seed=seed, tune=())
    assert CONSISTENT[0] <= score.nees[kind] <= CONSISTENT[1]
