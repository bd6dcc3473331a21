"""A machine with one axis flies as the axis: its straight-line filter in the same loop."""

import numpy as np
import pytest
from golden.axes import AXES, _scenario

import ambkit
from ambkit.simulation.fields import InLoops
from ambkit.simulation.run import Loop

CASES = AXES | {"eddy currents": AXES["paper"].replace(magnet__eddy_current_lag="0.3 ms")}


@pytest.mark.parametrize("name", CASES)
def test_loops_over_the_pattern_fly_as_the_straight_line(name):
    """With the same noise."""
    axis = machine = CASES[name]
    scenario = _scenario(axis, "estimate", False)
    loop = Loop(machine, scenario, estimator=ambkit.KalmanFilter(axis))
    one, (r, load) = loop.run().record, loop.series
    kalman = ambkit.KalmanFilter(machine)
    form = InLoops(machine, scenario, kalman, r[0], load[0], 0.0, [scenario.controller])
    kalman.reset(np.ravel(kalman.equilibrium_state(form.place, current=form.current)))
    core = kalman.engine.core
    out = core.simulate(
        **form.arguments(core, kalman, None), estimator=kalman.core, r=r, load=load,
        **dict(zip(("noise_u", "noise_y"), loop.noise, strict=True)), speed=np.zeros(len(r) + 1),
    )  # fmt: skip
    found = {"x": form.moved(out["X"]), "iu": out["iu"], "u": out["u"], "y": out["y"]}
    for signal, values in found.items():
        scale = np.abs(one[signal]).max()
        assert np.abs(one[signal] - np.ravel(values)).max() < 1e-11 * scale, signal
