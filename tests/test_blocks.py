"""Blocks behind a PID: as data, in the loop, in its margins and in C."""

import control
import numpy as np
import pytest
from export_cases import BEARING, compiled
from exporting import export_c
from machine_cases import machine
from test_export_control import run

import ambkit
from ambkit import AmbkitError, Control, Scenario
from ambkit.control.blocks import (
    Biquad,
    LeadLag,
    Notch,
    SecondOrder,
    StateSpace,
    gain_at_rest,
    sections_of,
)
from ambkit.control.linear.linear_controller import controller
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.simulation.external_inputs import ExternalInputs

T = 1e-4
THIRD = np.array([[-900.0, 0, 0], [400.0, -700.0, 2000.0], [0, -2000.0, -700.0]])
BLOCKS = [
    Notch(frequency=600.0, depth=0.1),
    LeadLag(zero=900.0, pole=1200.0),
    SecondOrder(frequency=3000.0),
    Biquad(zero_frequency=700.0, zero_damping=0.3, pole_frequency=800.0, pole_damping=0.5),
    StateSpace(A=THIRD, B=[900.0, 0, 0], C=[1.0, 0.1, 0.0], D=0.1),
]
S = control.tf([1, 0], 1)
W = 2 * np.pi
IN_CONTROL = [
    (S**2 + 0.1 * 2 * 0.2 * 600 * W * S + (600 * W) ** 2)
    / (S**2 + 2 * 0.2 * 600 * W * S + (600 * W) ** 2),
    (1 + S / (900 * W)) / (1 + S / (1200 * W)),
    (3000 * W) ** 2 / (S**2 + 2 * 0.7 * 3000 * W * S + (3000 * W) ** 2),
    (S**2 / (700 * W) ** 2 + 0.6 * S / (700 * W) + 1) / (S**2 / (800 * W) ** 2 + S / (800 * W) + 1),
    control.ss(THIRD, [[900.0], [0], [0]], [[1.0, 0.1, 0.0]], [[0.1]]),
]


def answer(sections, f):
    z, found = np.exp(2j * np.pi * f * T), 1.0
    for b0, b1, b2, a1, a2 in sections:
        found = found * (b0 + b1 / z + b2 / z**2) / (1 + a1 / z + a2 / z**2)
    return found


@pytest.mark.parametrize("k", range(len(BLOCKS)), ids=[type(b).__name__ for b in BLOCKS])
def test_a_block_is_its_transfer_function(k):
    """By the bilinear map, which is exact at rest and where it is prewarped."""
    block, continuous = BLOCKS[k], IN_CONTROL[k]
    f = np.array([0.0, 30.0, 400.0, 2000.0, block.exact or 100.0])
    rate = 2 / T if not block.exact else W * block.exact / np.tan(np.pi * block.exact * T)
    mapped = rate * np.tan(np.pi * f * T)
    expected = np.array([continuous(1j * w) for w in mapped])
    np.testing.assert_allclose(answer(block.sections(T), f), expected, rtol=1e-9, atol=1e-12)
    assert gain_at_rest(block.sections(T)) == pytest.approx(continuous(0j).real, rel=1e-9)
    for *_, a1, a2 in block.sections(T):  # none at z = -1, which a zero hides and nothing damps
        assert np.abs(np.roots([1.0, a1, a2])).max() < 0.999


def test_a_system_of_python_control_is_a_block():
    continuous = control.tf([900.0], [1.0, 900.0])
    known = Control(block=[continuous])
    assert known.block[0].type == "state space"
    np.testing.assert_allclose(
        answer(sections_of(known.block, T), np.array([0.0, 500.0])),
        answer(LeadLag(zero=1e12, pole=900 / W).sections(T), np.array([0.0, 500.0])), rtol=1e-6,
    )  # fmt: skip
    late = Control(block=[control.sample_system(continuous, T, "zoh")])
    expected = control.sample_system(continuous, T, "zoh")(np.exp(2j * np.pi * 500 * T))
    np.testing.assert_allclose(answer(sections_of(late.block, T), 500.0), expected, rtol=1e-9)


def test_they_are_data():
    written = Scenario(controller=Control(block=BLOCKS, pid={"A1": {"block": BLOCKS[:1]}}))
    assert Scenario.from_toml(written.to_toml()) == written
    assert '[[controller.block]]\ntype = "notch"\nfrequency = "600 Hz"' in written.to_toml()


@pytest.mark.parametrize("k", range(len(BLOCKS)), ids=[type(b).__name__ for b in BLOCKS])
def test_what_flies_is_what_is_assessed(k):
    """Alone on a record: the loop's u is what the linear controller makes of its y."""
    law = Control(feedback="measurement", block=BLOCKS[k : k + 1]).completed(BEARING)
    shaken = 1e-7 * np.random.default_rng(0).standard_normal(201)
    run = ambkit.simulate(
        BEARING.replace(rotor__gravity="none"),
        Scenario(duration=200 * BEARING.sampling_time, controller=law, noise=False),
        external_inputs=ExternalInputs(sensor_noise=shaken),
    ).record
    behind = sections_of(law.block, BEARING.sampling_time)
    linear = controller(law, BEARING, measured=True)
    x, y, u = np.zeros(len(linear.A)), run["y"] / BEARING.sensor.gain, []
    last = [name.name for name in linear.states].index("last")
    x[last] = y[0]
    first = -law.kp * y[0]  # of which the blocks start
    at = [name.name for name in linear.states].index("section_0")
    for j, (b0, b1, b2, a1, a2) in enumerate(behind):
        out = first * (b0 + b1 + b2) / (1 + a1 + a2)
        x[at + 2 * j : at + 2 * j + 2] = out - b0 * first, b2 * first - a2 * out
        first = out
    for value in y:
        told = np.array([value, 0.0])
        u.append((linear.C @ x + linear.D @ told)[0])
        x = linear.A @ x + linear.B @ told
    # The first sample has no derivative yet.
    np.testing.assert_allclose(run["u"][0], -law.kp * y[0] * gain_at_rest(behind)
                               / BEARING.amplifier.gain, rtol=1e-9)  # fmt: skip
    assert np.abs(run["u"]).max() > 1e-3
    np.testing.assert_allclose(run["u"], u, rtol=1e-6, atol=1e-9)


def test_they_hold_the_rotor_from_the_start():
    """A gain at rest other than 1 is in the integral that carries the weight."""
    halved = Control(feedback="measurement", block=[StateSpace(A=[[-9000.0]], B=[9000.0], C=[0.8])])
    for one in (BEARING, machine()):
        run = ambkit.simulate(one, Scenario(duration=0.02, noise=False, controller=halved)).record
        moved = max(
            np.abs(run[name]).max() for name in run.signals if name == "x" or name[:2] == "s_"
        )
        assert moved < 1e-9


def test_a_notch_is_in_the_margins():
    late, plain = (
        LoopBuilder(BEARING, Control(feedback="measurement", block=each)).peak()
        for each in ([Notch(frequency=300.0, damping=0.5)], [])
    )
    assert late > 1.1 * plain
    early = LoopBuilder(
        BEARING, Control(feedback="measurement", block=[Notch(frequency=4900.0)])
    ).peak()
    assert early == pytest.approx(plain, rel=0.02)


@pytest.mark.parametrize(
    ("block", "message"),
    [
        ({"type": "notch", "frequency": "60 kHz"}, "below half the sampling frequency"),
        ({"type": "nocht"}, "did you mean"),
        (control.tf([1.0], [1.0, 0.0]), "the integral is that of the PID"),
        (control.tf([1.0, 0.0], [1.0, 5.0]), "no static gain"),
        (control.tf([1.0], [1.0, 0.5], 2e-4), "sampling time of the loop"),
        (control.ss(THIRD, np.eye(3), np.eye(3), 0 * np.eye(3)), "one input and one output"),
    ],
)
def test_what_cannot_be_flown_is_reported(block, message):
    with pytest.raises(AmbkitError, match=message):
        sections_of(Control(block=[block]).block, T)
    with pytest.raises(AmbkitError, match="there may be 8"):
        sections_of([Notch(frequency=99.0)] * 9, T)
    with pytest.raises(AmbkitError, match="lqg"):
        Control(type="lqg", block=BLOCKS[:1])


def test_a_pid_of_its_own_sensor_is_assessed():
    """Hindawi's sensors are not beside its magnets: each PID closes its own reading alone."""
    one = ambkit.Machine.preset("hindawi_2011")
    own = {axis.name: {"sees": axis.name} for axis in one.axes}
    of = LoopBuilder(one, Control(type="decentralised", feedback="measurement", pid=own))
    pids, f = of.pids(), np.linspace(2.0, 400.0, 50)
    alone = zip(pids.values(), of.isolated, one.readings, strict=True)
    K = [controller(pid, b, measured=True).response(f)[:, 0, 0] / r.sensor.gain
         for pid, b, r in alone]  # fmt: skip
    P = of.plant.response(f)[:, :4, :4]
    expected = np.linalg.inv(np.eye(4) - P @ (np.stack(K, 1)[:, :, None] * np.eye(4)))
    np.testing.assert_allclose(of.loop().sensitivity(f), expected, rtol=1e-8, atol=1e-10)


def test_a_pid_of_what_is_not_there_is_refused():
    wrong = Scenario(controller=Control(pid={"B9": {"kp": 900.0}}))
    for one in (BEARING, machine()):
        with pytest.raises(AmbkitError, match=r"controller\.pid\.B9: there is no B9"):
            ambkit.simulate(one, wrong)


@compiled
@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
def test_the_exported_c_has_them(feedback, tmp_path):
    law = Control(feedback=feedback, block=BLOCKS)
    one = BEARING if feedback == "measurement" else machine(speed=600.0)
    if feedback == "estimate":
        law = Control(type="translation and tilt", feedback=feedback, block=BLOCKS[::2])
    made = export_c(
        one, None, tmp_path / "c", prefix="f", precision="float", scenario=Scenario(controller=law)
    )
    assert made is not None
    assert "pass: f with its controller" in run(tmp_path / "c")
    core = tmp_path / "c" / "core/src/controller.c"
    core.write_text(
        core.read_text().replace("- (c[4] * out);\n      at", "+ (c[4] * out);\n      at")
    )
    assert "FAIL: f with its controller" in run(tmp_path / "c")


def test_a_state_space_comes_from_a_mat_file(tmp_path):
    from scipy.io import savemat

    block = BLOCKS[-1]
    assert isinstance(block, StateSpace)
    matrices = {"A": block.A, "B": np.transpose([block.B]), "C": [block.C], "D": block.D}
    savemat(tmp_path / "lead.mat", matrices)
    savemat(tmp_path / "less.mat", {"A": block.A})
    text = '[[controller.block]]\ntype = "state space"\nfile = "lead.mat"\n'
    (tmp_path / "s.toml").write_text(text)
    scenario = Scenario.load(tmp_path / "s.toml")
    assert scenario.controller.block == (block,)
    assert Scenario.from_toml(scenario.to_toml()) == scenario
    savemat(tmp_path / "lead.mat", matrices | {"A": np.multiply(T, block.A), "T": T})
    assert Scenario.load(tmp_path / "s.toml").controller.block[0].sampling_time == T
    (tmp_path / "s.toml").write_text(text.replace("lead", "less"))
    with pytest.raises(AmbkitError, match=r"less\.mat has no variable B, C"):
        Scenario.load(tmp_path / "s.toml")
    (tmp_path / "s.toml").write_text(text.replace("lead", "none"))
    with pytest.raises(AmbkitError, match=r"none\.mat"):
        Scenario.load(tmp_path / "s.toml")
