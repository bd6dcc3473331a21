"""Gains of PIDs over the speed of rotation: as data, in the loop, in its margins and in C."""

from itertools import product

import numpy as np
import pytest
from export_cases import BEARING, compiled
from exporting import export_c
from machine_cases import machine
from quick import quick
from test_export_control import run

import ambkit
from ambkit import PID, AmbkitError, Control, KalmanFilter, Scenario
from ambkit.control.pid import GainSchedule, ScheduledGains
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.simulation.waveforms import Constant, Ramp, Step

AT_REST = {
    "kp": 30e3, "ki": 100e3, "kd": 30.0, "derivative_filter": 0.2e-3, "anti_windup": 30e-3,
    "setpoint_weight": 0.5,
}  # fmt: skip
FAST = {"kp": 24e3, "kd": 40.0, "derivative_filter": 0.1e-3}
SCHEDULED = Control(**AT_REST, schedule=[ScheduledGains(speed=400.0, **FAST)])
ONE = machine(speed=600.0)


def between(share):
    """The gains so far from rest to the first speed, of any."""
    gains = {k: (1 - share) * AT_REST[k] + share * v for k, v in FAST.items()}
    return Control(**AT_REST | gains)


def test_it_is_data():
    text = """
    [controller.pid.A1]
    kp = "3000 A/m"
    [[controller.pid.A1.schedule]]
    speed = "6000 rpm"
    kd = "40 A s/m"
    """
    scenario = Scenario.from_toml(text)
    (row,) = scenario.controller.pid["A1"].schedule
    assert row.speed == pytest.approx(200 * np.pi)
    assert (row.kp, row.kd) == (None, 40.0)
    assert Scenario.from_toml(scenario.to_toml()) == scenario


def test_gains_are_linear_between_speeds_and_constant_beyond():
    plain, two = PID(kp=1.0), [ScheduledGains(speed=0, kp=2.0), ScheduledGains(speed=30, kp=5.0)]
    one = [ScheduledGains(speed=10, kp=3.0, ki=9000.0)]
    schedule = GainSchedule.of([plain, PID(kp=1.0, schedule=two), PID(kp=1.0, schedule=one)])
    assert GainSchedule.of([plain]) is None
    np.testing.assert_array_equal(schedule.speeds, [0, 10, 30])
    for speed, kp in ((0, (1, 2, 1)), (-5, (1, 2.5, 2)), (20, (1, 4, 3)), (90, (1, 5, 3))):
        np.testing.assert_allclose(schedule.at(speed)[:, 0], kp, rtol=1e-14)
    np.testing.assert_allclose(schedule.at(5)[:, 1], (7500, 7500, 8250))


@pytest.mark.parametrize(("speed", "share"), [(0.0, 0.0), (100.0, 0.25), (400.0, 1.0), (-900.0, 1)])
@pytest.mark.parametrize("type", ["decentralised", "translation and tilt"])
@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
def test_at_a_speed_it_flies_and_is_assessed_as_the_gains_of_that_speed(
    feedback, type, speed, share
):
    one, update = ONE.replace(speed=speed), {"type": type, "feedback": feedback}
    laws = [law.model_copy(update=update) for law in (SCHEDULED, between(share))]
    step = Step(amplitude=20e-6, time=5e-3)
    scenario = Scenario(duration=0.02, noise=False, reference=step)
    simulated = [ambkit.simulate(one, scenario.replace(controller=law)).record for law in laws]
    np.testing.assert_array_equal(simulated[0]["iu_A1"], simulated[1]["iu_A1"])
    kalman = KalmanFilter(one) if feedback == "estimate" else None
    loops = [LoopBuilder(one, law).loop(kalman) for law in laws]
    f = np.geomspace(5, 2000, 40)
    np.testing.assert_allclose(loops[0].sensitivity(f), loops[1].sensitivity(f), rtol=1e-12)


def test_margins_over_the_speed_follow_it():
    found = ambkit.assess_speed(ONE, "linear", SCHEDULED, fastest=800.0, count=3)
    fast = ambkit.assess(ONE.replace(speed=400.0), "linear", between(1.0))
    assert found.peaks[1].max() == pytest.approx(fast.loops[fast.last].peak, rel=1e-6)


@compiled
@pytest.mark.parametrize(("feedback", "precision"), quick(
    product(["measurement", "estimate"], ["float", "double"]),
    [("estimate", "double")],
))  # fmt: skip
def test_the_c_has_its_bits_in_a_run_up(feedback, precision, tmp_path):
    schedule = [ScheduledGains(speed=100.0, ki=50e3), *SCHEDULED.schedule]
    law = Control(type="translation and tilt", feedback=feedback, schedule=schedule)
    flight = Scenario(controller=law, speed=Ramp(slope=600.0, start=0.0, end=1.0))
    export_c(ONE, None, tmp_path / "c", prefix="f", precision=precision, scenario=flight)
    assert "samples: equal to the last bit" in run(tmp_path / "c")
    data = tmp_path / "c" / "f_data.c"
    data.write_text(data.read_text().replace(".schedule = &schedule", ".schedule = NULL"))
    assert "FAIL: f with its controllers" in run(tmp_path / "c")


def test_what_has_no_schedule_refuses_it():
    with pytest.raises(AmbkitError, match=r"schedule\[1\]\.speed: must be above the previous one"):
        Control(schedule=[ScheduledGains(speed=10.0), ScheduledGains(speed=10.0)])
    with pytest.raises(AmbkitError, match='schedule: is of a PID; type = "lqg" has none'):
        Control(type="lqg", schedule=SCHEDULED.schedule)
    blind = Control(pid={"x": PID(sees="y")})
    with pytest.raises(AmbkitError, match="sees: is of a rotor that is a body"):
        ambkit.simulate(BEARING, Scenario(controller=blind))
    with pytest.raises(AmbkitError, match="schedule: is of a rotor that is a body"):
        ambkit.simulate(BEARING, Scenario(controller=SCHEDULED, disturbance=Constant(value=0.0)))
