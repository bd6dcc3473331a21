"""Flexible rotors, in motion: poles, flight, run-up, estimation."""

import math

import numpy as np
import pytest
from machine_cases import directions
from quick import quick
from test_machine_flight import CORE, LOADS, at_rest, released

from ambkit import Machine, Scenario, simulate
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.control.pid import PID
from ambkit.control.stabilising_controller import _Search, chosen, holding
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.machine import geometry
from ambkit.machine.axes import isolated_axes
from ambkit.machine.parts import GRAVITY
from ambkit.models.continuous import open_loop
from ambkit.models.plant import Plant
from ambkit.rotordynamics import machine_report
from ambkit.simulation.waveforms import Ramp
from benchmarks.judge_states import judge_states

UFU = "ufu_flexible"


def flexible(**keys):
    return Machine.preset(UFU).replace(**keys)


# ---- the linear model ----


@pytest.mark.parametrize("name", [UFU, "tum_mlps_flexible", "compressor"])
@pytest.mark.parametrize("speed", [0.0, 1000.0])
def test_unstable_poles_are_those_of_all_elements(speed, name):
    """Against the whole matrices with the magnets as springs, nothing reduced or left out."""
    one = Machine.preset(name).replace(speed=speed, rotor__damping_ratio=1e-9)
    whole = one.rotor.matrices
    springs = [k.k_s for k in stiffnesses(one)][::2]
    K, n = whole.K.copy(), len(whole.M)
    for each, k_s in zip(one.bearings, springs, strict=True):
        w = 2 * int(np.argmin(np.abs(whole.place - each.place)))
        assert abs(whole.place[w // 2] - each.place) < 1e-9
        K[w, w] -= k_s
    inverse = np.linalg.inv(whole.M)
    A = np.block([
        [np.zeros((n, n)), np.eye(n)], [-inverse @ K, 1j * speed * inverse @ whole.G],
    ])  # fmt: skip
    poles = np.linalg.eigvals(A)
    expected = np.sort(poles.real[poles.real > 100])

    def errors(machine):
        found = open_loop(machine, [k.k_s for k in stiffnesses(machine)], speed).unstable
        assert len(found) == 4
        own = np.sort(found.real)[::2] if speed == 0 else np.unique(found.real.round(6))
        return np.abs(own / expected - 1)

    left_out = errors(one)
    assert left_out.max() < 3e-3  # what `check` says the magnets feel of the modes left out
    if name != UFU:
        return
    assert left_out.max() < 3e-4
    kept = errors(one.replace(rotor__residual=True))
    assert kept.max() < 1e-4
    if speed == 0:  # gyroscopics of what is left out are not kept
        assert kept.max() < 0.02 * left_out.max()
    rigid = Machine.preset("ufu_rig").replace(speed=speed)
    assert errors(rigid).max() > 5e-3  # what bending changes


# ---- in flight ----


def test_without_loss_energy_is_kept():
    """Kinetic, bending and magnetic energy, with gyroscopics, and magnets without control."""
    one = flexible(speed=3000.0, rotor__damping_ratio=1e-12, rotor__gravity="none", unbalance=[],
                   delay=None)  # fmt: skip
    one = one.replace(bearing=[
        each.model_copy(update={"amplifier": each.amplifier.model_copy(update={"bandwidth": None})})
        for each in one.bearings
    ])  # fmt: skip
    plant, n = Plant(one), len(one.positions)
    H = directions(one, one.axes)
    X = at_rest(one, np.r_[2e-5, -1e-5, 5e-5, 8e-5, np.full(6, 1e-5)], np.zeros(4))
    X[n : n + 4] = [2e-3, -3e-3, 0.05, 0.02]
    out = released(one, X, np.zeros(4), 50, 32)["X"]
    q, w = out[:, :n], out[:, n : 2 * n]
    kinetic = (w**2 * one.masses).sum(axis=1) / 2
    bent = (q[:, 4:] ** 2 * one.bending.stiffness.repeat(2)).sum(axis=1) / 2
    s = q @ H.T
    magnetic = np.zeros(len(s))
    for k, (axis, alone) in enumerate(zip(one.axes, plant.isolated, strict=True)):
        magnet = axis.bearing.magnet
        gap, pull = magnet.air_gap, alone.magnet.magnet_constant * magnet.bias_current**2
        magnetic -= pull * (1 / (gap - s[:, k]) + 1 / (gap + s[:, k]) - 2 / gap)
    energy = kinetic + bent + magnetic - s @ LOADS
    moved = np.ptp(bent) + np.ptp(kinetic)
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-8 * moved)
    assert np.ptp(bent) > 0.1 * moved


def test_the_weight_bends_it_once():
    """As gravity in each coordinate, with the sag that the bearings' forces leave: the same."""
    one = flexible()
    plant = Plant(one)
    q, currents = plant.equilibrium(np.zeros(4), np.zeros(4))
    np.testing.assert_allclose(q, 0, atol=1e-18)
    F = np.array([
        float(law.in_core(CORE).force(np.array([i]), np.array([0.0]))[0])
        for law, i in zip(plant.laws, currents, strict=True)
    ])  # fmt: skip
    H = directions(one, one.axes)
    balance = H[:, :4].T @ F
    np.testing.assert_allclose(balance, [one.rotor.mass * GRAVITY, 0, 0, 0], atol=1e-9)
    sag = geometry.static_deflection(one, F)
    assert 2e-5 < np.abs(sag[0]) < 3e-5  # of the first mode in x, by the bearings


@pytest.mark.parametrize("feedback", quick(["estimate", "measurement"], ["estimate"]))
def test_a_run_up_passes_the_first_bending_mode(feedback):
    one = flexible(unbalance=[{"place": "364 mm", "amount": "2 g mm"}])
    up = Ramp(slope=400.0, start=0.0)
    usual = tuple(map(chosen, isolated_axes(one)))
    weak = _Search(one, usual, "measurement").max_damping().pids  # its peak of abs(S) is above 2
    pids = {a.name: PID(**gains._asdict()) for a, gains in zip(one.axes, weak, strict=True)}
    control = Control(pid=pids)
    run = simulate(
        one, Scenario(duration=2.3, speed=up, noise=False, controller=control).fed("measurement")
    )
    assert run.samples_at_the_stop == 0
    far = np.hypot(run.record["q_m1_x"], run.record["q_m1_y"])
    critical = 109 * 60 * math.pi / 30
    peak = run.record["speed"][np.argmax(far)]
    assert critical < peak < 1.1 * critical  # a sweep is ahead of its resonance
    before, after = (far[np.abs(run.record["speed"] - speed) < 30].max() for speed in (400, 880))
    assert far.max() > 5 * max(before, after)
    # Damped more by an estimator that knows the velocity at once, or by the default controllers.
    damped = simulate(
        one, Scenario(duration=2.3, speed=up, noise=False, controller={"feedback": feedback})
    ).record
    assert np.hypot(damped["q_m1_x"], damped["q_m1_y"]).max() < 0.6 * far.max()


def test_controllers_that_cannot_hold_say_so():
    held = holding(flexible())
    one = flexible()
    assert one.bending is not None
    assert "decentralised PIDs are stable" in machine_report._held(one, one.bending).text
    assert held.held
    assert held.growing == []
    assert holding(flexible(), "estimate").pids[0].kp > 1.2 * held.pids[0].kp
    late = flexible(delay=1.6e-3)
    found = holding(late)
    assert not found.held
    assert found.growing[0].real > 0
    assert late.bending is not None
    said = machine_report._held(late, late.bending).text
    assert "no decentralised PID in the search is stable" in said
    with pytest.raises(AmbkitError, match="no default controller stabilises the rotor"):
        simulate(late, Scenario(duration=1.0, controller={"feedback": "measurement"}), "none")
    run = simulate(
        late,
        Scenario(duration=1.0, controller=Control(type="decentralised")).fed("measurement"),
        "none",
    )
    assert run.samples_at_the_stop > 0


def test_poles_of_the_loop_are_what_a_flight_shows():
    """The decay of the second mode after a push, against the pole of the sampled loop."""
    one = flexible(unbalance=[], speed=0.0)
    found = holding(one)
    near = found.poles[np.abs(found.poles.imag - one.bending.frequency[1]).argmin()]
    push = {"axis": "A1", "force": {"type": "impulse", "area": 0.01, "time": 0.0,
                                    "duration": 5e-4}}  # fmt: skip
    run = simulate(
        one,
        Scenario(
            duration=0.6, noise=False, disturbance=[push], controller={"feedback": "measurement"}
        ),
    )
    t, far = run.record.t, np.abs(run.record["q_m2_x"] - run.record["q_m2_x"][-1])
    early, late = (far[(t > at) & (t < at + 0.02)].max() for at in (0.1, 0.4))
    assert math.log(early / late) / 0.3 == pytest.approx(-near.real, rel=0.1)


# ---- estimation ----


@pytest.mark.parametrize("speed", [0.0, 1500.0])
def test_filters_know_how_it_is_bent(speed):
    one = flexible(speed=speed, unbalance=[])
    run = simulate(one, Scenario(duration=0.3, seed=2))
    estimate = ExtendedKalmanFilter(one).run(run.record, covariance=True)
    late = slice(1500, None)
    for axis in one.axes:
        names = [n for n in estimate.states if n.role in ("position", "bending")]
        H = axis.line.form
        wrong = sum(
            H.get(n.name, 0.0) * (estimate[n.name] - run.record[f"q_{n.name}"])[late] for n in names
        )
        own = np.sqrt(np.mean(np.square(wrong)))
        assert own < 0.3e-6  # the raw sensor has 0.5 um
    for name in ("m1_x", "m2_x", "m3_x", "v_m1_y"):
        wrong = (estimate[name] - run.record[f"q_{name}"])[late]
        believed = estimate.std(name)[late].mean()
        assert np.sqrt(np.mean(wrong**2)) < 1.6 * believed


@pytest.mark.long
def test_a_run_up_is_followed_by_the_filter():
    """Speed enters the model: through the first bending mode, with unbalance as states."""
    one = flexible(unbalance=[{"place": "364 mm", "amount": "2 g mm"}])
    up = Ramp(slope=400.0, start=0.0)
    run = simulate(one, Scenario(duration=2.2, speed=up, seed=4))
    estimate = ExtendedKalmanFilter(one, synchronous=("unbalance",)).run(run.record)
    amount = np.hypot(estimate["U1_x"], estimate["U1_y"])[-1]
    assert amount == pytest.approx(2e-6, rel=0.05)
    assert 0.9 < np.nanmean(estimate.nis[5000:]) < 1.1


@pytest.mark.long
def test_judged_with_more_modes_and_residual_shapes():
    """Four modes and residual shapes: 52 states in the core, as good as can be."""
    one = flexible(rotor__modes_up_to=1200.0, rotor__residual=True)
    judged = judge_states(one, ("extended",), seeds=6, duration=0.2)
    assert judged.efficiency("extended").mean() > 0.9
    assert 0.85 < judged.nees["extended"].mean() < 1.15
