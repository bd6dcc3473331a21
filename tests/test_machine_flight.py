"""The machine in flight: its plant against integration, its presets, its touch-down bearings."""

from itertools import pairwise, product

import numpy as np
import pytest
from machine_cases import (
    PRESETS,
    RIGID,
    RIGS,
    directions,
    five_axes,
    integrated,
    machine,
    sensor,
    slopes,
    uncontrolled,
    uncoupled,
)
from quick import quick

from ambkit import AmbkitError, Machine, Scenario, magnet_of, simulate
from ambkit.machine.magnets import core_module
from ambkit.machine.parts import GRAVITY
from ambkit.models.plant import Plant
from ambkit.simulation.external_inputs import ExternalInputs
from ambkit.simulation.run import simulate_run
from ambkit.simulation.run_figure import simulation_figure
from ambkit.simulation.waveforms import Constant, HalfSine, Ramp, Step, Sum
from benchmarks.contact import stop_forces, with_stop

CORE = core_module(any_model=True)
LOADS = np.array([3.0, 0.0, -2.0, 1.0])


def released(one, X, iu, n, substeps, speed=None, q=None):  # fmt: skip
    """The plant alone from a state, with these currents demanded throughout and no control."""
    plant, p, m = Plant(one), len(one.axes), len(one.readings)
    q = np.zeros(len(one.positions)) if q is None else q
    speed = np.full(n + 1, one.speed) if speed is None else speed
    given = plant.arrays(CORE, 1, 0.0) | {"substeps": substeps}
    zero = np.zeros((n, p))
    out = CORE.simulate(
        given | uncontrolled(one), r=zero, load=zero + LOADS, base=np.zeros((n, 3)), speed=speed,
        noise_u=zero,
        noise_y=np.zeros((n, m)), place=q, start=X, current=iu, integral=iu,
    )  # fmt: skip
    return out | {"X": out["X"].T}


def at_rest(one, q, iu):
    """All states of the plant where the rotor stands still at q with these currents."""
    return np.array(released(one, None, iu, 1, 1, q=q)["X"][0])


def truth(one, iu, growth):
    """Rates of q, q', lagged readings and currents, from the equations, at any speed."""
    H, C = directions(one, one.axes), directions(one, one.readings)
    cores = [magnet_of(one.isolated_axis(axis.name)).in_core(core_module()) for axis in one.axes]
    corners = [axis.bearing.amplifier.bandwidth for axis in one.axes]
    masses = one.masses
    planes = [
        (() if one.bending is None else one.bending.shape(z), z - one.rotor.centre, amount, at)
        for z, amount, at in one.unbalances()
    ]

    def rates(t, X):
        speed, angle = one.speed + growth * t, one.speed * t + growth * t * t / 2
        m, n = C.shape
        q, w, y, i = X[:n], X[n : 2 * n], X[2 * n : 2 * n + m], X[2 * n + m :]
        current = i if i.size else iu
        F = LOADS + [
            float(core.force(np.array([a]), np.array([s]))[0])
            for core, a, s in zip(cores, current, H @ q, strict=True)
        ]
        turning = one.model_copy(update={"speed": speed})
        F = F + stop_forces(turning, (H @ q)[:, None], (H @ w)[:, None])[:, 0]
        a = slopes(one, q, w, F, speed)
        for out, arm, amount, at in planes:
            # Minus the second derivative of the offset's place, times the mass.
            turned = amount * (speed**2 - 1j * growth) * np.exp(1j * (angle + at))
            x, y_ = turned.real, turned.imag
            a += np.r_[x, y_, -arm * y_, arm * x, [o * to for o in out for to in (x, y_)]] / masses
        slow = (C @ q - y) / np.array([r.sensor.lag for r in one.readings])
        out = [w, a, slow]
        if i.size:
            out.append(2 * np.pi * np.array(corners) * (iu - i))
        return np.concatenate(out)

    return rates


@pytest.mark.parametrize(
    ("name", "growth"),
    quick(
        product([*RIGS, "compressor", "tum_mlps_flexible"], (0.0, 4e4)),
        [(name, 4e4) for name in RIGID],
        [*product(RIGS, (0.0, 4e4)), ("compressor", 4e4), ("tum_mlps_flexible", 4e4)],
    ),
)
def test_the_plant_is_met_in_the_fourth_order(name, growth):
    """Nonlinear magnets, weight, loads, unbalance, gyroscopics, a run-up; against 1e-10."""
    coarse = "0.2 ms" if name == "compressor" else "0.4 ms"  # its modes go up to 1.9 kHz
    one = Machine.preset(name).replace(speed=1000.0, delay=None, sampling_time=coarse)
    rng, n = np.random.default_rng(4), 7
    iu = rng.uniform(-0.2, 0.2, 4)
    q = np.r_[rng.uniform(-2e-5, 2e-5, 4), np.zeros(len(one.positions) - 4)]
    X = at_rest(one, q, 0.5 * iu)
    T = one.sampling_time
    speed = one.speed + growth * T * np.arange(n + 1)
    exact = integrated(truth(one, iu, growth), X, (0, (n - 1) * T), np.full(X.size, 1e-4))
    errors = []
    for substeps in (16, 32, 64):
        got = released(one, X, iu, n, substeps, speed)["X"][-1]
        errors.append(np.abs(got[:4] - exact[:4]).max() / np.abs(exact[:4]).max())
    assert errors[-1] < 1e-9
    if errors[0] > 1e-10:  # before the reference's own error counts
        for coarse, fine in list(pairwise(errors))[:1]:
            assert coarse / fine == pytest.approx(16, rel=0.3)


@pytest.mark.parametrize("speed", [200.0, -200.0, 0.0])
def test_a_rotor_that_rubs_along_its_stop_is_pushed_against_its_surface_s_motion(speed):
    """Or held, where it does not turn; against 1e-10."""
    one = with_stop(Machine.preset("ufu_rig"), 1e9, friction=0.3, radius=0.02)
    one = one.replace(speed=speed, delay=None)
    iu, n, T = np.zeros(4), 8, one.sampling_time
    q = 1.2 * one.bearings[0].clearance * np.array([0.6, -0.8, 0.0, 0.0])
    X = at_rest(one, q, iu)
    exact = integrated(truth(one, iu, 0.0), X, (0, (n - 1) * T), np.full(X.size, 1e-4))
    free = released(with_stop(one, 1e9), X, iu, n, 16)["X"][-1]
    got = released(one, X, iu, n, 16)["X"][-1]
    assert np.abs(got[:4] - exact[:4]).max() < 1e-5 * np.abs(exact[:4]).max()
    across = np.array([0.8, 0.6]) @ (got - free)[4:6]
    assert across * speed < 0 if speed else across > 0  # it slides down


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_rises_to_its_centre_at_once(name):
    one = Machine.preset(name)
    # The slowest integral is of tum_mlps_flexible: 0.35 s until the weight is carried.
    run = simulate_run(one, Scenario(start="landed", duration=1.0))
    late = slice(len(run.record) // 2, None)
    for axis in one.axes:
        assert np.abs(run.record[f"s_{axis.name}"][late]).max() < 0.1 * axis.bearing.clearance
        assert (
            np.abs(run.record[f"iu_{axis.name}"][late]).max() < axis.bearing.amplifier.current_limit
        )


@pytest.mark.parametrize("voltage", [None, 1.7])
def test_axes_that_do_not_couple_fly_as_bearings_alone(voltage):
    """Also where two coils have currents of their own, as amplifiers have not the voltage."""
    one = uncoupled()
    most, more = (20.0, 5.0) if voltage is None else (22.0, 0.1)
    if voltage is not None:
        limit = {"bandwidth": 2e3, "voltage_limit": voltage, "resistance": 0.4}
        limited = [each.amplifier.model_copy(update=limit) for each in one.bearings]
        one = one.replace(bearing=[
            each.model_copy(update={"amplifier": amplifier})
            for each, amplifier in zip(one.bearings, limited, strict=True)
        ])  # fmt: skip
    flight = Scenario(duration=0.05, noise=False, disturbance=[
        {"axis": axis.name, "force": Step(amplitude=most + more * k, time=0.01)}
        for k, axis in enumerate(one.axes)
    ]).fed("measurement")  # fmt: skip
    run = simulate_run(one, flight)
    for k, axis in enumerate(one.axes):
        push = Step(amplitude=most + more * k, time=0.01)
        scenario = Scenario(
            duration=0.05, noise=False, disturbance=push, controller={"feedback": "measurement"}
        )
        alone = simulate(one.isolated_axis(axis.name), scenario).record
        if voltage is not None:
            assert np.abs(alone["u_coil"]).max() > 0.999 * voltage
        for name, of_machine in (("x", "s"), ("u", "u"), ("f_mag", "f_mag")):
            got, expected = run.record[f"{of_machine}_{axis.name}"], alone[name]
            near = 1e-9 if voltage is None else 1e-5  # a limit is met within a substep
            np.testing.assert_allclose(got, expected, rtol=0, atol=near * np.abs(expected).max())


def test_unbalance_goes_round_and_a_run_up_passes_the_critical_speeds():
    one = machine(unbalance=[{"place": 0.0, "amount": "30 g mm"}])
    steady = simulate_run(one, Scenario(duration=0.3, noise=False)).record
    late = slice(2000, None)  # 8 turns
    x, y = (steady[f"q_{q}"][late] - steady[f"q_{q}"][late].mean() for q in "xy")
    np.testing.assert_allclose(np.hypot(x, y), np.hypot(x, y).mean(), rtol=0.02)
    assert (x[:-1] * y[1:] - y[:-1] * x[1:] > 0).all()  # forwards
    growth = Ramp(slope=2000.0, start=0.0)
    run = simulate_run(one, Scenario(duration=1.0, noise=False, speed=growth)).record
    far = np.hypot(run["q_x"] - run["q_x"][0], run["q_y"])
    assert 2000 < np.argmax(far) < 8000  # the greatest whirl is neither at the start nor at the end
    assert run["speed"][-1] == pytest.approx(2000.0)


def test_runout_is_seen_and_not_there():
    """Of a profile on the shaft, the second reading sees what the first saw, a quarter later."""
    runout = [{"order": 1, "amplitude": "3 um", "phase": 0.4}]
    one = machine(sensor=[sensor("A", 0.2, runout=runout, lag=1e-6), sensor("B", -0.3)])
    run = simulate_run(one, Scenario(duration=0.002, noise=False)).record
    t = run.t
    for name, around in (("1", 0.0), ("2", np.pi / 2)):
        seen = run[f"y_A{name}"] - run[f"s_A{name}"]
        expected = 3e-6 * np.cos(500.0 * t + 0.4 - around)
        np.testing.assert_allclose(seen, expected, rtol=0, atol=5e-9)


def test_a_delay_acts_as_late_as_it_says():
    for delay in (1e-4, 1.3e-4):
        late = machine(delay=delay)
        force = {"axis": "A1", "force": Step(amplitude=40.0, time=0.01)}
        run = simulate_run(late, Scenario(duration=0.1, noise=False, disturbance=[force]))
        demand = run.record["u_A1"] * late.axes[0].bearing.amplifier.gain
        current = run.record["iu_A1"]
        behind = int(np.ceil(delay / late.sampling_time - 1e-9))
        np.testing.assert_allclose(current[behind:], demand[: len(demand) - behind], rtol=1e-12)
        assert run.samples_at_the_stop == 0


def test_a_thrust_bearing_carries_a_standing_rotor():
    one = five_axes().replace(rotor__gravity="-z")
    run = simulate_run(one, Scenario(duration=0.2, start="landed")).record
    assert run["s_T"][0] == pytest.approx(-0.3e-3)
    assert run["f_mag_T"][-500:].mean() == pytest.approx(4 * 9.81, rel=0.01)
    assert np.abs(run["s_T"][-500:]).max() < 2e-5


def test_what_does_not_fit_is_refused():
    force = [{"axis": "C1", "force": Constant(value=1.0)}]
    with pytest.raises(AmbkitError, match="there is no axis C1; there are A1, A2, B1, B2"):
        simulate_run(machine(), Scenario(disturbance=force))
    with pytest.raises(AmbkitError, match="half a revolution within a sample"):
        simulate_run(machine(), Scenario(speed=Constant(value=4e4)))
    shaken = [{"direction": "z", "acceleration": Constant(value=1.0)}]
    with pytest.raises(AmbkitError, match="no thrust bearing"):
        simulate_run(machine(), Scenario(base=shaken))


def test_several_forces_of_an_axis_add_up():
    one = machine()
    two = [
        {"axis": "A1", "force": Constant(value=4.0)},
        {"axis": "A1", "force": Constant(value=6.0)},
    ]
    parts = Sum(parts=(Constant(value=4.0), Constant(value=6.0)))
    first = simulate_run(one, Scenario(duration=0.01, disturbance=two)).record
    second = simulate_run(
        one, Scenario(duration=0.01, disturbance=[{"axis": "A1", "force": parts}])
    )
    np.testing.assert_array_equal(first["s_A1"], second.record["s_A1"])


def test_a_foundation_that_moves_is_a_force_on_the_centre_of_mass():
    one = machine(unbalance=[{"place": 0.1, "amount": 2e-5}])
    shock = HalfSine(amplitude=50.0, time=0.01, duration=0.011)
    shaken = simulate_run(
        one, Scenario(duration=0.05, base=[{"direction": "y", "acceleration": shock}])
    ).record
    H = directions(one, one.axes)
    spread = np.linalg.pinv(H.T) @ np.array([0.0, -one.rotor.mass, 0.0, 0.0])
    pushed = shock.sample(shaken.t)[:, None] * spread
    other = simulate_run(
        one, Scenario(duration=0.05), external_inputs=ExternalInputs(pushed)
    ).record
    assert np.abs(shaken["s_A2"]).max() > 1e-5
    for axis in one.axes:
        got, expected = (run[f"s_{axis.name}"] for run in (shaken, other))
        np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_array_equal(shaken["base_y"], shock.sample(shaken.t))


def test_a_foundation_that_falls_leaves_a_rotor_without_weight():
    lying = machine(speed=0.0).replace(rotor__gravity="-x")
    falls = [{"direction": "x", "acceleration": Constant(value=-GRAVITY)}]
    still = simulate_run(lying, Scenario(duration=0.6, noise=False, base=falls)).record
    for axis in lying.axes:
        assert np.abs(still[f"iu_{axis.name}"][-100:]).max() < 1e-3
    assert still["iu_A1"][0] > 0.05


def test_a_whole_rotor_drops_and_lies_still():
    """Where the power fails at 20 ms: free fall, the touch-down bearings, then nothing moves."""
    run = simulate_run(machine(speed=0.0), Scenario(duration=0.4, noise=False, off=0.02))
    record = run.record
    falling = slice(201, 251)
    t = record.t[falling] - 0.02
    np.testing.assert_allclose(
        record["q_x"][falling], -GRAVITY / 2 * t**2 + record["q_x"][200], rtol=0, atol=2e-9
    )
    assert run.samples_at_the_stop > 1000
    assert np.abs(record["q_v_x"][-500:]).max() < 2e-3
    deepest = np.hypot(record["s_A1"], record["s_A2"]).max()
    assert 0.3e-3 < deepest < 0.4e-3
    assert np.abs(record["f_mag_A1"][201:]).max() == 0
    assert np.array_equal(run.energised, np.arange(len(run.energised)) < 200)
    assert max(run.to_dict()["maximum_current"].values()) < 2
    drawn = simulation_figure(run).panels[-1]
    assert np.isfinite(drawn.items[0].y).sum() == 200
    assert drawn.x.limits == (0.0, 0.4)
