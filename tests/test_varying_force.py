"""A bending rotor and a current that lags: the force varies within a sample."""

import numpy as np
import pytest

import ambkit
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import KINDS
from ambkit.judge.comparison import criteria
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.linear import linearised
from ambkit.models.machine_parts import machine_model, machine_parts
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario


@pytest.mark.parametrize("lag", [None, "20 us"])
@pytest.mark.parametrize("bandwidth", [None, "2 kHz"])
@pytest.mark.parametrize("delay", [None, "0.03 ms"])
def test_current_within_a_sample(delay, bandwidth, lag):
    """Without position stiffness, model and linear law are the exact sampled machine."""
    machine = ambkit.Machine.preset("compressor").replace(delay=delay)
    bearings = machine.model_dump()["bearing"]
    for one in bearings:
        one["amplifier"]["bandwidth"], one["magnet"]["eddy_current_lag"] = bandwidth, lag
    machine = machine.replace(bearing=bearings)
    k_i = np.array([ConstantStiffness.of(machine.isolated_axis(a.name)).k_i for a in machine.axes])
    model = machine_model(machine)
    exact = linearised(machine_parts(machine), machine.sampling_time, k_i, np.zeros_like(k_i))
    loads = [at.role == "disturbance force" for at in model.states]
    moving = np.flatnonzero(~np.array(loads))
    L = model.L + model.b @ (k_i[:, None] * model.e)
    B_u = model.B_u + model.b @ (k_i[:, None] * model.d)
    scale = np.array([model.states[k].size for k in moving])
    error = (L[np.ix_(moving, moving)] - exact.A) * scale / scale[:, None]
    assert np.abs(error).max() < 1e-9
    by_control = (B_u[moving] - exact.B[:, : len(k_i)]) / scale[:, None]
    assert np.abs(by_control).max() < 1e-9


@pytest.mark.parametrize("kind", ["extended", pytest.param("linear", marks=pytest.mark.long)])
def test_bending_modes_are_as_well_known_as_stated(kind):
    """The NEES of a machine whose fifth mode turns by more than a radian in a sample."""
    machine = ambkit.Machine.preset("compressor").model_copy(update={"unbalance": ()})
    walk = [1e-4 * (machine.rotor.mass * 9.81) ** 2] * len(machine.axes)
    n, T = 1501, machine.sampling_time
    steps = np.random.default_rng(5).normal(size=(n, len(walk)))
    load = np.cumsum(steps, axis=0) * np.sqrt(np.array(walk) * T)
    estimator = KINDS[kind].make(machine, noise=FilterNoise(disturbance=tuple(walk)))
    run = simulate_run(
        machine,
        Scenario(duration=(n - 1) * T, seed=0, controller={"feedback": "measurement"}),
        estimator=estimator,
        external_inputs=ExternalInputs(disturbance=load),
    )
    estimate = estimator.run(run.record, covariance=True)
    assert criteria.nees(estimate, run.record, 375, estimator.view) > 0.93
