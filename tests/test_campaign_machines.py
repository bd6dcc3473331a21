"""Campaigns of machines: drawn, flown and judged with what knows the nominal one alone."""

from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.campaigns.figures import in_words
from ambkit.campaigns.keys import changed, key_in
from ambkit.campaigns.plan import Plan
from ambkit.campaigns.run import campaign
from ambkit.campaigns.study import Study
from ambkit.campaigns.worker import compute, peak_of, peaks
from ambkit.control.control import Control, LiftOff, Mode
from ambkit.control.controller_states import Controller
from ambkit.control.controllers import controllers_of
from ambkit.data.signals import signal
from ambkit.estimate.registry import KINDS, default_filter
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.models.plant import Plant
from ambkit.simulation.many import simulate_many
from ambkit.simulation.plans import Planned
from ambkit.simulation.run import simulate_run
from ambkit.simulation.run_figures import FIGURES
from ambkit.simulation.waveforms import Constant, Ramp

ROOT = Path(__file__).parent.parent

STUDY = """
name = "a spindle"
machine = "tum_mlps"
runs = 6
seed = 3
part = 4

[scenario]
duration = "12 ms"
disturbance = [{ axis = "A1", force = { type = "step", amplitude = "5 N", time = "4 ms" } }]

[record]
traces = ["s_A1", "f_d_A1_estimate"]
every = 3

[[vary]]
what = "rotor.mass"
type = "uniform"
tolerance = "5 %"

[[vary]]
what = "rotor.transverse_inertia"
type = "normal"
std = "2 %"

[[vary]]
what = "bearing.A.magnet.air_gap"
type = "normal"
std = "2 %"

[[vary]]
what = "bearing.B.place"
type = "uniform"
tolerance = "1 mm"

[[vary]]
what = "sensor.0.noise_variance"
type = "uniform"
tolerance = "20 %"

[[vary]]
what = "scenario.disturbance.0.force.amplitude"
type = "uniform"
low = "2 N"
high = "8 N"

[[vary]]
what = "estimator"
type = "choice"
values = ["linear", "extended"]

[[correlation]]
between = ["rotor.mass", "rotor.transverse_inertia"]
coefficient = 0.8

[passes]
zone = "A"

[passes.at_most]
orbit_share = 0.5
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    return campaign(Study.from_toml(STUDY), tmp_path_factory.mktemp("a") / "out", threads=2)


@pytest.mark.parametrize("kind", ["linear", "linear-adaptive-noise"])
def test_a_filter_that_followed_a_run_up_is_as_one_that_did_not(kind):
    machine = ambkit.Machine.preset("tum_mlps")
    sequence = LiftOff(start=1e-3, wait=2e-3, lift=0.02)
    one = KINDS[kind].make(machine, None, synchronous=("unbalance",), precision="float32")
    for start, slope in ((1.0, 3000.0), (1.0, -3000.0), (0.9, 0.0), (1.0, 1000.0), (1.0, 0.0)):
        speed = Constant(value=start * machine.speed) + Ramp(slope=slope)
        flight = ambkit.Scenario(duration=0.03, start="landed", speed=speed, sequence=sequence).fed(
            "estimate"
        )
        new = KINDS[kind].make(machine, None, synchronous=("unbalance",), precision="float32")
        been = simulate_run(machine, flight, estimator=one).estimate
        fresh = simulate_run(machine, flight, estimator=new).estimate
        np.testing.assert_array_equal(been.mean, fresh.mean)


def test_rows_are_the_same_by_any_threads_and_in_any_pieces(found):
    plan = Plan(Study.from_toml(STUDY))
    for first, stop in ((3, 6), (0, 3)):
        alone = compute(plan, first, stop, threads=1).runs
        for name in ("x_rms", "f_d_rms", "orbit_peak", "peak_S", "passed", "rotor.mass"):
            there = found.column(name)[first:stop]
            np.testing.assert_array_equal(alone.column(name).to_numpy(zero_copy_only=False), there)
    assert len(set(found.column("x_rms"))) == 6


def test_a_replayed_machine_is_the_one_of_its_row(found, tmp_path):
    again = found.replay(3)
    assert again.row["orbit_peak"] == found.column("orbit_peak")[3]
    assert again.row["estimator"] == found.column("estimator")[3]
    assert again.plant.rotor.mass == found.column("rotor.mass")[3]
    s = np.hypot(again.run.record["s_A1"], again.run.record["s_A2"])
    t = np.hypot(again.run.record["s_B1"], again.run.record["s_B2"])
    assert again.row["orbit_peak"] == pytest.approx(max(s[1:].max(), t[1:].max()), rel=1e-12)
    again.plant.save(tmp_path / "m.toml")
    assert ambkit.Machine.load(tmp_path / "m.toml") == again.plant
    import pyarrow.parquet as pq

    traces = pq.read_table(found.folder / "traces" / "part-000000.parquet").to_pydict()
    here = np.array(traces["run"]) == 3
    np.testing.assert_array_equal(np.array(traces["s_A1"])[here], again.run.record["s_A1"])
    assert len(again.figures()[0].panels) > 1


def test_what_is_shown_of_a_machine_is_that_of_a_bearing(found, tmp_path):
    found.save(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "tum_mlps" in page
    assert "maximum orbit over clearance" in page
    assert found.to_dict()["machine"] == "tum_mlps"
    assert found.good.of == 6


@pytest.mark.parametrize("name", ["zittau_axial", "tum_mlps"])
def test_a_choice_of_controllers_is_the_same_for_every_machine(name):
    plan = Plan(Study.from_toml(f"""
name = "choice"
machine = "{name}"
sampling = "grid"
[[vary]]
what = "controller"
type = "choice"
values = ["textbook", "decentralised", "lqg", "own"]
[controllers.own]
type = "lqg"
"""))  # fmt: skip
    plan.check()
    runs = [of.planned for of in plan.machines(plan.points(0, 4), plan.noise(0, 4), 0)]
    found = peaks(runs)
    machine = ambkit.preset(name)
    for control, peak in zip(("decentralised", "lqg"), found[1:3], strict=True):
        loop = LoopBuilder(machine, Control(type=control, feedback="estimate"))
        assert peak == pytest.approx(loop.peak(default_filter(machine)), rel=1e-6)
    assert len({f"{peak:.3f}" for peak in found}) == 3
    assert found[2] == found[3]


def test_controllers_and_filters_know_the_nominal_machine_alone():
    plan = Plan(Study.from_toml(STUDY))
    drawn = list(plan.machines(plan.points(0, 6), plan.noise(0, 6), 0))
    assert len({id(each.planned.controllers) for each in drawn}) == 2  # of each filter
    nominal = ambkit.Machine.preset("tum_mlps")
    for each in drawn:
        assert each.planned.estimator.view.machine == nominal
        assert each.planned.machine != nominal


@pytest.mark.parametrize("feedback", ["measurement", "estimate"])
@pytest.mark.parametrize("control", ["decentralised", "translation and tilt"])
def test_peaks_are_those_that_assess_finds(feedback, control):
    controller = Control(type=control, feedback=feedback)
    plan = Plan(Study(name="a", machine="tum_mlps", runs=1, scenario={"controller": controller}))
    (drawn,) = plan.machines(plan.points(0, 1), plan.noise(0, 1), 0)
    machine = ambkit.Machine.preset("tum_mlps")
    fed = default_filter(machine) if feedback == "estimate" else None
    expected = LoopBuilder(machine, Control(type=control)).peak(fed)
    assert peak_of(drawn.planned) == pytest.approx(expected, rel=1e-6)


def test_figures_of_a_nominal_run():
    """The nominal machine flies as it does alone, and its figures are what its record shows."""
    machine = ambkit.Machine.preset("tum_mlps")
    flight = ambkit.Scenario(duration=0.02, seed=1, disturbance=[
        {"axis": "A2", "force": {"type": "step", "amplitude": 5.0, "time": 0.01}},
    ])  # fmt: skip
    kalman = ambkit.KalmanFilter(machine)
    run = simulate_run(machine, flight, estimator=kalman)
    assert run.first_contact is None
    many = simulate_many([Planned(machine, flight, kalman)], settling=0.002)
    figures = {name: float(values[0]) for name, values in many.figures.items()}
    assert list(figures) == list(FIGURES)
    f_d = [run.estimate[f"f_d_{a}"] - run.record[f"f_d_{a}"] for a in ("A1", "A2", "B1", "B2")]
    worst = max(np.sqrt(np.mean(each[20:] ** 2)) for each in f_d)
    assert figures["f_d_rms"] == pytest.approx(worst, rel=1e-12)
    assert figures["load_kept"] == 5.0
    assert 0.5 < figures["nis"] < 2
    other = simulate_run(machine, flight.replace(run=1), estimator=kalman)
    y = f"y_{machine.readings[0].name}"
    assert (other.record[y] != run.record[y]).all()


def test_parts_of_a_machine_are_named_or_counted():
    machine = ambkit.Machine.preset("tum_mlps")
    assert key_in(machine, "bearing.A.magnet.air_gap") == key_in(
        machine, "bearing.0.magnet.air_gap"
    )
    for name in ("B", "1"):
        wide = changed(machine, {f"bearing.{name}.magnet.air_gap": 1e-3})
        assert wide.bearings[1].magnet.air_gap == 1e-3
        assert wide.bearings[0] == machine.bearings[0]
    with pytest.raises(AmbkitError, match="known here: A, B"):
        key_in(machine, "bearing.C.place")


def test_a_coil_and_its_constant_stay_one_in_a_machine():
    coil = ambkit.Machine.load(ROOT / "examples/spindle.toml").magnet
    machine = ambkit.Machine.preset("tum_mlps")
    first = machine.bearings[0].model_copy(update={"magnet": coil})
    machine = machine.model_copy(update={"bearings": (first, *machine.bearings[1:])})
    wide = changed(machine, {"bearing.A.magnet.pole_area": 1.2 * coil.pole_area})
    assert wide.bearings[0].magnet.magnet_constant == pytest.approx(1.2 * coil.magnet_constant)


def test_a_gain_of_a_flight_varies():
    text = STUDY.partition("[record]")[0].replace(
        "[scenario]",
        '[scenario]\ncontroller.feedback = "estimate"\n'
        'controller.type = "translation and tilt"\ncontroller.cross_feedback = 0.5',
    )
    vary = '[[vary]]\nwhat = "scenario.controller.cross_feedback"\n'
    vary += 'type = "choice"\nvalues = [0.5, 0.0]'
    plan = Plan(Study.from_toml(text + vary))
    points = np.array([[0.0], [1.0]])
    one, less = (each.planned for each in plan.machines(points, plan.noise(0, 2), 0))
    assert peak_of(one) != pytest.approx(peak_of(less), rel=1e-6)


@pytest.mark.parametrize("name", ["zittau_axial", "tum_mlps"])
def test_a_study_names_any_machine(name):
    plan = Plan(Study.from_toml(f'name = "a"\nmachine = "{name}"\nruns = 1\n'))
    plan.check()
    assert plan.nominal.name == name
    assert Study.from_toml(plan.described.to_toml()) == plan.described


def test_quantities_are_called_by_what_they_are_of():
    names = ["rotor.mass", "bearing.A.magnet.air_gap", "bearing.B.magnet.air_gap",
             "unbalance.0.amount", "scenario.disturbance.0.force.amplitude"]  # fmt: skip
    assert in_words(names) == ["mass", "bearing A air gap", "bearing B air gap",
                               "unbalance 0 amount", "force"]  # fmt: skip
    of_a_bearing = ["magnet.air_gap", "sensor.lag", "scenario.disturbance.values.0"]
    assert in_words(of_a_bearing) == ["air gap", "lag", "disturbance 0"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('machine = "tum_mlps"', "", "machine: missing"),
        ("runs = 6", 'bearing = "zittau_axial"\nruns = 6', "bearing: unknown key"),
        ("rotor.mass", "bearing.A.magnet.type", "cannot vary: it"),
        ("bearing.B.place", "bearing.0.magnet.air_gap", "varies already, in vary.2."),
        ("rotor.mass", "sampling_time", "cannot vary: it belongs to the controller"),
        ("rotor.mass", "scenario.duration", "cannot vary: it is one for all runs"),
        ('"s_A1"', '"s_C1"', "there is no signal s_C1; known: s_A1, s_A2"),
        ("orbit_share = 0.5", 'overshot = "5 %"', "overshot: unknown key, did you mean"),
        ('"linear", "extended"', '"linear", "nobody"', "there is no filter"),
        ('"tum_mlps"', '"zittau_axial"', "there is no signal s_A1"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_reported(old, new, message):
    with pytest.raises(ConfigError, match=message):
        Study.from_toml(STUDY.replace(old, new))


def test_what_does_not_go_together_is_reported_before_any_run():
    plan = Plan(Study.from_toml(STUDY.replace('axis = "A1"', 'axis = "C1"')))
    with pytest.raises(AmbkitError, match="no axis C1"):
        plan.check()
    lqg = STUDY.replace("[scenario]", '[scenario]\ncontroller = { type = "lqg" }')
    Plan(Study.from_toml(lqg)).check()  # fed by the estimate, as nothing else is stated
    lqg = lqg.replace('"lqg" }', '"lqg", feedback = "measurement" }')
    with pytest.raises(AmbkitError, match='feedback must be "estimate"'):
        Plan(Study.from_toml(lqg)).check()


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::UserWarning")
def test_a_machines_filter_is_tuned_over_its_tolerances(tmp_path):
    pytest.importorskip("optuna")
    text = (
        STUDY.partition("[record]")[0].replace("runs = 6", "runs = 3")
        + """
        [[vary]]
        what = "rotor.mass"
        type = "uniform"
        tolerance = "5 %"
        """
    )
    study = Study.from_toml(text)
    found = ambkit.tune_robust(study, budget=2)
    assert {each.name for each in found.free} == {"noise.control", "noise.disturbance"}
    assert found.candidates[found.taken].error <= found.candidates[0].error
    found.save(tmp_path / "f.toml")
    assert not (tmp_path / "f.scenario.toml").exists()
    again = ambkit.tune_robust(study, budget=1)  # untuned, beside the tuned one
    tuned = study.model_copy(update={"estimator": str(tmp_path / "f.toml")})
    rows = compute(Plan(tuned), 0, 3).runs.column("f_d_rms").to_numpy()
    assert max(rows) == pytest.approx(found.candidates[found.taken].error)
    assert again.candidates[0].error == found.candidates[0].error
    with pytest.raises(AmbkitError, match=r"controller\.kp is of a bearing"):
        ambkit.tune_robust(study, free=["controller.kp"])


@pytest.mark.parametrize(("name", "bearing"), [("zittau_axial", ""), ("tum_mlps", "bearing.A.")])
def test_an_amplifier_gets_the_signal_of_a_controller_that_knows_the_nominal_gain(name, bearing):
    """What lifts a rotor says the same to readings, whatever amplifier is behind it."""
    nominal = ambkit.Machine.preset(name)
    gain = nominal.axes[0].bearing.amplifier.gain
    text = f"""
        name = "a"
        machine = "{name}"
        runs = 1
        [scenario]
        duration = "0.15 s"
        start = "landed"
        sequence = {{ start = "5 ms", lift = "50 ms" }}
        [[vary]]
        what = "{bearing}amplifier.gain"
        type = "choice"
        values = ["{gain} A/V", "{1.05 * gain} A/V"]
        """
    plan = Plan(Study.from_toml(text))
    for place in (0.0, 1.0):
        (drawn,) = plan.machines(np.array([[place]]), plan.noise(0, 1), 0)
        run = drawn.planned.simulated()
        record, readings = run.record, [signal("y", of.name) for of in nominal.readings]
        axes = [axis.name for axis in nominal.axes]
        estimator, scenario = drawn.planned.estimator, plan.scenario
        if nominal.single:
            of = Controller.of_axis(nominal, estimator, scenario.controller, scenario.sequence)
        else:
            law = controllers_of(Plant(nominal), scenario.controller, estimator)
            of = Controller(Plant(nominal), estimator, law, scenario.sequence, fed=True)
        r = np.column_stack([record[signal("r", axis)] for axis in axes])
        y = np.column_stack([record[of] for of in readings])
        fly = scenario.sequence.fly(record.t)
        expected = of.in_core().run(y, r, fly, speed=nominal.speed)["u"]
        u = np.column_stack([record[signal("u", axis)] for axis in axes])
        assert Mode.FLYING in record["mode"]
        assert np.abs(u - expected.reshape(u.shape)).max() < 1e-9 * np.abs(u).max()
