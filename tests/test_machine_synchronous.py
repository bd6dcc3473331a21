"""Unbalance and runout among the states of a machine: sampled, notched, told apart in a run-up."""

import numpy as np
import pytest
from export_cases import compiled, printed_by
from exporting import export_c
from machine_cases import integrated, machine, sensor
from scipy.linalg import solve_discrete_are

from ambkit import (
    ExtendedKalmanFilter,
    FilterNoise,
    KalmanFilter,
    Machine,
    Record,
    Scenario,
    simulate,
)
from ambkit.judge.unbalance import unbalance_notes
from ambkit.judge.whirl_modes import stiffnesses
from ambkit.machine.accessories import Runout
from ambkit.models.continuous import continuous
from ambkit.models.machine_parts import machine_model
from ambkit.simulation.waveforms import Ramp

BOTH = ("unbalance", "runout")
SERVICE = 12_000 * np.pi / 30


def spoilt(amount=20 / SERVICE**2, runout=3e-6):
    """TUM's rig at 12,000 rpm with 20 N of unbalance and 3 um of runout; and without them."""
    one = Machine.preset("tum_mlps").replace(speed=SERVICE)
    place = one.unbalance[0].place
    with_runout = [
        each.model_copy(update={"runout": (Runout(order=1, amplitude=runout, phase=0.7 * k),)})
        for k, each in enumerate(one.sensors)
    ]
    unbalance = [{"place": place, "amount": amount, "angle": 0.6}]
    return one.replace(unbalance=unbalance, sensor=with_runout), one.replace(unbalance=[])


def slow_error(estimate, record, late):
    names = [name for name in estimate.names if name.startswith("f_d_")]
    return float(np.sqrt(np.mean([np.mean((estimate[n] - record[n])[late] ** 2) for n in names])))


def test_synchronous_states_are_sampled_exactly():
    twice = sensor("A", 0.2, runout=[{"order": 2, "amplitude": "3 um"}])
    one = machine(speed=2000.0, sensor=[twice, sensor("B", -0.3)])
    one = one.replace(rotor__gravity="none")
    model = machine_model(one, synchronous=BOTH)
    names = [state.name for state in model.states]
    assert names[-8:] == ["U1_x", "U1_y", "U2_x", "U2_y", "r2_A_c", "r2_A_s", "r1_B_c", "r1_B_s"]
    size = np.array([state.size for state in model.states])
    X = np.random.default_rng(5).uniform(-1, 1, len(size)) * size
    X[[state.role == "disturbance force" for state in model.states]] = 0.0
    plain = continuous(one)
    moving = [names.index(state.name) for state in plain.states]
    A = plain.A + 2000.0 * plain.spin

    def rates(t, state):
        turned = [X[names.index(f"U{k}_x")] + 1j * X[names.index(f"U{k}_y")] for k in (1, 2)]
        d = A @ state
        for z, vector in zip((-0.3, 0.2), turned, strict=True):
            now = vector * np.exp(2000j * t) * 2000.0**2
            push = [now.real / 4.0, now.imag / 4.0, -z * now.imag / 0.16, z * now.real / 0.16]
            d[4:8] += push
        for name, order in (("A", 2), ("B", 1)):
            at = X[names.index(f"r{order}_{name}_c")] + 1j * X[names.index(f"r{order}_{name}_s")]
            now = at * np.exp(2000j * order * t)
            for k in (1, 2):  # the second reading is a quarter farther round, and as much later
                seen = (now * np.exp(-1j * order * (k - 1) * np.pi / 2)).real
                d[plain.place[f"x_m_{name}{k}"]] += seen / 5e-5
        return d

    exact = integrated(rates, X[moving], (0, 1e-4), size[moving])
    got = model.L @ X
    np.testing.assert_allclose(got[moving] / size[moving], exact / size[moving], atol=1e-9)
    at = names.index("U1_x")
    turned = (X[at] + 1j * X[at + 1]) * np.exp(0.2j)
    np.testing.assert_allclose(got[at : at + 2], [turned.real, turned.imag], rtol=1e-12)


def test_the_slow_disturbance_force_does_not_feel_them():
    """20 N at 12,000 rpm with 3 um of runout, 8 seeds: within 1.3 times the error without them."""
    dirty, clean = spoilt()
    plain, whole = ExtendedKalmanFilter(clean), ExtendedKalmanFilter(dirty, synchronous=BOTH)
    unaware = ExtendedKalmanFilter(dirty)
    late, ratios, spoilt_by = slice(2500, None), [], []
    for seed in range(8):
        without = simulate(clean, Scenario(duration=0.5, seed=seed)).record
        record = simulate(dirty, Scenario(duration=0.5, seed=seed)).record
        error = slow_error(plain.run(without), without, late)
        ratios.append(slow_error(whole.run(record), record, late) / error)
        spoilt_by.append(slow_error(unaware.run(record), record, late) / error)
    assert np.max(ratios) < 1.3
    assert np.min(spoilt_by) > 10  # the filter that does not know them


def test_at_constant_speed_the_stated_errors_carry_the_prior():
    """Unbalance and runout look alike there: their errors stay, and are told."""
    dirty, _ = spoilt()
    kf = ExtendedKalmanFilter(dirty, synchronous=BOTH)
    record = simulate(dirty, Scenario(duration=0.4, seed=1)).record
    estimate = kf.run(record, covariance=True)
    prior = dict(zip(estimate.names, kf.default_std(), strict=True))
    assert estimate.std("U1_x")[-1] > 0.1 * prior["U1_x"]
    assert estimate.std("r1_La_c")[-1] > 0.1 * prior["r1_La_c"]
    angle = SERVICE * record.t[-1]
    true = 20 / SERVICE**2 * np.exp(1j * (angle + 0.6))
    wrong = estimate["U1_x"][-1] + 1j * estimate["U1_y"][-1] - true
    assert abs(wrong) < 4 * estimate.std("U1_x")[-1]


RUN_UP = Ramp(slope=SERVICE / 2, start=0.0, end=2.0)


def told(record, estimate):
    """The unbalance found at the end over the true one, and its stated error."""
    true = 20 / SERVICE**2 * np.exp(1j * (turned(record) + 0.6))
    found = (estimate["U1_x"] + 1j * estimate["U1_y"])[-1] / true
    return complex(found), float(estimate.std("U1_x")[-1] / abs(true))


def turned(record):
    return float(np.sum((record["speed"][1:] + record["speed"][:-1]) / 2) * 1e-4)


def steady(one):
    """Loads wander by a fifth of the weight in a second, not by two of them."""
    usual = ExtendedKalmanFilter(one).variances.disturbance
    return FilterNoise(disturbance=tuple(each / 100 for each in usual))


@pytest.mark.parametrize("seed", range(1))
def test_a_run_up_tells_them_apart(seed):
    """Slow force and runout, by the usual filter: it thinks that loads wander by two weights a
    second, which is what limits it, and says so."""
    dirty, clean = spoilt()
    flight = Scenario(duration=2.2, seed=seed, speed=RUN_UP)
    record = simulate(dirty, flight).record
    without = simulate(clean, flight).record
    estimate = ExtendedKalmanFilter(dirty, synchronous=BOTH).run(record, covariance=True)
    turning = slice(int(np.searchsorted(record["speed"], 157.0)), None)  # from 1,500 rpm on
    error = slow_error(ExtendedKalmanFilter(clean).run(without), without, turning)
    assert slow_error(estimate, record, turning) < 1.3 * error
    ratio, stated = told(record, estimate)
    assert abs(ratio - 1) < 2 * stated < 0.13
    for k, name in enumerate(("La", "Lb", "Ra", "Rb")):
        seen = estimate[f"r1_{name}_c"] + 1j * estimate[f"r1_{name}_s"]
        runout = seen[-1] * np.exp(-1j * (turned(record) + 0.7 * k))
        assert abs(runout - 3e-6) < 4 * estimate.std(f"r1_{name}_c")[-1]


def found_by_run_ups(seeds, usual):
    """Of each seed the unbalance over the true one, and its stated error."""
    dirty, _ = spoilt()
    noise = None if usual else steady(dirty)
    kf = ExtendedKalmanFilter(dirty, synchronous=BOTH, noise=noise)
    found = []
    for seed in range(seeds):
        record = simulate(dirty, Scenario(duration=2.2, seed=seed, speed=RUN_UP)).record
        found.append(told(record, kf.run(record, covariance=True)))
    ratios, stated = zip(*found, strict=True)
    return np.array(ratios), np.array(stated)


@pytest.mark.parametrize(("seeds", "usual", "percent", "degrees"), [
    (4, False, 1.0, 0.5),
    *(pytest.param(20, *case, marks=pytest.mark.study)
      for case in ((True, 1.7, 0.8), (False, 0.8, 0.4))),
])  # fmt: skip
def test_run_ups_tell_amplitude_and_phase(seeds, usual, percent, degrees):
    """Where it knows that loads are steady, to 1 % and half a degree, within the stated errors."""
    ratios, stated = found_by_run_ups(seeds, usual)
    amplitude, phase = 100 * (np.abs(ratios) - 1), np.degrees(np.angle(ratios))
    assert np.sqrt(np.mean(amplitude**2)) < percent
    assert np.sqrt(np.mean(phase**2)) < degrees
    assert np.abs(np.mean(phase)) < 3 * np.std(phase) / np.sqrt(seeds) + 0.05  # no systematic one
    assert usual or stated.max() < 0.015
    assert (np.abs(ratios - 1) < 2 * stated).all()


@pytest.mark.parametrize("growth", [0.0, 5e3, -5e3])
def test_unbalance_pushes_across_while_the_speed_grows(growth):
    """Against integration over a sample: the angle's second derivative pushes too."""
    one = machine(speed=300.0).replace(rotor__gravity="none")
    kf = KalmanFilter(one, synchronous=("unbalance",))
    T, names = one.sampling_time, [state.name for state in kf.states]
    kf.follow_speed(np.array([250.0, 400.0]), 2)
    before, after = 300.0 - growth * T / 2, 300.0 + growth * T / 2
    start = np.zeros(len(names))
    start[names.index("U1_x")] = 1e-4
    kf.reset(start, np.full(len(names), 1e-9))
    record = Record(
        T * np.arange(2.0),
        {f"y_{r.name}": np.full(2, np.nan) for r in one.readings}
        | {f"u_{axis.name}": np.zeros(2) for axis in one.axes},
        {f"y_{r.name}": "m" for r in one.readings} | {f"u_{a.name}": "V" for a in one.axes},
    )
    y, u = kf.view.signals(record)
    speed = np.array([before, after])
    of = kf.engine.model_of_core
    got = kf.engine.core.run_turning(kf.core, y, u, speed, of)["mean"][1]
    t = np.linspace(0, T, 4001)
    angle, w = before * t + growth * t**2 / 2, before + growth * t
    push = 1e-4 * (w**2 - 1j * growth) * np.exp(1j * angle)
    moved = np.trapezoid(push, t) / 4.0
    assert got[names.index("v_x")] == pytest.approx(moved.real, rel=1e-3)
    assert got[names.index("v_y")] == pytest.approx(moved.imag, rel=1e-3)


def test_the_filter_is_a_generalised_notch():
    """What goes round with the rotor is not seen in the slow force; what goes back is."""
    one = Machine.preset("hindawi_2011").replace(speed=1000.0)
    kf = KalmanFilter(one, synchronous=("runout",))
    k = stiffnesses(one)
    linear = kf.linear_model([each.k_i for each in k], [each.k_s for each in k])
    unit = np.array(kf.default_std())
    scaled = linear.scaled(unit)
    size = np.sqrt(np.atleast_1d(linear.R))
    H = scaled.H / size[:, None]
    P = solve_discrete_are(scaled.A.T, H.T, scaled.Q + 1e-9 * np.eye(len(unit)), np.eye(len(size)))
    K = np.linalg.solve(H @ P @ H.T + np.eye(len(size)), H @ P).T
    stay = (np.eye(len(unit)) - K @ H) @ scaled.A
    at = [i for i, state in enumerate(kf.states) if state.role == "disturbance force"]

    def gain(speed):
        z = np.exp(1j * speed * one.sampling_time)
        through = np.linalg.solve(np.eye(len(unit)) - stay / z, K.astype(complex))
        forwards = np.array([[1, -1j, 0, 0], [0, 0, 1, -1j]]).T  # each plane's two readings
        return float(np.abs((through / size)[at] @ forwards).max())

    beside = min(gain(900.0), gain(1100.0), gain(-1000.0))
    assert gain(1000.0) < 1e-6 * beside


def test_each_is_switched_on_by_name():
    one = machine()
    count = len(KalmanFilter(one).states)
    assert len(KalmanFilter(one, synchronous=("unbalance",)).states) == count + 4
    assert len(KalmanFilter(one, synchronous=["runout"]).states) == count + 4
    with pytest.raises(ValueError, match="some of unbalance and runout, got 'hum'"):
        KalmanFilter(one, synchronous=("hum",))
    with pytest.raises(ValueError, match="unbalance is of a rigid or flexible rotor"):
        KalmanFilter(one.isolated_axis("A1"), synchronous=("unbalance",))


def test_a_filter_that_has_turned_comes_back():
    one = machine()
    record = simulate(one, Scenario(duration=0.1)).record
    up = simulate(one, Scenario(duration=0.1, speed=Ramp(slope=5e3))).record
    kf = KalmanFilter(one)
    before = kf.run(record)
    kf.run(up)
    np.testing.assert_allclose(kf.run(record).mean, before.mean, rtol=0, atol=1e-9)


def test_an_estimator_in_the_loop_follows_a_run_up():
    dirty, _ = spoilt()
    flight = Scenario(duration=1.0, controller={"feedback": "estimate"}, speed=Ramp(slope=SERVICE))
    kf = ExtendedKalmanFilter(dirty, synchronous=BOTH)
    run = simulate(dirty, flight, filter=kf)
    assert run.samples_at_the_stop == 0
    late = slice(5000, None)
    wrong = run.estimate["w_x"][late] - run.record["q_w_x"][late]
    assert np.sqrt(np.mean(wrong**2)) < 5e-3
    assert 0.9 < np.mean(run.estimate.nis[late]) < 1.1


@compiled
def test_they_are_exported(tmp_path):
    export_c(machine(), None, tmp_path / "c", kind="linear", prefix="f", synchronous=BOTH)
    assert "equal to the last bit" in printed_by(tmp_path / "c")
    assert "amb_real U1_x;" in (tmp_path / "c" / "f.h").read_text()


@pytest.mark.parametrize("synchronous", [(), ("unbalance",)])
def test_an_inconsistent_filter_is_named_with_and_without_unbalance_states(synchronous):
    one = Machine.preset("tum_mlps")
    record = simulate(one, Scenario(duration=0.2)).record
    quiet = [
        item.model_copy(update={"noise_variance": 0.01 * item.noise_variance})
        for item in one.sensors
    ]
    runs = {
        name: ExtendedKalmanFilter(of, synchronous=synchronous).run(record, covariance=True)
        for name, of in (("right", one), ("overconfident", one.replace(sensor=quiet)))
    }
    (note,) = unbalance_notes(one, record, runs)
    assert note.startswith("overconfident: ")
    assert ("+unbalance" in note) == (not synchronous)
