"""Controllers of machines: what they hold, what of the unbalance they let through."""

from itertools import product

import control
import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import KalmanFilter, Machine
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.control.control import Control
from ambkit.control.controllers import controllers_of
from ambkit.control.pid import PID
from ambkit.control.regulator import regulator
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.machine.magnets import ConstantStiffness
from ambkit.models.plant import Plant
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Disturbance, Reference, Scenario
from ambkit.simulation.waveforms import Ramp, Step

MACHINES = ("hindawi_2011", "tum_mlps", "ufu_rig")
TYPES = ("decentralised", "translation and tilt", "lqg")
KINDS = [
    ("decentralised", "measurement"),
    ("decentralised", "estimate"),
    ("translation and tilt", "measurement"),
    ("translation and tilt", "estimate"),
    ("lqg", "estimate"),
]


def displacements(run):
    return np.array([run.record[f"s_{axis.name}"] for axis in run.machine.axes])


def round_turns(run, signal, since):
    """Return the amplitude of a signal at the speed of rotation, over whole turns."""
    t, w = run.record.t, run.machine.speed
    turns = np.floor((t[-1] - since) * w / (2 * np.pi)) * 2 * np.pi / w
    late = (t >= since) & (t < since + turns)
    return abs(2 * np.mean(run.record[signal][late] * np.exp(-1j * w * t[late])))


@pytest.mark.parametrize(("name", "kind", "feedback"), quick(
    [(name, *kind) for name in MACHINES for kind in KINDS],
    [(MACHINES[k % len(MACHINES)], *kind) for k, kind in enumerate(KINDS)],
))  # fmt: skip
def test_a_rotor_follows_its_reference_and_carries_a_load(name, kind, feedback):
    machine = Machine.preset(name)
    first, third = machine.axes[0].name, machine.axes[2].name
    flight = Scenario(
        duration=1.2, noise=False, controller=Control(type=kind),
        reference=(Reference(axis=first, position=Step(amplitude=2e-5, time=0.1)),),
        disturbance=(Disturbance(axis=third, force=Step(amplitude=5.0, time=0.5)),),
    ).fed(feedback)  # fmt: skip
    # A regulator has no integral of its own: its filter's model is that of its design, whose error
    # is in the disturbance force. With the law known to the filter 5 % of the reference are left.
    linear = KalmanFilter(machine) if (kind, feedback) == ("lqg", "estimate") else None
    run = simulate_run(machine, flight, estimator=linear)
    s = displacements(run)
    assert run.record.meta["stop_touched"] == 0
    at_last = s[:, run.record.t > 1.0].mean(axis=1)  # it turns round that place
    assert at_last == pytest.approx([2e-5, 0, 0, 0], abs=4e-7)
    before = run.record.t < 0.5
    assert s[0, before].max() < 1.6 * 2e-5


@pytest.mark.parametrize(("kind", "feedback"), KINDS)
def test_a_rotor_lifts_off_from_its_backup_bearings(kind, feedback):
    machine = Machine.preset("tum_mlps")
    flight = Scenario(duration=1.0, start="landed", controller=Control(type=kind)).fed(feedback)
    s = displacements(simulate_run(machine, flight))
    assert np.abs(s[:, 0]).max() > 1e-4
    assert np.abs(s[:, -1]).max() < 5e-6


LEFT = {"ufu_flexible": (9000, 0.05, 0.25), "tum_mlps_flexible": (9000, 0.6, 0.8)}
"""Speed [rpm], and how much is left at most of the force let go and of the orbit compensated.

Above the rigid critical speeds, and beyond the first bending mode; of tum_mlps_flexible, with
0.03 N and 50 nm, there is not much to be had: noise makes most of what is left.
"""
BENDING = [("ufu_flexible", "decentralised"), ("ufu_flexible", "lqg"),
           ("tum_mlps_flexible", "decentralised")]  # fmt: skip


@pytest.mark.parametrize(("name", "kind"), quick(
    [*product(MACHINES, TYPES), *BENDING], [*zip(MACHINES, TYPES, strict=True), BENDING[0]]
))  # fmt: skip
def test_unbalance_is_force_free_or_compensated(name, kind):
    """By the force of a magnet and by the orbit."""
    rpm, small, still = LEFT.get(name, (12_000, 0.06, 0.5))
    machine = Machine.preset(name).replace(speed=f"{rpm} rpm")
    axis = machine.axes[0].name
    force, orbit = {}, {}
    for unbalance in ("off", "force-free", "compensation"):
        control = Control(type=kind, unbalance=unbalance)
        flight = Scenario(duration=1.0, controller=control).fed("estimate")
        filter = KalmanFilter(machine, synchronous=["unbalance"])
        run = simulate_run(machine, flight, estimator=filter)
        assert run.samples_at_the_stop == 0
        force[unbalance] = round_turns(run, f"f_mag_{axis}", 0.7)
        orbit[unbalance] = round_turns(run, f"s_{axis}", 0.7)
    assert force["force-free"] < small * force["off"]
    assert orbit["compensation"] < still * orbit["off"]


def test_through_the_bending_mode_unbalance_control_is_off_and_beyond_force_free():
    machine = Machine.preset("ufu_flexible").replace(speed="9000 rpm")
    speed = Ramp(slope=machine.speed / 1.2, end=1.2)
    runs = {}
    for told in (Control(), Control(unbalance="force-free", unbalance_from="7000 rpm")):
        flight = Scenario(duration=1.5, controller=told, speed=speed).fed("estimate")
        filter = KalmanFilter(machine, synchronous=["unbalance"])
        runs[told.unbalance] = simulate_run(machine, flight, estimator=filter)
    below = np.searchsorted(runs["off"].record["speed"], 7000 * np.pi / 30)
    fought, free = (displacements(run) for run in runs.values())
    np.testing.assert_array_equal(free[:, :below], fought[:, :below])
    assert np.abs(free).max() < 1.05 * np.abs(fought).max()
    late = slice(-2000, None)
    shaken, less = (np.std(run.record["f_mag_A1"][late]) for run in runs.values())
    assert less < 0.6 * shaken  # what is left is noise


def test_poles_of_the_loop_do_not_move_by_what_is_left_to_turn():
    machine = Machine.preset("ufu_flexible").replace(speed="6300 rpm", unbalance=[])
    filter = KalmanFilter(machine, synchronous=["unbalance"])
    poles = []
    for told in (Control(), Control(unbalance="compensation")):
        poles.append(LoopBuilder(machine, told).loop(filter).closed.poles())
    away = np.abs(poles[0][:, None] - poles[1][None, :]).min(axis=1)
    assert away.max() < 1e-5  # of double ones the digits are half as many
    assert np.abs(poles[1]).max() < 1


def test_cross_feedback_takes_the_gyroscopics_back():
    """All of it, and the rotor in its magnets has the dynamics that it has at rest."""
    plant, machine = Plant(Machine.preset("tum_mlps")), Machine.preset("tum_mlps")
    filter = KalmanFilter(machine)
    found = controllers_of(plant, Control(cross_feedback=1.0), filter)
    k_i = np.array([ConstantStiffness.of(alone).k_i for alone in plant.isolated])
    q = len(machine.positions)
    fed = found.feedback["fed_back_by_speed"]
    assert not fed[:, :q].any()
    taken = (plant.model.b @ (k_i[:, None] * fed[:, q : 2 * q]))[q : 2 * q]
    spin = plant.model.spin[q : 2 * q, q : 2 * q]
    assert np.abs(spin).max() > 0
    assert taken == pytest.approx(-spin, abs=1e-12 * np.abs(spin).max())


def test_cross_feedback_damps_the_nutation():
    """In flight, with lags and noise: what a kick of the tilt leaves is less with it."""
    machine = Machine.preset("tum_mlps").replace(speed="30000 rpm", unbalance=[])
    left = []
    for share in (0.0, 0.5):
        kick = Step(amplitude=20.0, time=0.1)
        flight = Scenario(
            duration=0.4, noise=False,
            controller=Control(type="translation and tilt", cross_feedback=share),
            disturbance=(Disturbance(axis=machine.axes[0].name, force=kick),),
        ).fed("estimate")  # fmt: skip
        run = simulate_run(machine, flight)
        across = run.record[f"s_{machine.axes[1].name}"]
        left.append(np.abs(across).max())
    assert left[1] < 0.8 * left[0]


def test_the_regulator_is_controls_own():
    machine = Machine.preset("tum_mlps")
    plant, filter = Plant(machine), KalmanFilter(machine)
    K, ahead = regulator(plant, filter)
    k = [ConstantStiffness.of(alone) for alone in plant.isolated]
    model = filter.linear_model(np.array([e.k_i for e in k]), np.array([e.k_s for e in k]))
    q = 2 * len(machine.positions)
    A, B = model.A[:q, :q], model.B[:q]
    travel = np.array([alone.clearance for alone in plant.isolated])
    limit = np.array([min(abs(b.current_min), b.current_max) for b in plant.isolated])
    C = plant.H / (0.1 * travel)[:, None]
    Q = np.zeros((q, q))
    Q[: q // 2, : q // 2] = C.T @ C
    theirs, _, _ = control.dlqr(A, B, Q, np.diag(1 / (0.2 * limit) ** 2), method="scipy")
    assert K[:, :q] == pytest.approx(theirs, rel=1e-6, abs=1e-6 * np.abs(theirs).max())
    # Held by it at rest: the reference is reached, and a load moves nothing.
    closed = np.linalg.inv(np.eye(q) - A + B @ K[:, :q])
    reached = plant.H @ (closed @ B @ ahead)[: q // 2]
    assert reached == pytest.approx(np.eye(len(travel)), abs=1e-9)
    loads = [j for j, state in enumerate(filter.states) if state.role == "disturbance force"]
    moved = closed @ (model.A[:q][:, loads] - B @ K[:, loads])
    assert np.abs(plant.H @ moved[: q // 2]).max() < 1e-12


@pytest.mark.parametrize(
    ("control", "feedback", "message"),
    [
        (Control(type="lqg"), "measurement", 'feedback must be "estimate"'),
        (Control(cross_feedback=0.5), "measurement", "cross_feedback"),
        (Control(unbalance="compensation"), "measurement", 'unbalance = "compensation"'),
        (Control(unbalance="force-free"), "estimate", "no unbalance among its states"),
        (
            Control(unbalance="compensation", unbalance_from=50.0),
            "estimate",
            "no unbalance among its states",
        ),
    ],
)
def test_what_cannot_be_is_refused(control, feedback, message):
    machine, scenario = Machine.preset("tum_mlps"), Scenario(duration=0.1, controller=control)
    with pytest.raises(AmbkitError, match=message):
        simulate_run(machine, scenario.fed(feedback), estimator=KalmanFilter(machine))


@pytest.mark.parametrize(("unbalance", "peak"), [("force-free", 6320.0), ("compensation", 5410.0)])
@pytest.mark.parametrize("size", [1e-9, 1e-3])
def test_near_its_bending_nothing_is_left_to_the_rotor_however_small_its_unbalance(
    unbalance, peak, size
):
    """At the critical speeds of the free rotor, and of the one that is held still."""
    one = Machine.preset("ufu_flexible")
    machine = one.replace(
        speed="9000 rpm", unbalance=[{"place": one.unbalance[0].place, "amount": size}]
    )
    filter = KalmanFilter(machine, synchronous=["unbalance"])
    turn = controllers_of(Plant(machine), Control(unbalance=unbalance), filter).unbalance_control
    rpm = np.linspace(500.0, 9000.0, 2000)
    share = np.array([turn.share_at(each * np.pi / 30) for each in rpm])
    assert not share[np.abs(rpm - peak) < 0.03 * peak].any()
    assert (share[np.abs(rpm - 3600.0) < 300.0] == 1.0).all()
    assert (share[rpm > 8000.0] == 1.0).all()
    assert np.abs(np.diff(share)).max() < 0.1  # it fades
    assert "rpm" in turn.sentence(unbalance, 0.0, machine.speed)
    assert turn.sentence(unbalance, 8000 * np.pi / 30, machine.speed) is None


@pytest.mark.parametrize("unbalance", ["force-free", "compensation"])
def test_the_limit_of_a_large_unbalance_is_that_of_the_core(unbalance):
    machine = Machine.preset("ufu_flexible").replace(speed="9000 rpm")
    filter = KalmanFilter(machine, synchronous=["unbalance"])
    turn = controllers_of(Plant(machine), Control(unbalance=unbalance), filter).unbalance_control
    one = np.array([1e-6, 2e-6, -1e-6, 0.5e-6])[: turn.motion.shape[2]]
    sizes = np.geomspace(1.0, 1e4, 4000)
    share = np.array([turn.limited(machine.speed, size * one) for size in sizes])
    assert share[0] == 1.0
    assert share[-1] == 0.0
    assert (np.diff(share) <= 0).all()
    assert np.abs(np.diff(share)).max() < 0.02


def test_there_must_be_speeds_at_which_it_is_force_free():
    one = Machine.preset("ufu_flexible")
    filter = KalmanFilter(one, synchronous=["unbalance"])
    with pytest.raises(AmbkitError, match="is not below the greatest speed"):
        controllers_of(Plant(one), Control(unbalance="compensation", unbalance_from=500.0), filter)
    with pytest.raises(ConfigError, match="unbalance_from"):
        Control(unbalance_from=50.0)


def test_a_flight_s_file_says_how_the_machine_is_controlled(tmp_path):
    flight = Scenario(controller=Control(type="lqg", unbalance="compensation"))
    assert Scenario.from_toml(flight.to_toml()) == flight
    path = tmp_path / "scenario.toml"
    path.write_text('duration = "20 ms"\n\n[controller]\nfeedback = "estimate"\ntype = "lqg"\n')
    assert ambkit.simulate(Machine.preset("tum_mlps"), Scenario.load(path)).estimate


HINDAWI = Machine.preset("hindawi_2011").replace(unbalance=[])
LOADED = (Disturbance(axis="A1", force=Step(amplitude=20.0, time=0.1)),)


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
def test_a_pid_can_see_a_sensor_that_is_not_beside_its_magnet(feedback):
    """Where the other end is moved, its integral holds the rotor at the sensor, not at its axis."""
    own = Control(pid={axis.name: PID(sees=axis.name) for axis in HINDAWI.axes})
    moved = (Reference(axis="A1", position=Step(amplitude=2e-5, time=0.1)),)
    for seen, still, not_still in ((Control(type="decentralised"), "s", "y"), (own, "y", "s")):
        flight = Scenario(duration=1.2, noise=False, controller=seen, reference=moved).fed(feedback)
        run = simulate_run(HINDAWI, flight)
        late = run.record.t > 1.1
        at = {what: run.record[f"{what}_B1"][late].mean() for what in "ys"}
        assert abs(at[still]) < 2e-9
        assert abs(at[not_still]) == pytest.approx(2e-5 * 0.02 / 0.38, rel=0.06)


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
def test_a_pid_sees_a_sum_of_readings(feedback):
    """Half of both ends is the middle: all of one end's is what its name alone is."""
    scenario = Scenario(
        duration=0.05, noise=False, controller={"feedback": feedback}, disturbance=LOADED
    )

    def run(sees):
        own = Control(pid={axis.name: PID(sees=sees(axis.name)) for axis in HINDAWI.axes})
        return simulate_run(HINDAWI, scenario.replace(controller=own.fed_by(feedback)))

    named, one = run(lambda name: name), run(lambda name: {name: 1.0})
    np.testing.assert_array_equal(named.record["iu_B1"], one.record["iu_B1"])
    law = controllers_of(
        Plant(HINDAWI), Control(type="decentralised", pid={"A1": PID(sees={"A1": 0.4, "B1": 0.6})}),
        KalmanFilter(HINDAWI) if feedback == "estimate" else None,
    )  # fmt: skip
    if feedback == "measurement":
        gains = [r.sensor.gain for r in HINDAWI.readings]
        at = [r.name for r in HINDAWI.readings].index
        seen = np.zeros(len(gains))
        seen[at("A1")], seen[at("B1")] = 0.4 / gains[at("A1")], 0.6 / gains[at("B1")]
        np.testing.assert_allclose(law.measured[0], seen)
    else:
        C = KalmanFilter(HINDAWI).view.C
        names = [r.name for r in HINDAWI.readings]
        row = 0.4 * C[names.index("A1")] + 0.6 * C[names.index("B1")]
        np.testing.assert_allclose(law.feedback["position"][0][: len(row)], row)
        np.testing.assert_allclose(law.feedback["velocity"][0][len(row) : 2 * len(row)], row)


def test_a_pid_sees_an_estimated_state():
    kalman = KalmanFilter(HINDAWI)
    control = Control(type="decentralised", pid={"A1": PID(sees="th_y")})
    law = controllers_of(Plant(HINDAWI), control, kalman)
    names = [state.name for state in kalman.states]
    assert law.feedback["position"][0].tolist() == [float(name == "th_y") for name in names]
    (moves,) = np.flatnonzero(law.feedback["velocity"][0])
    assert kalman.states[moves].role == "velocity"
    with pytest.raises(AmbkitError, match=r"pid\.A1\.sees: there is no th_y; known: A1"):
        controllers_of(Plant(HINDAWI), control, None)


def test_a_sensor_that_is_not_there_is_refused():
    control = Control(pid={"B1": PID(sees="C1")})
    with pytest.raises(AmbkitError, match=r"controller\.pid\.B1\.sees: there is no C1; known: A1"):
        simulate_run(HINDAWI, Scenario(duration=0.01, controller=control).fed("measurement"))
    with pytest.raises(ConfigError, match="is of an axis"):
        Control(type="translation and tilt", pid={"x": PID(sees="A1")})


def test_currents_take_an_estimated_load_back_at_once():
    most = []
    for share in (0.0, 0.8):
        control = Control(pid={axis.name: PID(feed_forward=share) for axis in HINDAWI.axes})
        flight = Scenario(duration=0.4, noise=False, controller=control, disturbance=LOADED).fed(
            "estimate"
        )
        most.append(np.abs(displacements(simulate_run(HINDAWI, flight))).max())
    assert most[1] < 0.6 * most[0]
    with pytest.raises(AmbkitError, match="feed_forward is made of the estimate"):
        simulate_run(HINDAWI, flight.fed("measurement"))
