"""The H-infinity baseline: against slycot's own norm, and beside the other controllers."""

import sys

import numpy as np
import pytest

import ambkit
from ambkit import Machine
from ambkit.base.errors import AmbkitError
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.loop.synthesis import AT_REST, PEAK, SLOW, STRONG, hinf

ZITTAU = Machine.preset("zittau_axial")
LATE = ZITTAU.replace(delay=3.75e-4, amplifier__bandwidth=1000.0)


def test_no_other_controller_weighs_less():
    """Its cost is flat over the frequency, as an optimal one's is, and in another's is higher."""
    pytest.importorskip("slycot")
    of = LoopBuilder(LATE)
    P = of.plant.select(["y"], ["u"])
    T, p = P.T, np.log(np.abs(P.unstable()).max()) / P.T
    f = np.geomspace(1e-3 * p, 0.499 / T, 400)
    s = 2j / T * np.tan(np.pi * f * T) / p
    W = np.abs((s / PEAK + SLOW) / (s + SLOW * AT_REST))
    z = np.exp(2j * np.pi * f * T)
    one = np.eye(len(P.A))
    at_p = abs(
        (
            P.C @ np.linalg.solve((1 + 0.5j * p * T) / (1 - 0.5j * p * T) * one - P.A, P.B) + P.D
        ).item()
    )
    G = np.array([(P.C @ np.linalg.solve(each * one - P.A, P.B) + P.D).item() for each in z])

    def cost(K):
        S = 1 / (1 - G * K)
        return np.hypot(W * np.abs(S), at_p / STRONG * np.abs(K * S))

    best = cost(hinf(P).response(f)[:, 0, 0])
    assert best.max() < 1.02 * best.min() + 0.02
    for loop in ambkit.assess(LATE, "none", beside=["lqg"]).loops.values():
        K = loop.loop.compensator.response(f)[:, 0, 0]
        assert cost(K).max() > best.max()


def test_the_same_bearing_in_other_units_has_the_same_loop():
    pytest.importorskip("slycot")
    volts = LATE.replace(amplifier__gain="0.01 A/V", sensor__gain=50.0)
    one, other = (LoopBuilder(each).hinf() for each in (LATE, volts))
    f = np.geomspace(1, 1900, 30)
    # What is synthesised in other units differs by the solution of two Riccati equations.
    assert one.of_axis(0, f) == pytest.approx(other.of_axis(0, f), rel=5e-6)
    assert one.is_stable


def test_it_stands_beside_pid_and_lqg():
    pytest.importorskip("slycot")
    found = ambkit.assess(LATE, "linear", beside=["lqg", "hinf"])
    assert list(found.loops) == ["measurement", "LQG", "H-infinity", "linear"]
    loop = found.loops["H-infinity"]
    assert found.least[0] < loop.peak < found.loops["LQG"].peak
    assert loop.integral.holds
    closed = loop.loop.closed
    rest = closed.C @ np.linalg.solve(np.eye(len(closed.A)) - closed.A, closed.B[:, -1])
    assert rest[1] == pytest.approx(1, abs=1e-3)  # the reference is held


@pytest.mark.parametrize("name", ["tum_mlps", "hindawi_2011"])
def test_of_a_machine_each_axis_has_one(name):
    pytest.importorskip("slycot")
    found = ambkit.assess(Machine.preset(name), "none", beside=["hinf"])
    loop = found.loops["H-infinity"]
    assert loop.zone == "A"
    assert loop.integral.holds
    assert loop.peak < found.loops["measurement"].peak


def test_without_slycot_it_is_reported_in_a_line(monkeypatch, call):
    monkeypatch.setitem(sys.modules, "slycot", None)
    with pytest.raises(AmbkitError, match=r"pip install ambkit\[hinf\]"):
        ambkit.assess(ZITTAU, "none", beside=["hinf"])
    told = call("assess", "zittau_axial", "--beside", "hinf")
    assert told.code == 2
    assert "needs python-control and slycot" in told.err


def test_command(call):
    pytest.importorskip("slycot")
    told = call("assess", "zittau_axial", "--beside", "hinf", "--beside", "lqg")
    assert told.code == 0
    assert "H-infinity" in told.out
