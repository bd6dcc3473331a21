"""What a loop asks of its machine, against the simulation; the verdict, and its page."""

import dataclasses
import math

import control
import numpy as np
import pytest
from machine_cases import BEARINGS

import ambkit
from ambkit import KalmanFilter, Machine, Scenario, Sine
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.judge.loop.synthesis import LQG, Noise
from ambkit.simulation.run import simulate

ZITTAU = Machine.preset("zittau_axial")
LATE = ZITTAU.replace(
    name="late", rotor__gravity="none", sensor__noise_variance="0.01 um^2", sensor__lag="16 us",
    delay="0.15 ms", amplifier__bandwidth="2 kHz", amplifier__noise_variance="1e-9 V^2",
    amplifier__voltage_limit="100 V", amplifier__resistance="2 ohm",
)  # fmt: skip


def loop_of(bearing, filter="linear", **at):
    return list(ambkit.assess(bearing, filter, **at).loops.values())[-1]


def swung(bearing, frequency, load):
    """The end of a simulated run with a harmonic load, without noise."""
    scenario = Scenario(
        duration=0.6, noise=False, disturbance=Sine(amplitude=load, frequency=frequency),
        substeps=20, controller=ambkit.Control(feedback="estimate"),
    )  # fmt: skip
    record = simulate(bearing, scenario, estimator=KalmanFilter(bearing, frozen_limit=0))
    return record.between(0.3, None)


@pytest.mark.parametrize("frequency", [20.0, 60.0, 200.0])
def test_a_share_of_the_load_that_it_bears_takes_that_share_of_what_is_left(frequency):
    loop = loop_of(LATE)
    capacity = loop.demands.capacity

    def bears(of):
        return float(np.exp(np.interp(np.log(frequency), np.log(capacity.frequency), np.log(of))))

    current, far, voltage = map(bears, (capacity.current, capacity.displacement, capacity.voltage))
    load = 0.1 * min(current, far, voltage)  # where the magnet is linear
    end = swung(LATE, frequency, load)
    room = LATE.current_max - 3 * loop.current_noise
    assert np.abs(end["iu"]).max() == pytest.approx(load / current * room, rel=0.03)
    way = 0.3 * LATE.clearance - 3 * loop.position_noise
    assert np.abs(end["x"]).max() == pytest.approx(load / far * way, rel=0.03)
    held = 2.0 * LATE.magnet.bias_current
    turned = (end["u_coil"] - held) * np.exp(-2j * math.pi * frequency * end.t)
    first_harmonic = 2 * np.abs(np.mean(turned))  # it is told just after a sample
    assert first_harmonic == pytest.approx(load / voltage * (100 - held), rel=0.1)


def test_the_least_load_is_the_least_of_all():
    c = loop_of(LATE).demands.capacity
    least, at = c.least
    k = int(np.argmin(np.abs(c.frequency - at)))
    assert least == min(c.current[k], c.displacement[k], c.voltage[k])
    assert least == min(c.current.min(), c.displacement.min(), c.voltage.min())
    assert loop_of(ZITTAU).demands.capacity.voltage is None


@pytest.mark.parametrize("preset", BEARINGS)
def test_constant_loads_are_held_up_to_the_end_and_no_farther(preset):
    bearing = Machine.preset(preset)
    low, high = loop_of(bearing).demands.capacity.static
    assert low < 0 < high
    for end in (low, high):
        OperatingPoint.equilibrium(bearing, 0.0, 0.999 * end)
        with pytest.raises(AmbkitError, match="no control current"):
            OperatingPoint.equilibrium(bearing, 0.0, 1.001 * end)


def test_runout_moves_the_rotor_by_what_the_simulation_says():
    turning = LATE.replace(speed=2 * math.pi * 50, sensor__runout=[
        {"order": 1, "amplitude": "20 um"}, {"order": 3, "amplitude": "5 um", "phase": "1 rad"}
    ])  # fmt: skip
    still, moved = loop_of(LATE).demands, loop_of(turning).demands
    end = swung(turning, 50.0, 1e-9)
    x = np.fft.rfft(end["x"][-2000:])[[10, 30]] / 1000
    assert moved.displacement - still.displacement == pytest.approx(np.abs(x).sum(), rel=0.03)
    i = np.fft.rfft(end["iu"][-2000:])[[10, 30]] / 1000
    assert moved.current - still.current == pytest.approx(np.abs(i).sum(), rel=0.03)
    more = moved.copper_loss - still.copper_loss
    assert more == pytest.approx(2 * 2.0 * (np.abs(i) ** 2).sum() / 2, rel=0.06)


def test_copper_loss_is_that_of_both_coils():
    held = loop_of(LATE, disturbance=3.0)
    iu = OperatingPoint.equilibrium(LATE, 0.0, 3.0).iu
    i0 = LATE.magnet.bias_current
    expected = 2.0 * ((i0 + iu) ** 2 + (i0 - iu) ** 2 + 2 * held.current_noise**2)
    assert held.demands.copper_loss == pytest.approx(expected, rel=1e-9)
    assert loop_of(ZITTAU).demands.copper_loss is None
    one = Machine.preset("inteco_ml")
    one = one.replace(amplifier__bandwidth="200 Hz", amplifier__voltage_limit="60 V",
                      amplifier__resistance="4 ohm")  # fmt: skip
    found = loop_of(one)
    current = one.magnet.bias_current + OperatingPoint.equilibrium(one).iu
    expected = 4.0 * (current**2 + found.current_noise**2)
    assert found.demands.copper_loss == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("share", "zone"), [(0.2, "A"), (0.35, "B"), (0.45, "C"), (0.6, "D")])
def test_zones_are_by_the_share_of_the_clearance(share, zone):
    asked = loop_of(LATE).demands
    assert dataclasses.replace(asked, displacement=share * asked.clearance).zone == zone


def test_the_verdict_says_what_is_kept_and_what_not(tmp_path):
    good = ambkit.assess(LATE, "linear")
    assert all(row.kept is not False for row in good.rows)
    good.save(tmp_path / "v.html")
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    for said in ("Verdict on the loop of late", "All limits are kept", "reviewed by",
                 "certification requires", "14839-2"):  # fmt: skip
        assert said in page
    far = ambkit.assess(LATE, "linear", position=0.5 * LATE.clearance)
    kept = {row.key: row.kept for row in far.rows if row.of == "linear"}
    assert kept["displacement"] is False
    assert kept["verdict"] is False
    assert kept["peak"] == (far.loops["linear"].peak < 3)
    assert "not kept: zone" in far.finding
    assert len(good.capacity_figure().panels) == 3
    assert len(ambkit.assess(ZITTAU, "none").capacity_figure().panels) == 2


def test_what_falls_keeps_nothing(tmp_path):
    weak = ambkit.assess(LATE, "none", controller=ambkit.Control(kp=100.0, ki=0.0, kd=1.0))
    assert weak.loops["measurement"].demands is None
    weak.page(tmp_path / "v.html")
    assert "Not kept: zone overall" in (tmp_path / "v.html").read_text(encoding="utf-8")
    with pytest.raises(AmbkitError, match="nothing to draw"):
        weak.capacity_figure()


# ---- the linear-quadratic-Gaussian controller


@pytest.mark.parametrize("bearing", [ZITTAU, LATE], ids=["paper", "late"])
def test_lqg_is_that_of_python_control(bearing):
    """Its closed loop's poles are those of regulator and filter, each alone (separation)."""
    P = plant(bearing, OperatingPoint.equilibrium(bearing))
    noise = Noise(1e-12, 1e-6, 10.0)
    weight = 1e-7
    loop = Loop(P, LQG(P, noise).compensator(weight))
    assert loop.is_stable
    n = len(P.A)
    A = np.block([[P.A, P.B[:, 1:]], [np.zeros((1, n)), np.ones((1, 1))]])
    unit = np.diag([1e-6] * n + [1.0])  # or its solver loses the digits
    scaled = np.linalg.inv(unit) @ A @ unit
    G, C = np.linalg.inv(unit) @ np.vstack([P.B[:, :1], [[0.0]]]), P.C[:1] @ unit[:n] * 1e6
    Q = 1e-6 * G @ G.T
    Q[-1, -1] += 10.0 * P.T
    of_filter = control.dlqe(scaled, np.eye(n + 1), C, Q, np.eye(1), method="scipy")[2]
    of_regulator = control.dlqr(
        P.A, P.B[:, :1] * 1e6, P.C[1:2].T @ P.C[1:2], np.eye(1) * weight * 1e12, method="scipy"
    )[2]
    expected = np.concatenate([of_filter, of_regulator])
    found = loop.closed.poles()
    assert len(found) == len(expected)
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-5


def test_lqg_carries_a_load_and_holds_a_reference():
    P = plant(LATE, OperatingPoint.equilibrium(LATE))
    closed = Loop(P, LQG(P, Noise(1e-12, 1e-6, 10.0)).compensator()).closed
    rest = closed.C @ np.linalg.solve(np.eye(len(closed.A)) - closed.A, closed.B) + closed.D
    names = [at.name for at in closed.inputs]
    assert rest[1, names.index("f_d")] == pytest.approx(0, abs=1e-9)
    assert rest[1, names.index("r")] == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("preset", BEARINGS)
def test_lqg_stands_beside_the_loops(preset):
    found = ambkit.assess(Machine.preset(preset), "linear", beside=["lqg"])
    assert list(found.loops) == ["measurement", "LQG", "linear"]
    lqg = found.loops["LQG"]
    assert lqg.stable
    assert lqg.integral.holds
    assert found.least[0] < lqg.margins.peak
    assert lqg.current_noise < found.loops["measurement"].current_noise
