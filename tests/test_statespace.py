"""The linearised bearing for python-control, held against control's own answers and the loop."""

import control
import numpy as np
import pytest

from ambkit import Control, KalmanFilter, Scenario, Step, magnet_of, simulate, to_control
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.export import statespace

LOOPS = [
    Control(kp=3000.0, ki=20000.0, kd=12.0, setpoint_weight=0.7, feedback="estimate"),
    Control(kp=3000.0, ki=20000.0, kd=12.0, feedback="measurement", derivative_filter=3e-4),
]


@pytest.fixture(scope="module")
def stiffness(bearing):
    return [float(k) for k in magnet_of(bearing).tangent(*OperatingPoint.equilibrium(bearing)[:2])]


def test_poles_of_the_plant_are_those_of_the_unstable_rotor_and_the_sensor(bearing, stiffness):
    own = np.sqrt(stiffness[1] / bearing.rotor.mass)
    found = np.sort(to_control(bearing).poles().real)
    assert found == pytest.approx([-1 / bearing.sensor.lag, -own, own], rel=1e-12)
    sampled = np.sort(to_control(bearing, sampled=True).poles().real)
    assert sampled == pytest.approx(np.exp(found * bearing.sampling_time), rel=1e-12)


def test_transfer_from_u_to_the_measurement(bearing, stiffness):
    b = bearing.replace(amplifier__bandwidth=2000.0)
    s = 1j * np.logspace(0, 5, 50)
    by_hand = stiffness[0] * b.amplifier.gain / (b.rotor.mass * s**2 - stiffness[1])
    by_hand *= b.sensor.gain / (1 + b.sensor.lag * s) / (1 + s / (2 * np.pi * 2000))
    assert to_control(b)["y", "u"](s) == pytest.approx(by_hand, rel=1e-9)


def test_sampled_with_hold_it_is_controls_own(bearing):
    ours = to_control(bearing, sampled=True)
    theirs = control.c2d(to_control(bearing), bearing.sampling_time, "zoh")
    z = np.exp(1j * np.linspace(0.001, np.pi, 100))
    assert ours(z) == pytest.approx(theirs(z), rel=1e-8, abs=1e-8 * np.abs(theirs(-1)).max())


@pytest.mark.parametrize("share", [0.25, 1.0, 1.5, 3.0])
def test_dead_time_of_any_fraction(bearing, share):
    """Whole samples are z^-1; the rest is a plant whose hold is split within the sample."""
    T, whole = bearing.sampling_time, int(np.floor(share))
    found = to_control(bearing.replace(delay=share * T))["y", "u"]
    plant, rest = to_control(bearing)["y", "u"], (share - whole) * T
    z = np.exp(1j * np.linspace(0.001, np.pi, 100))
    after = control.c2d(plant, T - rest, "zoh")
    step = control.c2d(plant, T, "zoh")
    late = step.B - after.B  # what the control of the sample before leaves
    by_hand = [
        (step.C @ np.linalg.solve(at * np.eye(3) - step.A, after.B + late / at)).item() for at in z
    ]
    assert found(z) == pytest.approx(np.array(by_hand) * z**-whole, rel=1e-8)


@pytest.mark.parametrize("pid", LOOPS, ids=lambda p: p.feedback)
def test_closed_loop_is_controls_own_feedback(bearing, pid):
    """Built here as one matrix; there as G / (1 + G C) from control's own plant."""
    plant = to_control(bearing)
    s = 1j * np.logspace(0, 4, 40)
    x = plant["x", "u"](s) / bearing.amplifier.gain
    if pid.feedback == "estimate":
        seen, derivative = x, pid.kd * s
    else:
        seen = plant["y", "u"](s) / bearing.amplifier.gain / bearing.sensor.gain
        derivative = pid.kd * s / (1 + pid.derivative_filter * s)
    weight = pid.completed(bearing).setpoint_weight
    ahead, asked = pid.kp + pid.ki / s, weight * pid.kp + pid.ki / s
    assert weight < 1
    expected = x * asked / (1 + seen * (ahead + derivative))
    assert to_control(bearing, pid)["x", "r"](s) == pytest.approx(expected, rel=1e-8)
    assert (to_control(bearing, pid).poles().real < 0).all()


@pytest.mark.parametrize("pid", LOOPS, ids=lambda p: p.feedback)
def test_step_response_is_that_of_the_simulated_loop(bearing, pid):
    """At a small step the nonlinear, sampled loop is near the linear, continuous one."""
    size = 1e-6
    fine = bearing.replace(sampling_time=1e-5)
    start = Scenario(
        duration=0.05, reference=Step(amplitude=size, time=1e-5), controller=pid, noise=False
    )
    record = simulate(fine, start).record
    response = control.step_response(to_control(bearing, pid)["x", "r"], record.t[:-1])
    linear = size * np.asarray(response.outputs)
    assert np.max(np.abs(record["x"][1:] - linear)) < 0.03 * np.max(linear)


@pytest.mark.parametrize("fed", ["measurement", "estimate"])
def test_sampled_step_response_is_that_of_the_simulated_loop(bearing, fed):
    """With delay, amplifier and filter: where the step is small, to a thousandth."""
    whole = bearing.replace(delay=1.5e-4, amplifier__bandwidth=2000.0)
    pid = LOOPS[1].model_copy(update={"feedback": fed})
    filter = KalmanFilter(whole, **SURE) if fed == "estimate" else None
    size = 1e-6
    start = Scenario(
        duration=0.1, reference=Step(amplitude=size, time=0.05), controller=pid, noise=False,
        substeps=20,
    )  # fmt: skip
    record = simulate(whole, start, filter=filter).record
    late = record.t >= 0.05
    t = record.t[late] - record.t[late][0]
    response = control.step_response(to_control(whole, pid, filter)["x", "r"], t)
    linear = size * np.asarray(response.outputs)
    moved = record["x"][late] - record["x"][late][0]
    assert np.max(np.abs(moved - linear)) < 2e-3 * np.max(linear)


SURE = {"frozen_limit": 0}


def test_names_and_units(bearing):
    system = to_control(bearing.replace(delay=1e-4), LOOPS[0], KalmanFilter(bearing))
    assert system.dt == bearing.sampling_time
    assert system.input_labels == ["n_y", "f_d", "n_u", "r"]
    assert system.output_labels == ["y", "x", "u"]
    assert system.units["u"] == "V"
    assert system.units["f_d"] == "N"
    assert set(system.state_labels) <= set(system.units)


def test_controller_and_estimator_join_to_the_loop(bearing):
    """Control's own interconnection of the three pieces is the closed loop that ambkit builds."""
    filter, pid = KalmanFilter(bearing), LOOPS[0]
    joined = control.interconnect(
        [
            to_control(bearing, sampled=True),
            statespace.controller(bearing, pid),
            statespace.estimator(filter),
        ],
        inputs=["r", "f_d"], outputs=["x"],
    )  # fmt: skip
    whole = to_control(bearing, pid, filter)
    z = np.exp(1j * np.linspace(0.01, 3, 40))
    for name in ("r", "f_d"):
        expected = joined["x", name](z)
        assert whole["x", name](z) == pytest.approx(expected, rel=1e-8)


def test_what_has_no_continuous_state_space_is_refused(bearing):
    with pytest.raises(AmbkitError, match="derivative_filter"):
        statespace.closed_loop(bearing, Control(feedback="measurement", derivative_filter=0.0))
    with pytest.raises(AmbkitError, match="a delay has no continuous"):
        to_control(bearing.replace(delay=1e-4), sampled=False)
    with pytest.raises(AmbkitError, match="a filter has no continuous"):
        to_control(bearing, LOOPS[0], KalmanFilter(bearing), sampled=False)
    with pytest.raises(AmbkitError, match="give pid"):
        to_control(bearing, filter=KalmanFilter(bearing))
