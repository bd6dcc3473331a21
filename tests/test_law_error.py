"""What a filter's force law leaves out stands in its covariance, by one text in Python and C."""

import numpy as np
import pytest

import ambkit
from ambkit import Scenario, Step
from ambkit.estimate.estimate import packed
from ambkit.estimate.law_error import law_errors
from ambkit.estimate.registry import KINDS
from ambkit.machine.axes import isolated_axes
from ambkit.machine.magnets import ConstantStiffness, evaluate_force, magnet_of

MACHINES = ("zittau_axial", "inteco_ml", "tum_mlps")


@pytest.mark.parametrize("name", ["zittau_axial", "heart_pump", "tum_mlps"])
def test_it_is_the_difference_of_the_laws(name):
    """Within a tenth of itself, or a fiftieth of its greatest, wherever a rotor can be."""
    machine = ambkit.preset(name)
    rows = ambkit.KalmanFilter(machine).law_error.reshape(-1, 21)
    for axis, row in zip(isolated_axes(machine), rows, strict=True):
        span = np.linspace(-0.9, 0.9, 8)
        i, x = (a.ravel() for a in np.meshgrid(span, span))
        i = np.where(i < 0, -axis.current_min, axis.current_max) * i
        x = axis.clearance * x
        known, true = ConstantStiffness.of(axis), magnet_of(axis)
        error = evaluate_force(known, i, x) - evaluate_force(true, i, x)
        terms = ((p, q) for p in range(5, -1, -1) for q in range(5 - p, -1, -1))
        fitted = sum(c * i**p * x**q for c, (p, q) in zip(row, terms, strict=True))
        assert (np.abs(fitted - error) <= 0.1 * np.abs(error) + 0.02 * np.abs(error).max()).all()


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
    added = np.diag(live - raw)
    for k, state in enumerate(kf.states):
        assert estimate.covariance[-1, packed(k, k, n)] == live[k, k]
        assert estimate.std(state.name)[-1] == np.sqrt(live[k, k])
        assert (added[k] > 0) == (state.role == "disturbance force")
    assert np.array_equal(live - np.diag(np.diag(live)), raw - np.diag(np.diag(raw)))
