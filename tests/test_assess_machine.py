"""Margins of whole machines: against figures computed independently, the core, and the simulation.

The reference is in complex coordinates: the TUM MLPS rotor with decentralised PD, continuous and
sampled.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import AND_LONG, PRESETS, uncoupled
from test_cli import Result

import ambkit
from ambkit import PID, Machine, Record, Recorded
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.cli.main import main
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.identification.excitation.signals import sparse_multisine
from ambkit.judge.loop.bounds import least_peak_of_delay, least_peaks
from ambkit.judge.loop.margins import bode_integral, grid, highest
from ambkit.models.linear import LinearSystem, Signal
from ambkit.simulation.flight import Flight, Injection
from ambkit.simulation.holding import holding
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at
from ambkit.simulation.machine import simulate_machine
from ambkit.workflow.assessing import MEASUREMENT
from ambkit.workflow.loop_of import LoopOf
from ambkit.workflow.over_speed import assess_over_speed, told_speed
from ambkit.workflow.verdict import verdict, write_verdict

RPM = math.pi / 30
UFU = Machine.preset("ufu_rig")


def made(name, machine, **options):
    return KINDS[name].make(machine, learned_magnet(name, machine), **options)


def reference(**keys):
    """The TUM rotor of the reference: sensors at the magnets, amplifiers of 1.5 kHz."""
    tum = Machine.preset("tum_mlps")
    amplifier = {"bandwidth": 1500.0}
    bearings = [
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update=amplifier), "angle": 0.0})
        for at in tum.bearing
    ]
    sensors = [
        tum.sensor[0].model_copy(update={"name": at.name, "place": at.place, "angle": 0.0,
                                         "lag": 16e-6})
        for at in bearings
    ]  # fmt: skip
    weightless = tum.rotor.model_copy(update={"gravity": "none"})
    return tum.model_copy(
        update={"rotor": weightless, "bearing": tuple(bearings), "sensor": tuple(sensors),
                "unbalance": (), "speed": 0.0} | keys
    )  # fmt: skip


def of_axes(A, B, C, D, system, T):
    """The same controller for each axis of a plant."""
    one = np.eye(4)
    names = [at.name for at in system.outputs[:4]]
    return LinearSystem(
        np.kron(one, A), np.kron(one, B), -np.kron(one, C), -np.kron(one, D), T,
        tuple(Signal(f"{k}_{n}", "m") for n in names for k in range(len(A))), system.outputs[:4],
        system.inputs[:4],
    )  # fmt: skip


def continuous_loop(machine, delay, kp, kd, corner, ki=0.0):
    """PID of a machine in continuous time, its derivative with a corner [rad/s]."""
    prompt = machine.model_copy(update={"delay": None})
    system = plant(prompt, WorkPoint.of_machine(prompt), continuous=True)
    A, B = np.diag([-corner, 0.0]), np.array([[1.0], [ki]])
    C, D = np.array([[-kd * corner**2, 1.0]]), np.array([[kp + kd * corner]])
    if not ki:
        A, B, C = A[:1, :1], B[:1], C[:, :1]
    return Loop(system, of_axes(A, B, C, D, system, None), 4, delay=delay)


# ---- the reference in complex coordinates


def test_continuous_reference():
    machine = reference(sampling_time=1e-6, sensor=tuple(
        at.model_copy(update={"lag": 1e-12}) for at in reference().sensor
    ))  # fmt: skip
    loop = continuous_loop(machine, 1.5e-4, 8000.0, 15.0, 2 * math.pi * 2000)
    f = np.linspace(50, 500, 901)
    for axes, peak, where in (((0, 1), 1.3690, 169.4), ((2, 3), 1.3737, 200.8)):
        for axis in axes:
            found = highest(lambda at, k=axis: loop.of_axis(k, at), f)
            assert found == (pytest.approx(peak, abs=5e-5), pytest.approx(where, abs=0.05))
    assert highest(loop.largest_sensitivity, f)[0] == pytest.approx(1.5802, abs=5e-5)
    found = bode_integral(loop)
    # Both planes are twice one plane in complex coordinates.
    assert 2 * math.pi * found.poles / 2 == pytest.approx(4953.75, rel=1e-6)
    assert found.integral == pytest.approx(found.poles, rel=1e-6)
    assert found.holds


@pytest.mark.parametrize(
    ("dead_time", "peaks", "largest"),
    [(1.0, (1.390, 1.396), 1.602), (1.5, (1.462, 1.473), 1.674)],
)
def test_sampled_reference(dead_time, peaks, largest):
    T = 1e-4
    machine = reference(delay=dead_time * T)
    system = plant(machine, WorkPoint.of_machine(machine))
    steep, corner = 2 / T, 2 * math.pi * 2000  # PD by Tustin
    pole, D = (steep / corner - 1) / (1 + steep / corner), 15.0 * steep / (1 + steep / corner)
    pd = of_axes(np.array([[pole]]), np.eye(1), np.array([[D * (pole - 1)]]),
                 np.array([[8000.0 + D]]), system, T)  # fmt: skip
    loop = Loop(system, pd, 4)
    f = grid(loop)
    found = [highest(lambda at, k=k: loop.of_axis(k, at), f)[0] for k in range(4)]
    assert found == pytest.approx([peaks[0], peaks[0], peaks[1], peaks[1]], abs=6e-4)
    assert highest(loop.largest_sensitivity, f)[0] == pytest.approx(largest, abs=6e-4)
    integral = bode_integral(loop)
    assert 2 * math.pi * integral.integral == pytest.approx(0.99075025, rel=1e-7)
    assert integral.holds


def test_least_peak_by_the_dead_time_is_that_of_the_fastest_pole():
    machine = reference()
    system = plant(machine, WorkPoint.of_machine(machine), continuous=True)
    y = [at.name for at in system.outputs[:4]]
    found = least_peak_of_delay(system.select(y, [at.name for at in system.inputs[:4]]), 1.5e-4)
    assert found == pytest.approx(math.exp(446.106 * 1.5e-4), rel=1e-6)
    assert found == pytest.approx(1.069, abs=5e-4)
    # Sampled so fast that neither hold nor lags count, the dead time is what is left.
    fast = reference(sampling_time=1e-5, delay=1.4e-4, sensor=tuple(
        at.model_copy(update={"lag": 1e-9}) for at in machine.sensor
    ), bearing=tuple(
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update={"bandwidth": None})})
        for at in machine.bearing
    ))  # fmt: skip
    sampled = plant(fast, WorkPoint.of_machine(fast))
    bounds = least_peaks(sampled.select(y, [at.name for at in sampled.inputs[:4]]))
    assert bounds == pytest.approx((found, found), rel=2e-3)


# ---- Bode's integral


@pytest.mark.parametrize("name", AND_LONG)
@pytest.mark.parametrize("rpm", [0.0, 30_000.0])
def test_bodes_integral_of_presets(name, rpm):
    preset = Machine.preset(name).model_copy(update={"speed": rpm * RPM, "unbalance": ()})
    for kind in (None, "linear", "extended"):
        loop = LoopOf(preset).loop(made(kind, preset) if kind else None)
        assert loop.is_stable
        found = bode_integral(loop)
        assert found.poles > 0.05
        assert found.integral == pytest.approx(found.poles, rel=1e-6)
        assert found.holds


@pytest.mark.parametrize("name", AND_LONG)
@pytest.mark.parametrize("rpm", [0.0, 30_000.0])
def test_bodes_integral_of_presets_in_continuous_time(name, rpm):
    """With an integrator, whose singularity at 0 is handled, and a dead time with its tail."""
    preset = Machine.preset(name).model_copy(update={"speed": rpm * RPM})
    pid = holding(preset).pids[0]  # which bending does not shake
    loop = continuous_loop(
        preset if len(preset.readings) == 4 else reference(speed=rpm * RPM), 1e-4, pid.kp, pid.kd,
        1 / pid.derivative_filter, pid.ki,
    )  # fmt: skip
    found = bode_integral(loop)
    assert found.poles > 100
    assert found.integral == pytest.approx(found.poles, rel=1e-6)


def test_bodes_integral_tells_an_unstable_machine():
    loop = LoopOf(UFU, PID(kp=500.0, ki=0.0, kd=1.0)).loop()
    assert not loop.is_stable
    assert not bode_integral(loop).holds


# ---- the pieces against what computes


@pytest.mark.parametrize("name", ["linear", "extended", "unscented", "ud"])
def test_estimator_is_the_cores_at_its_work_point(name):
    """Driven off a rest where its gain has settled, by small random y and u."""
    machine = UFU
    estimator, point = made(name, machine, frozen_limit=0), WorkPoint.of_machine(machine)
    p, m = len(machine.axes), len(machine.readings)
    rng, size = np.random.default_rng(0), 1e-9
    for _ in range(30_000):
        estimator.step(np.zeros(m), point.iu)
    linear = estimator_at(estimator, point)
    whole = estimator.whole
    rows = np.vstack([whole.H @ np.eye(len(estimator.states))[
        [k for k, at in enumerate(estimator.states) if at.role == role]
    ] for role in ("position", "velocity")])  # fmt: skip
    start = rows @ estimator.mean
    dy = size * rng.standard_normal((300, m))
    du = size * 3e3 * rng.standard_normal((301, p))
    state, error, moved = np.zeros(len(linear.A)), [], []
    for k in range(300):
        w = np.concatenate([dy[k], du[k]])
        expected = linear.C @ state + linear.D @ w
        state = linear.A @ state + linear.B @ w
        estimator.step(dy[k], point.iu + (du[k - 1] if k else 0.0))
        found = rows @ estimator.mean - start
        error.append(found - expected)
        moved.append(found)
    worst = np.abs(error).max(axis=0) / np.abs(moved).max(axis=0)
    assert (worst < 2e-3).all(), worst


def test_axes_that_do_not_couple_are_bearings_alone():
    machine = uncoupled()
    found = ambkit.assess(machine, "linear")
    for name, axis in found.loops[MEASUREMENT].axes.items():
        alone = machine.alone(name).replace(rotor__gravity="none")
        expected = ambkit.assess(alone).loops[MEASUREMENT].worst
        for figure in ("peak", "peak_frequency", "current_noise", "position_noise"):
            assert getattr(axis, figure) == pytest.approx(getattr(expected, figure), rel=1e-6)
        for figure in ("gain_up", "gain_down", "phase", "delay", "disk", "crossover", "bandwidth"):
            one, other = (getattr(each.margins, figure) for each in (axis, expected))
            assert one == pytest.approx(other, rel=1e-5), figure
        capacity = axis.demands.capacity
        assert capacity.current == pytest.approx(expected.demands.capacity.current, rel=1e-3)
        assert capacity.static == pytest.approx(expected.demands.capacity.static, rel=1e-9)
    alone = {name: ambkit.assess(machine.alone(name)).least for name in ("A1", "B1")}
    assert found.least == pytest.approx(max(alone.values()), rel=1e-6)


def test_an_axis_is_looked_at_where_its_controller_takes_its_position():
    """With two sensors for each bearing: as if the shown positions were the measurements."""
    of = LoopOf(Machine.preset("tum_mlps"))
    loop = of.loop()
    assert loop.measurements == 8
    assert loop.axes == 4
    P, K, m = of.plant, loop.compensator, 8
    seen = replace(
        P, C=np.vstack([of.shown @ P.C[:m], P.C[m:]]), D=np.zeros((8, 8)),
        outputs=(*P.outputs[:4], *P.outputs[m:]),
    )  # fmt: skip
    back = of.added  # the shown positions, spread over the readings
    inner = replace(
        K, B=np.hstack([K.B[:, :m] @ back, K.B[:, m:]]),
        D=np.hstack([K.D[:, :m] @ back, K.D[:, m:]]),
        inputs=(*P.outputs[:4], *K.inputs[m:]),
    )  # fmt: skip
    f = np.geomspace(1, 4000, 50)
    found, expected = loop.along_axes(f), Loop(seen, inner, 4).sensitivity(f)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_no_loop_of_a_machine_is_below_the_bound():
    for name in PRESETS:
        found = ambkit.assess(Machine.preset(name), "linear")
        for each in found.loops.values():
            assert each.largest[0] > found.least[0] > 1
            assert max(at.peak for at in each.axes.values()) <= each.largest[0]


# ---- against the nonlinear simulation


def test_noise_figures_are_those_of_the_simulation():
    still = UFU.model_copy(update={"unbalance": (), "speed": 0.0})
    loop = ambkit.assess(still, "linear").loops["linear"]
    runs = [
        simulate_machine(still, Flight(duration=0.6, seed=seed, feedback="estimate"),
                         estimator=made("linear", still)).record
        for seed in range(20)
    ]  # fmt: skip
    late = slice(1500, None)
    for name, axis in loop.axes.items():
        s, u = (
            math.sqrt(np.mean([np.var(run[f"{of}_{name}"][late]) for run in runs])) for of in "su"
        )
        assert axis.position_noise == pytest.approx(s, rel=0.06)
        assert axis.current_noise == pytest.approx(u, rel=0.03)


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
def test_unbalance_is_answered_as_the_simulation_does(feedback):
    turning = UFU.model_copy(update={"speed": 4000 * RPM})
    found = ambkit.assess(turning, "linear" if feedback == "estimate" else None)
    asked = list(found.loops.values())[-1]
    flight = Flight(duration=1.5, noise=False, feedback=feedback)
    inner = made("linear", turning, frozen_limit=0) if feedback == "estimate" else None
    run = simulate_machine(turning, flight, estimator=inner).record
    late = slice(9000, None)
    for k in (0, 2):
        names = [axis.name for axis in turning.axes][k : k + 2]
        far = np.hypot(*(run[f"s_{name}"][late] for name in names)).max()
        for name in names:
            axis = asked.axes[name]
            quiet = axis.demands.displacement - 3 * axis.position_noise
            assert quiet == pytest.approx(far, rel=0.02)
            current = np.abs(run[f"u_{name}"][late]).max()
            assert axis.demands.current - 3 * axis.current_noise == pytest.approx(current, rel=0.02)


# ---- over speed


def test_over_speed_goes_through_the_machines_own():
    own = UFU.model_copy(update={"speed": 600.0})
    over = assess_over_speed(own, "linear", fastest=1200.0, count=3)
    found = ambkit.assess(own, "linear").loops["linear"]
    assert over.speed == pytest.approx([0.0, 600.0, 1200.0])
    assert over.peaks[1] == pytest.approx([at.peak for at in found.axes.values()], rel=1e-6)
    assert over.largest[1] == pytest.approx(found.largest[0], rel=1e-6)
    assert over.orbit[1] == pytest.approx(
        [at.demands.displacement for at in found.axes.values()], rel=1e-6
    )
    assert over.current[1] == pytest.approx(
        [at.demands.current for at in found.axes.values()], rel=1e-6
    )
    assert set(over.integrals) == {0.0, 600.0, 1200.0}
    assert all(each.holds for each in over.integrals.values())
    assert over.voltage is None
    assert len(over.figure().panels) == 3
    assert len(over.run_up_figure().panels) == 2


def test_a_filter_over_speed_is_told_the_speed():
    fast = UFU.model_copy(update={"speed": 3000.0})
    still = UFU.model_copy(update={"speed": 0.0})
    point = WorkPoint.of_machine(still)
    for name in ("linear", "linear-adaptive-noise"):
        told, expected = told_speed(made(name, still), fast), made(name, fast)
        a, b = (estimator_at(each, point) for each in (told, expected))
        np.testing.assert_allclose(a.A, b.A, rtol=1e-9, atol=1e-12)
        assert not np.allclose(a.A, estimator_at(made(name, still), point).A, rtol=1e-6)


@pytest.mark.parametrize(("options", "message"), [
    ({"fastest": -1.0}, "greater than 0 rad/s"),
    ({"fastest": 1e5}, "half a revolution within a sample"),
    ({"count": 1}, "count must be 2"),
    ({"filter": ["linear", "extended"]}, "give one filter, not 2"),
    ({"filter": "observer"}, "cannot take a whole machine"),
    ({"load": {"Z": 3.0}}, "no axis Z"),
    ({"load": {"A1": 1e6}}, "holds the rotor"),
])  # fmt: skip
def test_refusals(options, message):
    with pytest.raises(AmbkitError, match=message):
        assess_over_speed(UFU, **options)


# ---- what else is said


def test_ideal_pieces_say_what_each_costs():
    found = ambkit.assess(UFU, "linear")
    shares = found.shares()
    assert list(shares) == ["as it is", "amplifier", "sensor", "delay", "filter"]
    assert shares["as it is"] == pytest.approx(found.loops["linear"].peak, rel=1e-4)
    assert shares["filter"] == pytest.approx(found.loops[MEASUREMENT].peak, rel=1e-4)
    for piece in ("amplifier", "sensor", "delay", "filter"):
        assert 1 < shares[piece] < shares["as it is"]
    alone = ambkit.assess(UFU.alone("A1"), "linear").shares()
    assert list(alone) == list(shares)
    of_one = ambkit.assess(ambkit.Bearing.preset("zittau_axial"), "linear").shares()
    assert list(of_one) == ["as it is", "sensor", "filter"]


def test_grades_of_balance():
    found = ambkit.assess(UFU, "linear")
    m, speed = UFU.rotor.mass, UFU.speed
    grades = {each.grade: each for each in found.grades()}
    each = grades[2.5e-3]
    assert each.unbalance == pytest.approx(m * 2.5e-3 / speed)
    assert each.force == pytest.approx(each.unbalance * speed**2)
    # The machine's one plane with that amount.
    (plane,) = UFU.unbalance
    graded = UFU.model_copy(
        update={"unbalance": (plane.model_copy(update={"amount": each.unbalance}),)}
    )
    axes = ambkit.assess(graded, "linear").loops["linear"].axes
    quiet = [at.demands.displacement - 3 * at.position_noise for at in axes.values()]
    assert each.displacement == pytest.approx(max(quiet), rel=1e-9)
    assert grades[6.3e-3].displacement == pytest.approx(2.52 * each.displacement)
    still = UFU.model_copy(update={"speed": 0.0, "unbalance": ()})
    assert ambkit.assess(still).grades() == []


def test_a_load_moves_the_work_point():
    free, loaded = (LoopOf(UFU, load=load) for load in (None, {"A1": -20.0}))
    moved = loaded.point.iu - free.point.iu
    k_i = 55.7335
    assert moved[0] == pytest.approx(20 / k_i, rel=0.01)
    assert moved[1:] == pytest.approx([0, 0, 0], abs=1e-3)
    assert loaded.loop().is_stable
    with pytest.raises(AmbkitError, match="must be a mapping by axes"):
        ambkit.assess(UFU, load=3.0)
    with pytest.raises(AmbkitError, match="must be a number"):
        ambkit.assess(ambkit.Bearing.preset("zittau_axial"), load={"A1": 1.0})


def test_assessment_of_a_machine_says_it_all():
    found = ambkit.assess(UFU, "linear")
    assert list(found.loops) == [MEASUREMENT, "linear"]
    data = found.to_dict()
    loop = data["loops"]["linear"]
    assert loop["zone"] == "A"
    assert loop["bode_holds"]
    assert loop["worst_axis"] == found.loops["linear"].worst.name == "A1"
    assert set(loop["axes"]) == {"A1", "A2", "B1", "B2"}
    assert found.alike("linear") == [["A1", "A2"], ["B1", "B2"]]
    assert len(found.figure().panels) == 6
    assert len(found.capacity_figure().panels) == 2
    with pytest.raises(AmbkitError, match="x is of one axis"):
        ambkit.assess(UFU, x="1 um")


def test_lqg_of_a_machine_stands_beside_the_loops():
    found = ambkit.assess(UFU, lqg=True)
    assert list(found.loops) == [MEASUREMENT, "LQG"]
    lqg = found.loops["LQG"]
    assert lqg.stable
    assert lqg.integral.holds
    assert lqg.current_noise < found.loops[MEASUREMENT].current_noise
    # Loads at rest are cancelled, and references held.
    closed = lqg.loop.closed
    rest = closed.C @ np.linalg.solve(np.eye(len(closed.A)) - closed.A, closed.B) + closed.D
    names = [at.name for at in closed.inputs]
    loads, wanted = (
        [k for k, name in enumerate(names) if name.startswith(start)] for start in ("f_d_", "r_")
    )
    np.testing.assert_allclose(rest[4:8, loads], 0, atol=1e-9)
    np.testing.assert_allclose(rest[4:8, wanted], np.eye(4), atol=1e-5)


# ---- swept, and measured


@pytest.mark.parametrize(("preset", "axis"), [("ufu_rig", "A1"), ("tum_mlps", "B2")])
@pytest.mark.parametrize("name", [None, "linear"])
def test_sweep_of_an_axis_is_the_models_within_two_percent(preset, axis, name):
    found = ambkit.sweep(Machine.preset(preset), name, amplitudes=["1 um"], axis=axis)
    (swept,) = found.swept
    assert found.name == f"{preset} {axis}"
    assert found.model.name == axis
    assert not swept.limited
    assert len(swept.frequency) > 30
    assert swept.deviation < 0.02
    assert len(found.figure().panels) == 2


def test_a_sweep_of_a_loaded_machine_is_that_of_its_work_point():
    load = {"A1": -25.0}
    (swept,) = ambkit.sweep(UFU, amplitudes=["0.5 um"], axis="A1", load=load).swept
    assert swept.deviation < 0.02
    free = ambkit.assess(UFU).loops[MEASUREMENT].loop.of_axis(0, swept.frequency)
    assert np.max(np.abs(swept.sensitivity - free) / np.abs(free)) > 0.02


def test_a_machine_is_swept_at_an_axis_that_it_has():
    with pytest.raises(AmbkitError, match="has no axis C; there are A1, A2, B1, B2"):
        ambkit.sweep(UFU, axis="C")


def injected(seed, axis="B1", noise=True):
    """A record of the machine with a multisine at the summing point of an axis."""
    T = UFU.sampling_time
    period = sparse_multisine(2000, T, (10.0, 1500.0), per_decade=12).values
    values = np.concatenate([np.zeros(500), 4e-6 * np.tile(period, 8)])
    t = T * np.arange(len(values))
    signal = Recorded.model_construct(times=tuple(t.tolist()), values=tuple(values.tolist()))
    there = Injection.model_construct(axis=axis, position=signal)
    flight = Flight(duration=float(t[-1]), noise=noise, seed=seed)
    still = UFU.model_copy(update={"unbalance": (), "speed": 0.0})
    return still, simulate_machine(still, flight.model_copy(update={"injection": (there,)})).record


@pytest.mark.long
def test_intervals_of_a_machines_log_hold_what_they_say():
    still, truth = injected(0, noise=False)
    size = np.abs(ambkit.assess_log(truth, still).measured.sensitivity)
    held = []
    for seed in range(40):
        found = ambkit.assess_log(injected(seed)[1], still)
        assert found.axis == 2
        low, high = found.measured.interval()
        held.append((low <= size) & (size <= high))
    assert 0.92 <= np.mean(held) <= 0.98


def test_a_machines_log_lies_on_its_model():
    still, record = injected(0, noise=False)
    found = ambkit.assess_log(record, still)
    assert found.deviation[MEASUREMENT] < 0.02
    assert found.name == "ufu_rig B1"
    assert "injected_B1" in record
    assert len(found.figure().panels) == 4


def test_a_log_says_at_which_axis_something_was_injected():
    still, record = injected(0)
    signals = {name: record[name] for name in record.signals if not name.startswith("injected")}
    with pytest.raises(RecordError, match="has none of them"):
        ambkit.assess_log(Record(record.t, signals, dict.fromkeys(signals, "m")), still)
    both = signals | {f"injected_{axis}": record["injected_B1"] for axis in ("A1", "B1")}
    with pytest.raises(RecordError, match="has injected_A1, injected_B1"):
        ambkit.assess_log(Record(record.t, both, dict.fromkeys(both, "m")), still)
    few = {"injected_B1": record["injected_B1"], "y_A1": record["y_A1"]}
    with pytest.raises(RecordError, match="the record has no y_A2, y_B1, y_B2"):
        ambkit.assess_log(Record(record.t, few, dict.fromkeys(few, "m")), still)


# ---- the page, and the command


def test_the_verdict_on_a_machine(tmp_path):
    found = ambkit.assess(UFU, "linear")
    over = assess_over_speed(UFU, "linear", fastest="6000 rpm", count=3)
    lines = verdict(found, "linear", over)
    assert all(line.good is not False for line in lines)
    said = {line.what.strip(): line.found for line in lines}
    assert said["largest singular value"].startswith(f"{found.loops['linear'].largest[0]:.3f}")
    assert said["balance quality grade of the unbalance (ISO 21940-11)"] == "G 0.423"
    write_verdict(found, tmp_path / "v.html", over=over)
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    for words in ("Verdict on the loop of ufu_rig", "All that has a limit keeps it", "reviewed by",
                  "closed loop over speed", "from rest to 6000 rpm", "21940-11"):  # fmt: skip
        assert words in page
    with pytest.raises(AmbkitError, match="over speed is of ufu_rig, fed by linear; the verdict"):
        write_verdict(found, tmp_path / "v.html", MEASUREMENT, over)


def test_the_verdict_says_which_axis_misses():
    heavy = UFU.model_copy(update={"speed": 6000 * RPM, "unbalance": (
        UFU.unbalance[0].model_copy(update={"amount": 3e-3}),
    )})  # fmt: skip
    found = ambkit.assess(heavy)
    kept = {line.what: line.good for line in verdict(found, MEASUREMENT)}
    assert kept["greatest displacement (ISO 14839-2)"] is False
    assert kept["check: Bode's integral of ln|det S|"] is True


def test_voltage_and_copper_of_a_machine():
    amplifier = {"voltage_limit": 30.0, "resistance": 2.0}
    wired = UFU.model_copy(update={"bearing": tuple(
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update=amplifier)})
        for at in UFU.bearing
    )})  # fmt: skip
    found = ambkit.assess(wired, "linear").loops["linear"]
    for name, k in (("A1", 0), ("B2", 3)):
        iu = LoopOf(wired).point.iu[k]
        at = found.axes[name]
        assert at.demands.capacity.voltage is not None
        least = 2.0 * 2 * (1.0 + iu**2)
        assert least < at.demands.copper_loss < 1.2 * least
    over = assess_over_speed(wired, "linear", fastest="12000 rpm", count=4)
    assert over.voltage.shape == (4, 4)
    assert over.voltage[0] == pytest.approx(2.0 * (1 + np.abs(LoopOf(wired).point.iu)) / 30.0)
    assert (over.voltage[-1] > over.voltage[0]).all()
    assert len(over.run_up_figure().panels) == 3


@pytest.fixture
def call(capsys, tmp_path, monkeypatch):
    """Call ambkit in this process, in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        with pytest.raises(SystemExit) as left:
            main(["assess", *arguments])
        return Result(int(left.value.code or 0), *capsys.readouterr())

    return run


@pytest.mark.parametrize(("arguments", "said"), [
    (["ufu_rig"], "Each axis with all other loops closed"),
    (["ufu_rig", "--filter", "none", "--over-speed", "3000 rpm"], "to 3000 rpm"),
    (["ufu_rig", "--filter", "none", "--sweep", "1 um", "--axis", "A1"], "ufu_rig A1"),
])  # fmt: skip
def test_command(call, tmp_path, arguments, said):
    done = call(*arguments, "--plot", "p.png")
    assert done.code == 0, done.err
    assert said in done.out
    assert (tmp_path / "p.png").stat().st_size > 10_000


def test_command_takes_a_machines_log(call):
    _, record = injected(0)
    record.save("log.csv")
    found = call("log.csv", "--bearing", "ufu_rig", "--filter", "none", "--json").json
    assert found["zone"] == "A"
    assert list(found["models"]) == [MEASUREMENT]


@pytest.mark.parametrize(("arguments", "message"), [
    (["ufu_rig", "--position", "1 um"], "--position is of one axis"),
    (["ufu_rig", "--filter", "observer"], "cannot take a whole machine"),
    (["ufu_rig", "--axis", "A1"], "--axis says which axis to --sweep"),
    (["ufu_rig", "--stepped-sine"], "--stepped-sine says how to --sweep"),
    (["ufu_rig", "--over-speed", "3000 rpm", "--sweep", "1 um"], "one after the other"),
    (["ufu_rig", "--filter", "linear,ud", "--report", "v.html"], "give one --filter, not 2"),
    (["zittau_axial", "--over-speed", "3000 rpm"], "--over-speed is of a whole machine"),
    (["zittau_axial", "--axis", "A1"], "--axis is of a whole machine"),
])  # fmt: skip
def test_command_refuses(call, arguments, message):
    done = call(*arguments)
    assert done.code == 2
    assert message in " ".join(done.err.split())
