"""Machines that are controlled by translation and tilt, by a regulator, or past their unbalance."""

import math

import numpy as np
import pytest

import ambkit
from ambkit import PID, KalmanFilter, Machine
from ambkit.assessment.amplitude_sweep import _NoiselessLoop
from ambkit.assessment.assess import MEASUREMENT
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

TUM = Machine.preset("tum_mlps")
TILT = Control(type="translation and tilt")
CROSSED = Control(type="translation and tilt", cross_feedback=0.5)
LQG = Control(type="lqg")
STILL = Control(type="lqg", unbalance="compensation")
FREE = Control(unbalance="force-free")


def filter_for(machine, control):
    synchronous = [] if control.unbalance == "off" else ["unbalance"]
    return KalmanFilter(machine, synchronous=synchronous)


@pytest.mark.parametrize(
    ("control", "fed"),
    [
        (CROSSED, True),
        pytest.param(LQG, True, marks=pytest.mark.long),
        pytest.param(TILT, False, marks=pytest.mark.long),
        pytest.param(STILL, True, marks=pytest.mark.long),
        pytest.param(Control(unbalance="compensation"), True, marks=pytest.mark.long),
        pytest.param(FREE, True, marks=pytest.mark.long),
    ],
)
def test_the_simulated_loop_is_the_models_within_two_percent(control, fed):
    found = ambkit.assess_sweep(
        TUM, filter_for(TUM, control) if fed else None, control, amplitudes=["1 um"]
    )
    (swept,) = found.swept
    assert not swept.limited
    assert swept.deviation < 0.02


@pytest.mark.parametrize(
    ("control", "rpm"),
    [
        (TILT, 0.0), (LQG, 20e3),
        *(pytest.param(*case, marks=pytest.mark.long)
          for case in ((LQG, 0.0), (CROSSED, 20e3), (STILL, 20e3), (FREE, 20e3))),
    ],
)  # fmt: skip
def test_bodes_integral_holds(control, rpm):
    machine = TUM.model_copy(update={"speed": rpm * math.pi / 30, "unbalance": ()})
    filter = filter_for(machine, control)
    found = ambkit.assess(machine, filter, control)
    assert list(found.loops) == [MEASUREMENT] * (control == TILT) + [filter.name]
    for loop in found.loops.values():
        assert loop.stable
        assert loop.integral.holds
        assert loop.largest[0] > found.least[0]


@pytest.mark.parametrize("control", [FREE, Control(unbalance="compensation")])
def test_unbalance_is_answered_as_the_simulation_does(control):
    """Force-free, still, or fought: orbit and current at the speed, where the estimate has it."""
    machine = TUM.replace(speed="12000 rpm")
    filter = filter_for(machine, control)
    found = ambkit.assess(machine, filter, control).loops[filter.name]
    flight = Scenario(duration=2.5, noise=False, controller=control).fed("estimate")
    record = simulate_run(machine, flight, estimator=filter).record
    turns = round(0.2 * machine.speed / (2 * math.pi))
    late = slice(-round(turns * 2 * math.pi / machine.speed / machine.sampling_time), None)
    for name, axis in found.axes.items():
        i = record[f"u_{name}"][late]
        swing = (i.max() - i.min()) / 2
        orbit = np.hypot(record[f"s_{name[0]}1"][late], record[f"s_{name[0]}2"][late]).max()
        d = axis.demands
        hold = abs(LoopBuilder(machine).point.iu[[a.name for a in machine.axes].index(name)])
        assert d.current - 3 * axis.current_noise - hold == pytest.approx(swing, rel=0.05, abs=1e-3)
        assert d.displacement - 3 * axis.position_noise == pytest.approx(orbit, rel=0.05, abs=2e-8)


def test_over_speed_has_the_gains_of_the_machines_own_speed():
    over = ambkit.assess_speed(TUM, "linear", LQG, fastest=2 * TUM.speed, count=3)
    own = ambkit.assess(TUM, "linear", LQG).loops["linear"]
    assert over.peaks[1] == pytest.approx([at.peak for at in own.axes.values()], rel=1e-6)
    other = ambkit.assess(TUM.model_copy(update={"speed": 2 * TUM.speed}), "linear", LQG)
    assert over.peaks[2] != pytest.approx(
        [at.peak for at in other.loops["linear"].axes.values()], rel=1e-9
    )


def test_what_cannot_be_fed_by_the_measurement_needs_a_filter():
    for control in (LQG, CROSSED):
        with pytest.raises(AmbkitError, match="fed by an estimate: give a filter"):
            ambkit.assess(TUM, "none", control)
    one = ambkit.preset("zittau_axial")
    regulated = [
        ambkit.assess(one, "linear", c).loops["linear"] for c in (LQG, Control(type="lqg"))
    ]
    assert regulated[0].peak == pytest.approx(regulated[1].peak, rel=1e-9)
    ahead = PID(feed_forward=0.5)
    each = Control(pid={axis.name: ahead for axis in TUM.axes})
    peaks = [ambkit.assess(TUM, "linear", c).loops["linear"].peak for c in (ahead, each, PID())]
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-9)
    assert peaks[0] > 1.05 * peaks[2]


def test_what_is_reported_of_controllers():
    found = ambkit.assess(TUM, "linear", TILT)
    assert list(found.controllers) == ["x", "y", "th_x", "th_y"]
    assert found.to_dict()["control"]["type"] == "translation and tilt"
    assert found.facts["control"] == "translation and tilt"
    assert "kp, ki, kd of x, y" in found.facts
    assert found.of.static_compliance() > 0
    assert list(found.shares()) == ["as it is", "sensor", "filter"]
    regulated = ambkit.assess(TUM, "linear", LQG)
    assert regulated.controllers == {}
    assert regulated.of.static_compliance() is None
    assert list(regulated.shares()) == ["as it is", "sensor"]


def test_the_static_compliance_is_that_of_the_gains_that_fly():
    """A flexible rotor is held more firmly by an estimate, and gives way to a load less."""
    machine = Machine.preset("ufu_flexible")
    kalman = KalmanFilter(machine)
    loop = LoopBuilder(machine)
    softest = max(
        1 / (magnet.k_i * pid.kp - magnet.k_s)
        for magnet, pid in zip(stiffnesses(machine), loop.pids(kalman).values(), strict=True)
    )
    # Its own weight and the bending make it a little softer.
    assert loop.static_compliance(kalman) == pytest.approx(softest, rel=0.1)
    assert loop.static_compliance(kalman) < 0.7 * loop.static_compliance()


@pytest.mark.parametrize(("given", "code", "message"), [
    ("lqg", 0, '"type": "lqg"'),
    ("scenario.toml", 0, '"cross_feedback": 0.5'),
    ("nothing", 2, "none of decentralised, translation and tilt, lqg"),
])  # fmt: skip
def test_command(given, code, message, call, tmp_path):
    (tmp_path / "scenario.toml").write_text(
        'duration = "1 s"\n[controller]\nfeedback = "estimate"\ntype = "translation and tilt"\n'
        'cross_feedback = 0.5\n[[disturbance]]\naxis = "A1"\n'
        'force = {type = "constant", value = "5 N"}\n'
    )
    result = call("assess", "tum_mlps", "--controller", given, "--json")
    assert result.code == code
    assert message in result.out + " ".join(result.err.split())


@pytest.mark.parametrize("pid", [Control(type="lqg"), PID(feed_forward=0.5)])
def test_a_bearings_regulator_and_feed_forward_are_in_its_loop(pid):
    zittau = Machine.preset("zittau_axial")
    found = ambkit.assess_sweep(zittau, "linear", pid, amplitudes=["2 um"])
    assert found.loop.integral.holds
    assert found.swept[0].deviation < 0.02
    plain = ambkit.assess(zittau, "linear").loops["linear"]
    assert found.model.peak != pytest.approx(plain.peak, rel=0.01)
    assert list(ambkit.assess(zittau, "linear", pid).loops) == ["linear"]
    with pytest.raises(AmbkitError, match="fed by an estimate: give a filter"):
        ambkit.assess(zittau, "none", pid)


def test_a_sine_beside_the_speed_tells_itself_from_what_still_settles():
    """An unbalance that the estimator is told little of settles in 5 s, at the speed: 50 Hz."""
    plane = TUM.unbalance[0].model_copy(update={"amount": 6.56e-5})  # of grade G 6.3
    machine = TUM.model_copy(update={"unbalance": (plane,)})
    filter = filter_for(machine, FREE)
    found = ambkit.assess(machine, filter, FREE)
    rig = _NoiselessLoop(found.of, filter, found.loops[filter.name].loop, 0)
    assert np.abs(rig.slow).max() ** (1 / TUM.sampling_time) > math.exp(-1 / 5)
    f, part = rig.sine(1e-6, 48.4)
    swept = rig.swept(1e-6, np.array([f]), [part])
    assert f == pytest.approx(48.4, rel=1e-3)
    assert swept.deviation < 0.01  # 2.8 % if that is taken for the answer
