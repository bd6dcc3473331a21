"""The default controller: chosen on the margins of the loop, and judged by other means."""

import numpy as np
import pytest
from scipy import signal

from ambkit import KalmanFilter, Machine, Scenario, Step
from ambkit.control.control import Control
from ambkit.control.pid import PID
from ambkit.control.stabilising_controller import chosen, weight_of
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.plant import Plant
from ambkit.simulation.run import simulate_run
from ambkit.simulation.waveforms import Constant


def axes():
    """Return the presets of one axis, and an axis of each end of those that are machines."""
    found = {name: Machine.preset(name) for name in ("zittau_axial", "inteco_ml")}
    for name in ("hindawi_2011", "tum_mlps", "ufu_rig"):
        alone = Plant(Machine.preset(name)).isolated
        found |= {f"{name}, {end}": alone[k] for end, k in (("one end", 0), ("the other", 2))}
    return found


AXES = axes()


@pytest.mark.parametrize("name", AXES)
def test_every_loop_has_its_peak_below_two(name):
    of = LoopBuilder(AXES[name])
    assert of.peak() < 2
    assert of.peak(KalmanFilter(AXES[name])) < 2


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize("share", [0.05, 0.5])
@pytest.mark.parametrize("name", AXES)
def test_a_step_overshoots_by_less_than_a_seventh(name, share, feedback):
    """On the nonlinear plant, by a twentieth and by half of the way to the stop."""
    bearing = AXES[name]
    amplitude = share * bearing.clearance
    scenario = Scenario(
        duration=1.0, noise=False, controller=Control(feedback=feedback),
        reference=Step(amplitude=amplitude, time=0.1),
    )  # fmt: skip
    x = simulate_run(bearing, scenario).record["x"]
    assert x.max() / amplitude - 1 < 0.15
    assert abs(x[-1] / amplitude - 1) < 0.02


def lagging(rng):
    """Return a bearing of a laboratory as any may be: sampled, late, slow."""
    T = float(10 ** rng.uniform(-4.3, -3))
    return Machine.preset("zittau_axial").replace(
        name="any",
        sampling_time=T,
        rotor__mass=float(10 ** rng.uniform(-0.5, 1.0)),
        rotor__gravity="none",
        amplifier__bandwidth=float(rng.uniform(800, 4000)),
        sensor__lag=float(rng.uniform(1e-5, 1e-4)),
        delay=float(rng.choice([0.5, 1.0, 1.5])) * T,
    )


def test_any_bearing_that_allows_it_has_its_peak_below_two():
    """Where pole and delay hold no controller to more than 1.12, which is most of them."""
    rng = np.random.default_rng(3)
    loops = [LoopBuilder(lagging(rng)) for _ in range(40)]
    allowing = [of for of in loops if of.least()[0] < 1.12]
    assert len(allowing) >= 30
    for of in allowing:
        assert of.peak() < 2, of.machine
        assert of.peak(KalmanFilter(of.machine)) < 2, of.machine


def test_what_cannot_be_held_has_gains_all_the_same():
    """It is the simulation that says that the rotor falls."""
    hopeless = Machine.preset("zittau_axial").replace(name="slow", sampling_time=20e-3)
    assert all(np.isfinite(chosen(hopeless)[:6]))


def test_the_weight_takes_the_slow_pole_out_of_a_step():
    bearing = Machine.preset("zittau_axial")
    k, m = ConstantStiffness.of(bearing), bearing.rotor.mass
    kp, ki, kd = 2.5 * k.k_s / k.k_i, 4e4, 12.0
    b = weight_of(bearing, kp, ki, kd)
    loop = signal.TransferFunction(
        [k.k_i * b * kp, k.k_i * ki], [m, k.k_i * kd, k.k_i * kp - k.k_s, k.k_i * ki]
    )
    slow = loop.poles[np.argmin(np.abs(loop.poles))]
    assert loop.zeros == pytest.approx([slow.real], rel=1e-9)
    assert weight_of(bearing, kp, 0.0, kd) == pytest.approx(1 - 1 / 2.5)
    assert weight_of(bearing, 0.5 * k.k_s / k.k_i, ki, kd) == 1.0  # which holds nothing


def test_a_given_gain_has_its_weight_tuned_and_a_given_weight_stays():
    bearing = Machine.preset("zittau_axial")
    assert PID().completed(bearing) == PID.for_bearing(bearing)
    given = PID(kp=3000.0, ki=20_000.0, kd=12.0).completed(bearing)
    assert given.setpoint_weight == pytest.approx(
        weight_of(bearing, 3000.0, 20_000.0, 12.0), rel=0.05
    )
    assert PID(kp=3000.0, setpoint_weight=1.0).completed(bearing).setpoint_weight == 1.0


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_a_rotor_that_hovers_off_the_centre_stays_there(weight):
    bearing = Machine.preset("zittau_axial")
    pid = Control(feedback="measurement", setpoint_weight=weight).completed(bearing)
    scenario = Scenario(duration=0.05, noise=False, reference=Constant(value=2e-4), controller=pid)
    x = simulate_run(bearing, scenario).record["x"]
    assert np.abs(x - 2e-4).max() < 1e-9


def test_the_weight_does_not_touch_the_margins():
    bearing = Machine.preset("zittau_axial")
    peaks = {LoopBuilder(bearing, PID(setpoint_weight=weight)).peak() for weight in (0.0, 1.0)}
    assert len(peaks) == 1
