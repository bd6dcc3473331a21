"""The linearised bearing for python-control, held against control's own answers and the loop."""

import control
import numpy as np
import pytest

from ambkit import PID, Bearing, Scenario, Step, simulate, to_control
from ambkit.base.errors import AmbkitError
from ambkit.export import statespace
from ambkit.machine.magnets import ConstantStiffness

LOOPS = [
    PID(kp=3000.0, ki=20000.0, kd=12.0, feedback="estimate"),
    PID(kp=3000.0, ki=20000.0, kd=12.0, feedback="measurement", derivative_filter=3e-4),
]


@pytest.fixture(scope="module")
def bearing():
    return Bearing.preset("zittau_axial")


def test_poles_of_the_plant_are_those_of_the_unstable_rotor_and_the_sensor(bearing):
    k = ConstantStiffness.of(bearing)
    own = np.sqrt(k.k_s / bearing.rotor.mass)
    found = np.sort(to_control(bearing).poles().real)
    assert found == pytest.approx([-1 / bearing.sensor.lag, -own, own], rel=1e-12)


def test_transfer_from_u_to_the_measurement(bearing):
    k, b = ConstantStiffness.of(bearing), bearing
    s = 1j * np.logspace(0, 5, 50)
    by_hand = k.k_i * b.amplifier.gain / (b.rotor.mass * s**2 - k.k_s)
    by_hand *= b.sensor.gain / (1 + b.sensor.lag * s)
    assert to_control(b)["x_m", "u"](s) == pytest.approx(by_hand, rel=1e-9)


@pytest.mark.parametrize("pid", LOOPS, ids=lambda p: p.feedback)
def test_closed_loop_is_controls_own_feedback(bearing, pid):
    """Built here as one matrix; there as G / (1 + G C) from control's own plant."""
    plant = to_control(bearing)
    s = 1j * np.logspace(0, 4, 40)
    x = plant["x", "u"](s) / bearing.amplifier.gain
    if pid.feedback == "estimate":
        seen, derivative = x, pid.kd * s
    else:
        seen = plant["x_m", "u"](s) / bearing.amplifier.gain / bearing.sensor.gain
        derivative = pid.kd * s / (1 + pid.derivative_filter * s)
    ahead = pid.kp + pid.ki / s
    expected = x * ahead / (1 + seen * (ahead + derivative))
    assert to_control(bearing, pid)["x", "r"](s) == pytest.approx(expected, rel=1e-8)
    assert (to_control(bearing, pid).poles().real < 0).all()


@pytest.mark.parametrize("pid", LOOPS, ids=lambda p: p.feedback)
def test_step_response_is_that_of_the_simulated_loop(bearing, pid):
    """At a small step the nonlinear, sampled loop is near the linear, continuous one."""
    size = 1e-6
    # Without weight it hovers at iu = 0, where the linear model is taken.
    fine = bearing.replace(sampling_time=1e-5, rotor__gravity="none")
    start = Scenario(
        duration=0.05, reference=Step(amplitude=size, time=1e-5), controller=pid, noise=False
    )
    record = simulate(fine, start)
    response = control.step_response(to_control(bearing, pid)["x", "r"], record.t[:-1])
    linear = size * np.asarray(response.outputs)
    assert np.max(np.abs(record["x"][1:] - linear)) < 0.03 * np.max(linear)


def test_a_measured_loop_without_derivative_filter_is_refused(bearing):
    with pytest.raises(AmbkitError, match="derivative_filter"):
        statespace.closed_loop(bearing, PID(feedback="measurement", derivative_filter=0.0))
