"""A machine with one axis flies as the axis: its straight-line filter in the same loop."""

import numpy as np
import pytest
from golden.axes import AXES, _scenario

import ambkit
from ambkit.simulation.machine import simulate_machine
from ambkit.simulation.scenario import Disturbance, Reference, Scenario

CASES = AXES | {"eddy currents": AXES["paper"].replace(magnet__eddy_current_lag="0.3 ms")}


@pytest.mark.parametrize("name", CASES)
def test_a_machine_with_one_axis_flies_as_the_axis(name: str) -> None:
    """With the noise of its own streams, which are those of the axis."""
    axis, machine = CASES[name], CASES[name].long
    scenario = _scenario(axis, "estimate", False)
    flight = Scenario(
        duration=scenario.duration, feedback="estimate",
        disturbance=(Disturbance(axis="", force=scenario.disturbance),),
        reference=(Reference(axis="", position=scenario.reference),),
    )  # fmt: skip
    one = ambkit.simulate_run(axis, scenario, estimator=ambkit.KalmanFilter(axis)).record
    kalman = ambkit.KalmanFilter(machine)
    record = simulate_machine(machine, flight, pids=[scenario.controller], estimator=kalman).record
    for of_axis, of_machine in (("x", "s"), ("x_m", "x_m"), ("iu", "iu"), ("u", "u"), ("y", "y")):
        scale = np.abs(one[of_axis]).max()
        assert np.abs(one[of_axis] - record[of_machine]).max() < 1e-11 * scale, of_axis
