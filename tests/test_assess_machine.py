"""Margins of machines: against the core and the simulation, and what is said of them."""

import functools
import math
from dataclasses import replace

import numpy as np
import pytest
from machine_cases import PRESETS, injected, made, uncoupled
from quick import quick

import ambkit
from ambkit import Machine
from ambkit.assessment.assess import MEASUREMENT
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_plant import OperatingPoint
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.result.page import write_result
from ambkit.rotordynamics.unbalance_response import unbalance_forces
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Scenario

RPM = math.pi / 30
UFU = Machine.preset("ufu_rig")


@functools.cache
def assessed():
    return ambkit.assess(UFU, "linear")


# ---- the pieces against what computes


def test_axes_that_do_not_couple_are_bearings_alone():
    machine = uncoupled()
    found = ambkit.assess(machine, "linear")
    for name, axis in found.loops[MEASUREMENT].axes.items():
        alone = machine.isolated_axis(name).replace(rotor__gravity="none")
        expected = ambkit.assess(alone, "none").loops[MEASUREMENT].worst
        for figure in ("peak", "peak_frequency", "current_noise", "position_noise"):
            assert getattr(axis, figure) == pytest.approx(getattr(expected, figure), rel=1e-6)
        for figure in ("gain_up", "gain_down", "phase", "delay", "disk", "crossover", "bandwidth"):
            one, other = (getattr(each.margins, figure) for each in (axis, expected))
            assert one == pytest.approx(other, rel=1e-5), figure
        capacity = axis.demands.capacity
        assert capacity.current == pytest.approx(expected.demands.capacity.current, rel=1e-3)
        assert capacity.static == pytest.approx(expected.demands.capacity.static, rel=1e-9)
    alone = {
        name: ambkit.assess(machine.isolated_axis(name), "none").least for name in ("A1", "B1")
    }
    assert found.least == pytest.approx(max(alone.values()), rel=1e-6)


def test_an_axis_is_looked_at_where_its_controller_takes_its_position():
    """With two sensors for each bearing: as if the shown positions were the measurements."""
    of = LoopBuilder(Machine.preset("tum_mlps"))
    loop = of.loop()
    assert loop.measurements == 8
    assert loop.axes == 4
    P, K, m = of.plant, loop.compensator, 8
    seen = replace(
        P, C=np.vstack([of.measured @ P.C[:m], P.C[m:]]), D=np.zeros((8, 8)),
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


@pytest.mark.long
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
        simulate_run(still, Scenario(duration=0.6, seed=seed, controller={"feedback": "estimate"}),
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


@pytest.mark.parametrize("feedback", quick(["measurement", "estimate"], ["estimate"]))
def test_unbalance_is_answered_as_the_simulation_does(feedback):
    turning = UFU.model_copy(update={"speed": 4000 * RPM})
    found = ambkit.assess(turning, "linear" if feedback == "estimate" else None)
    asked = found.loops["linear" if feedback == "estimate" else MEASUREMENT]
    flight = Scenario(duration=1.5, noise=False, controller={"feedback": feedback})
    inner = made("linear", turning, frozen_limit=0) if feedback == "estimate" else None
    run = simulate_run(turning, flight, estimator=inner).record
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


# ---- what else is said


def test_ideal_pieces_say_what_each_costs():
    found = assessed()
    shares = found.shares()
    assert list(shares) == ["as it is", "amplifier", "sensor", "delay", "filter"]
    assert shares["as it is"] == pytest.approx(found.loops["linear"].peak, rel=1e-4)
    assert shares["filter"] == pytest.approx(found.loops[MEASUREMENT].peak, rel=1e-4)
    for piece in ("amplifier", "sensor", "delay", "filter"):
        assert 1 < shares[piece] < shares["as it is"]
    alone = ambkit.assess(UFU.isolated_axis("A1"), "linear").shares()
    assert list(alone) == list(shares)
    of_one = ambkit.assess(ambkit.preset("zittau_axial"), "linear").shares()
    assert list(of_one) == ["as it is", "sensor", "filter"]


def test_grades_of_balance():
    found = assessed()
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
    assert ambkit.assess(still, "none").grades() == []


def test_the_force_of_an_unbalance_between_bearings_is_shared_by_them():
    (plane,) = UFU.unbalance
    forces = unbalance_forces(UFU)
    assert forces[0] + forces[2] == pytest.approx(plane.amount * UFU.speed**2, rel=1e-9)
    assert forces[:2] == pytest.approx([forces[0]] * 2)
    a, b = (bearing.place for bearing in UFU.bearings)
    share = (b - plane.place) / (b - a)
    assert forces[0] == pytest.approx(share * plane.amount * UFU.speed**2, rel=1e-9)


def test_a_load_moves_the_operating_point():
    free, loaded = (LoopBuilder(UFU, load=load) for load in (None, {"A1": -20.0}))
    moved = loaded.point.iu - free.point.iu
    k_i = 55.7335
    assert moved[0] == pytest.approx(20 / k_i, rel=0.01)
    assert moved[1:] == pytest.approx([0, 0, 0], abs=1e-3)
    assert loaded.loop().is_stable
    of_first = ambkit.assess(UFU, "none", disturbance="-20 N").point.iu
    np.testing.assert_array_equal(of_first, loaded.point.iu)
    with pytest.raises(AmbkitError, match="there is no axis A1"):
        ambkit.assess(ambkit.preset("zittau_axial"), "none", disturbance={"A1": 1.0})


def test_assessment_of_a_machine_says_it_all():
    found = assessed()
    assert list(found.loops) == [MEASUREMENT, "linear"]
    loop = found.to_dict()["loops"]["linear"]
    assert loop["zone"] == "A"
    assert loop["bode_holds"]
    assert loop["worst_axis"] == found.loops["linear"].worst.name == "A1"
    assert set(loop["axes"]) == {"A1", "A2", "B1", "B2"}
    assert found.alike("linear") == [["A1", "A2"], ["B1", "B2"]]
    assert len(found.figure().panels) == 7
    assert len(found.capacity_figure().panels) == 2
    assert ambkit.assess(UFU, "none", position="1 um").point.x == pytest.approx(4 * [1e-6])


def test_lqg_of_a_machine_stands_beside_the_loops():
    found = ambkit.assess(UFU, "none", beside=["lqg"])
    assert list(found.loops) == [MEASUREMENT, "LQG"]
    lqg = found.loops["LQG"]
    assert lqg.stable
    assert lqg.integral.holds
    assert lqg.current_noise < found.loops[MEASUREMENT].current_noise
    # Loads at rest are cancelled, and references held.
    closed = lqg.loop.closed
    rest = closed.C @ np.linalg.solve(np.eye(len(closed.A)) - closed.A, closed.B) + closed.D
    names = [at.name for at in closed.inputs]
    loads, expected = (
        [k for k, name in enumerate(names) if name.startswith(start)] for start in ("f_d_", "r_")
    )
    np.testing.assert_allclose(rest[4:8, loads], 0, atol=1e-9)
    np.testing.assert_allclose(rest[4:8, expected], np.eye(4), atol=1e-5)


# ---- the page, and the command


@pytest.mark.long
def test_the_verdict_on_a_machine(tmp_path):
    found = assessed()
    over = ambkit.assess_speed(UFU, "linear", fastest="6000 rpm", count=3)
    assert all(row.kept is not False for row in [*found.rows, *over.rows])
    rows = {row.key: row for row in found.rows if row.of == "linear"}
    assert rows["largest_singular_value"].value == found.loops["linear"].largest[0]
    assert "The unbalance is of balance quality grade G 0.423." in found.notes
    write_result([found, over], tmp_path / "v.html")
    page = (tmp_path / "v.html").read_text(encoding="utf-8")
    for words in ("Verdict on the loop of ufu_rig", "All limits are kept", "reviewed by",
                  "closed loop over speed", "run-up from rest to 3000", "21940-11"):  # fmt: skip
        assert words in page


def test_the_verdict_says_which_axis_misses():
    heavy = UFU.model_copy(update={"speed": 6000 * RPM, "unbalance": (
        UFU.unbalance[0].model_copy(update={"amount": 3e-3}),
    )})  # fmt: skip
    found = ambkit.assess(heavy, "none")
    rows = {row.key: row for row in found.rows if row.of == MEASUREMENT}
    assert rows["displacement"].kept is False
    assert rows["bode_holds"].value is True
    loop = found.loops[MEASUREMENT]
    assert loop.zone == "A"
    assert loop.verdict > "A"
    assert f"zone {loop.verdict} by " in found.finding
    assert loop.cause.endswith("displacement") or "displacement and" in loop.cause


def test_a_run_up_is_judged_to_the_machines_speed():
    """Higher speeds are drawn and noted, but no limit is of them."""
    turning = UFU.model_copy(update={"speed": 3000 * RPM})
    over = ambkit.assess_speed(turning, "none", fastest="12000 rpm", count=5)
    own = ambkit.assess_speed(turning, "none", fastest="3000 rpm", count=2)
    assert over.judged == 2
    assert (over.worst, over.farthest, over.hardest) == (own.worst, own.farthest, own.hardest)
    assert over.finding == own.finding
    backwards = turning.model_copy(update={"speed": -turning.speed})
    assert ambkit.assess_speed(backwards, "none", fastest="12000 rpm", count=5).judged == 2
    assert over.orbit[2:].max() > own.orbit.max()
    assert any(note.startswith("Beyond, to 12000 rpm: ") for note in over.notes)
    assert not any("Beyond" in note for note in own.notes)


def test_voltage_and_copper_of_a_machine():
    amplifier = {"voltage_limit": 30.0, "resistance": 2.0}
    wired = UFU.model_copy(update={"bearings": tuple(
        at.model_copy(update={"amplifier": at.amplifier.model_copy(update=amplifier)})
        for at in UFU.bearings
    )})  # fmt: skip
    found = ambkit.assess(wired, "linear").loops["linear"]
    for name, k in (("A1", 0), ("B2", 3)):
        iu = LoopBuilder(wired).point.iu[k]
        at = found.axes[name]
        assert at.demands.capacity.voltage is not None
        least = 2.0 * 2 * (1.0 + iu**2)
        assert least < at.demands.copper_loss < 1.2 * least
    over = ambkit.assess_speed(wired, "linear", fastest="12000 rpm", count=4)
    assert over.voltage.shape == (4, 4)
    assert over.voltage[0] == pytest.approx(2.0 * (1 + np.abs(LoopBuilder(wired).point.iu)) / 30.0)
    assert (over.voltage[-1] > over.voltage[0]).all()
    assert len(over.figures()[1].panels) == 3


@pytest.mark.parametrize(("arguments", "message"), [
    (["ufu_rig", "--verbose"], "Each axis with all other loops closed"),
    pytest.param(
        ["speed", "ufu_rig", "--filter", "none", "--fastest", "3000 rpm"], "to 3000 rpm",
        marks=pytest.mark.long,
    ),
    (["sweep", "ufu_rig", "--filter", "none", "--amplitudes", "1 um", "--axis", "A1"],
     "ufu_rig A1"),
    (["sweep", "zittau_axial", "--amplitudes", "1 um", "--kind", "stepped-sine"],
     "stepped-sine of the simulated loop"),
])  # fmt: skip
def test_command(call, tmp_path, arguments, message):
    done = call("assess", *arguments, "--plot", "p.png")
    assert done.code == 0, done.err
    assert message in done.out
    assert (tmp_path / "p.png").is_file()


def test_command_takes_a_machines_log(call):
    _, record = injected(0)
    record.save("log.csv")
    found = call(
        "assess", "log", "log.csv", "--machine", "ufu_rig", "--filter", "none", "--json"
    ).json
    assert found["zone"] == "A"
    assert list(found["models"]) == [MEASUREMENT]


@pytest.mark.parametrize(("arguments", "message"), [
    (["ufu_rig", "--position", "1 m"], "can be held up to its stops"),
    (["ufu_rig", "--filter", "observer"], "takes one axis"),
    (["ufu_rig", "--axis", "A1"], "there is no option --axis"),
    (["ufu_rig", "--fliter", "linear"], "did you mean --filter?"),
    (["ufu_rig", "--position", "0", "--position", "0"], "--position is given more than once"),
    (["ufu_rig", "--plot", "nowhere/p.png"], "there is no folder nowhere"),
    (["ufu_rig", "--out", "p.txt"], "--out: p.txt must end with .json or .csv or .tex or .html"),
    (["speed", "ufu_rig", "--filter", "ud", "--filter", "ud"], "--filter is given more than once"),
    (["speed", "zittau_axial"], "does not turn: its rotor moves along one axis"),
    (["sweep", "zittau_axial", "--kind", "chirp"], "invalid choice: 'chirp'"),
])  # fmt: skip
def test_command_refuses(call, arguments, message):
    done = call("assess", *arguments)
    assert done.code == 2
    assert message in " ".join(done.err.split())


# ---- over speed


@pytest.mark.long
def test_over_speed_goes_through_the_machines_own():
    own = UFU.model_copy(update={"speed": 600.0})
    over = ambkit.assess_speed(own, "linear", fastest=1200.0, count=3)
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
    assert len(over.figures()[1].panels) == 2


def test_a_filter_over_speed_is_reported_the_speed():
    fast = UFU.model_copy(update={"speed": 3000.0})
    still = UFU.model_copy(update={"speed": 0.0})
    point = OperatingPoint.of_machine(still)
    for name in ("linear", "linear-adaptive-noise"):
        _, told = LoopBuilder(still).at_speed(3000.0, made(name, still))
        expected = made(name, fast)
        a, b = (estimator_at(each, point) for each in (told, expected))
        np.testing.assert_allclose(a.A, b.A, rtol=1e-9, atol=1e-12)
        assert not np.allclose(a.A, estimator_at(made(name, still), point).A, rtol=1e-6)


@pytest.mark.parametrize(("options", "message"), [
    ({"fastest": -1.0}, "greater than 0 rad/s"),
    ({"fastest": 1e5}, "half a revolution within a sample"),
    ({"count": 1}, "count must be 2"),
    ({"filter": ["linear", "extended"]}, "one loop has one filter, not 2"),
    ({"filter": "observer"}, "takes one axis"),
    ({"disturbance": {"Z": 3.0}}, "no axis Z"),
    ({"disturbance": {"A1": 1e6}}, "holds the rotor"),
])  # fmt: skip
def test_refusals(options, message):
    with pytest.raises(AmbkitError, match=message):
        ambkit.assess_speed(UFU, **options)


@pytest.mark.parametrize("update", [
    {}, {"angle": {"type": "pulses", "angle_noise": 0.06, "latency": 5e-3}},
])  # fmt: skip
def test_the_default_filter_has_margins_from_rest_on(update):
    """Unbalance at rest and the error of the speed are shown by no reading at one speed."""
    machine = Machine.preset("tum_mlps").replace(**update)
    assert ambkit.assess_speed(machine, count=3).finding.startswith("tum_mlps")
