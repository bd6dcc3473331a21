"""The whole controller of an axis: as it is simulated, exported and seen by its self-test."""

import random
import shutil
import subprocess
from pathlib import Path

import mutants
import numpy as np
import pytest
import unseen
from export_cases import SAME_BITS, program, understood
from exporting import export_c
from quick import quick

from ambkit import ExtendedKalmanFilter, KalmanFilter, Machine, Scenario, Step
from ambkit.base.errors import AmbkitError
from ambkit.control.blocks import LeadLag, Notch
from ambkit.control.control import Control, LiftOff, Mode
from ambkit.control.controller_states import Controller
from ambkit.control.pid import PID
from ambkit.data.input_scaling import Inputs, Scaling
from ambkit.estimate.estimate import Status
from ambkit.simulation.external_inputs import ExternalInputs, Faults
from ambkit.simulation.run import simulate, simulate_run

BEARING = Machine.preset("zittau_axial")
GAINED = BEARING.replace(sensor__gain=0.8, amplifier__gain=1.6)
ONE_SIDED = Machine.preset("inteco_ml")
PIDS = {
    "pid": PID(),
    "measured": Control(feedback="measurement", derivative_filter=2e-4),
    "ahead": PID(feed_forward=0.8),
    "lqg": Control(type="lqg"),
    "blocks": PID(block=[Notch(frequency=2e3, depth=0.3), LeadLag(zero=900.0, pole=1200.0)]),
}
TIMES = LiftOff(start=5e-3, stop=0.16, wait=5e-3, lift=0.04, land=0.03, lost=0.02, overload=0.02)


def flight(controller, bearing=BEARING, **other):
    said = {"duration": 0.22, "start": "landed", "sequence": TIMES} | other
    return Scenario(controller=controller.completed(bearing), **said)


def replayed(bearing, scenario, estimator, y, r, t):
    controller = Controller.of_axis(bearing, estimator, scenario.controller, scenario.sequence)
    return controller.run(y, r, scenario.sequence.fly(t))


def modes(record):
    found = record["mode"].astype(int)
    return [Mode(found[k]).name for k in np.flatnonzero(np.diff(found, prepend=-1))]


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("name", PIDS)
def test_what_simulate_flew_and_the_controller_alone_are_equal_to_the_last_bit(name, precision):
    scenario = flight(PIDS[name], GAINED)
    estimator = KalmanFilter(GAINED, precision=precision)
    run = simulate_run(GAINED, scenario, estimator=estimator)
    record = run.record
    assert modes(record) == ["OFF", "WAITING", "LIFTING", "FLYING", "LANDING", "OFF"]
    told = replayed(GAINED, scenario, estimator, record["y"], record["r"], record.t)
    np.testing.assert_array_equal(told["u"], record["u"])
    np.testing.assert_array_equal(told["mean"], run.estimate.mean)
    np.testing.assert_array_equal(told["mode"], record["mode"])
    on = told["on"].astype(bool)
    bias = np.dtype(precision).type(GAINED.magnet.bias_current)
    np.testing.assert_array_equal(told["coil"][on, 1], bias - told["iu"][on])
    assert not told["coil"][~on].any()
    flying = (record["mode"] == Mode.FLYING) & (record.t > 0.1) & (record.t < 0.16)
    assert np.abs(record["x"][flying]).max() < 0.4 * GAINED.clearance
    lying = -np.dtype(precision).type(GAINED.clearance)
    assert record["x"][0] == record["x"][-1] == lying


def test_a_rotor_on_one_magnet_lifts_too():
    T = ONE_SIDED.sampling_time
    long = LiftOff(wait=20 * T, lift=300 * T, land=300 * T, stop=900 * T)
    scenario = flight(PID(), ONE_SIDED, duration=1400 * T, sequence=long)
    record = simulate(ONE_SIDED, scenario, estimator=ExtendedKalmanFilter(ONE_SIDED))
    assert modes(record) == ["WAITING", "LIFTING", "FLYING", "LANDING", "OFF"]
    flying = (record["mode"] == Mode.FLYING) & (record.t > 600 * T)
    assert np.abs(record["x"][flying]).max() < 0.1 * ONE_SIDED.clearance


def test_feed_forward_takes_a_load_back_at_once():
    load = Step(amplitude=3.0, time=0.02)
    worst = [
        np.abs(
            simulate(BEARING, Scenario(duration=0.1, disturbance=load, controller=pid))["x"]
        ).max()
        for pid in (PID(), PID(feed_forward=1.0))
    ]
    assert worst[1] < 0.5 * worst[0]


def test_a_lost_sensor_trips_and_no_one_flies_until_told_not_to():
    scenario = flight(PID())
    n = round(scenario.duration / BEARING.sampling_time) + 1
    faults = Faults.none(n)
    faults.y_plus[1000:] = np.nan
    record = simulate(BEARING, scenario, external_inputs=ExternalInputs(faults=faults))
    assert modes(record) == ["OFF", "WAITING", "LIFTING", "FLYING", "TRIPPED", "OFF"]
    tripped = int(np.flatnonzero(record["mode"] == Mode.TRIPPED)[0])
    settling = 83  # samples that an estimate is used for without a reading: time constant
    assert tripped == pytest.approx(1000 + settling + 200, abs=2)
    assert not record["u"][tripped:].any()


def test_a_current_that_stays_at_its_limit_trips():
    """The reference is beyond the upper stop, and the load pushes down."""
    scenario = flight(
        PID(), disturbance=Step(amplitude=-100.0, time=0.08),
        reference=Step(amplitude=3e-3, time=0.08), sequence=TIMES.model_copy(update={"lost": 1.0}),
    )  # fmt: skip
    record = simulate(BEARING, scenario)
    assert modes(record)[:5] == ["OFF", "WAITING", "LIFTING", "FLYING", "TRIPPED"]
    tripped = int(np.flatnonzero(record["mode"] == Mode.TRIPPED)[0])
    assert 1000 <= tripped <= 1300
    assert (np.abs(record["u"][tripped - 190 : tripped]) == BEARING.current_max).all()


def test_no_bump_where_it_takes_over():
    """A rotor that another controller holds: the first current is close to the one that acted."""
    plain = Scenario(duration=0.1, start="levitated", noise=False, controller=Control())
    estimator = KalmanFilter(BEARING)
    record = simulate(BEARING, plain, estimator=estimator)
    controller = Controller.of_axis(
        BEARING, KalmanFilter(BEARING), plain.controller.completed(BEARING), LiftOff()
    )
    acting = float(record["iu"][500])
    told = controller.run(record["y"][500:], record["r"][500:], np.ones(501), transferred=acting)
    assert told["iu"][0] == pytest.approx(acting, abs=0.02)
    assert (told["mode"] == Mode.FLYING).all()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"type": "lqg", "feedback": "measurement"}, 'feedback must be "estimate"'),
        ({"feed_forward": 1.0, "feedback": "measurement"}, 'feedback must be "estimate"'),
        ({"feed_forward": -1.0}, "feed_forward"),
    ],
)
def test_what_cannot_be_fed_back_is_refused(wrong, message):
    with pytest.raises(AmbkitError, match=message):
        Control(**wrong)


# ---- The export ----


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Exports by their names; made when asked."""
    of = {}
    place = tmp_path_factory.mktemp("controllers")

    class Made(dict):
        def __missing__(self, name):
            precision = "double" if name == "double" else "float"
            pid = PIDS.get(name, PIDS["pid"])
            self[name] = export_c(
                GAINED, None, place / name, prefix="rig", precision=precision,
                kind="extended" if name == "extended" else None,
                scenario=Scenario(controller=pid),
            )  # fmt: skip
            return self[name]

    return Made(of)


def passes(folder, out, compiler="gcc"):
    done = program(compiler, folder, out)
    assert done.returncode == 0, done.stderr
    return subprocess.run([out], capture_output=True, text=True, timeout=60).stdout


@pytest.mark.parametrize("name", ["pid", "measured", "lqg", "double", "extended"])
def test_the_self_test_passes_to_the_last_bit(name, folders, tmp_path):
    said = passes(folders[name].folder, tmp_path / "a.out")
    assert said.startswith("pass"), said
    assert "equal to the last bit" in said


@pytest.mark.parametrize("compiler", ["clang", "tcc"])
def test_other_compilers(compiler, folders, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    folder = folders["pid"].folder
    if compiler == "clang":
        assert passes(folder, tmp_path / "a.out", "clang").startswith("pass")
        return
    files = sorted(str(path.relative_to(folder)) for path in folder.rglob("*.c"))
    includes = ("-I.", "-Icore/include", "-Icore", "-Iselftest")
    words = ["tcc", "-std=c99", "-DAMB_NO_CONTRACTION", *includes, *files]
    subprocess.run([*words, "-o", str(tmp_path / "a.out")], cwd=folder, check=True)
    done = subprocess.run([tmp_path / "a.out"], capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith("pass")


def test_the_rigs_own_numbers(tmp_path):
    """Volts of the sensor in; the same bits as in Python."""
    estimator = KalmanFilter(GAINED, precision="float32")
    estimator.inputs = Inputs(y=Scaling(unit="V", scale="0.2 mm/V", sign=-1, offset="1 mm"))
    estimator.save(tmp_path / "filter.toml")
    from ambkit.estimate.filter_file import FilterFile

    file = FilterFile.load(tmp_path / "filter.toml")
    made = export_c(
        GAINED, None, tmp_path / "out", prefix="rig", filter_file=file, scenario=Scenario()
    )
    assert passes(made.folder, tmp_path / "a.out").startswith("pass")


FAULTS = {
    "coils swapped": ("rig.c", "rig_bias + now.iu[0]", "rig_bias - now.iu[0]"),
    "a coil keeps its bias": ("rig.c", "(rig_bias - now.iu[0]) : AMB_C(0.0)",
                              "(rig_bias - now.iu[0]) : rig_bias"),
    "never trips by a lost sensor": ("core/src/sequence.c", "state->unusable > sequence->lost",
                                     "state->unusable > 65535U"),
    "never trips by overload": ("core/src/sequence.c", "state->limited > sequence->overloaded",
                                "state->limited > 65535U"),
    "lifts from the middle": ("core/src/control.c", "s->from[f] = at;", "s->from[f] = 0;"),
    "the load counts as it lies": ("core/src/control.c", "(share * mean[i])",
                                   "((void)share, mean[i])"),
    "a tripped one flies again": ("core/src/sequence.c", "{AMB_OFF, AMB_TRIPPED}}",
                                  "{AMB_OFF, AMB_LIFTING}}"),
    "never settled": ("core/src/control.c", "s->doubted--;", ";"),
    "integrals from nothing": ("core/src/control.c", "amb_pid_reset(&s->pid[j], integral);",
                               "amb_pid_reset(&s->pid[j], AMB_C(0.0)); (void)integral;"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_planted_faults_are_seen(fault, folders, tmp_path):
    file, old, new = FAULTS[fault]
    # The load counts where it is fed back.
    folder = folders["ahead" if "load" in fault else "pid"].folder
    shutil.copytree(folder, tmp_path / "out")
    path = tmp_path / "out" / file
    assert path.read_text().count(old) == 1, "the fault cannot be planted"
    path.write_text(path.read_text().replace(old, new))
    flags = tuple(flag for flag in SAME_BITS if "CONTRACTION" not in flag)
    done = program("gcc", tmp_path / "out", tmp_path / "a.out", flags)
    assert done.returncode == 0, done.stderr
    said = subprocess.run([tmp_path / "a.out"], capture_output=True, text=True, timeout=60).stdout
    assert said.startswith("FAIL"), fault


@pytest.fixture(scope="module")
def benches(folders):
    of = {name: mutants.Bench(folders[name].folder, "rig") for name in PIDS}
    yield of
    for bench in of.values():
        bench.close()


@pytest.mark.parametrize("count", quick([8, 40], [8]))
def test_a_tenth_of_any_constant_is_seen(benches, count):
    bench = benches["pid"]
    found = list(mutants.of_constants("rig_data.c", bench.text("rig_data.c")))
    some = random.Random(0).sample(found, count)
    alive = [str(m) for m in some if bench.judge(m).exact]
    assert alive == []


STEMS = ("control", "controllers", "controller", "sequence")
FLYING = [*(f"core/src/{stem}.c" for stem in STEMS), "rig.c"]


def test_what_is_explained_stands_in_the_sources(folders):
    """What explains nothing any more hides nothing, and the mutants it was for come back."""
    texts = [(folders["pid"].folder / file).read_text() for file in FLYING]
    assert [u for u in unseen.CONTROL if not any(u.text in text for text in texts)] == []


@pytest.mark.long
def test_operators_that_became_others_are_seen(benches):
    """A sample of all operators, each by all kinds of controllers together."""
    one = benches["pid"]
    found = [m for file in FLYING for m in mutants.of_operators(file, one.text(file))]
    some = random.Random(0).sample(found, 60)
    alive = []
    for mutant in some:
        if mutants.why(one, mutant, unseen.lists(False, True, False)):
            continue
        if all(bench.judge(mutant).exact for bench in benches.values()):
            alive += [] if one.is_the_same(mutant) else [str(mutant)]
    assert alive == []


def test_its_readme_says_what_to_do_for_each_flag(folders):
    text = (folders["pid"].folder / "README.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith("| `AMB_")]
    for flag in Status:
        assert any(f"`AMB_{flag.name}`" in row for row in rows), flag
    for words in ("void look(rig_output *copy)", "`rig_transfer` with the reading"):
        assert words in text


def test_the_command_writes_it(call, tmp_path):
    Path("s.toml").write_text('[controller]\ntype = "lqg"\n[sequence]\nlift = "0.1 s"\n')
    words = ("export", "c", "zittau_axial", "--out", "out")
    assert call(*words, "--controller", "s.toml").code == 0
    readme = (tmp_path / "out" / "README.md").read_text()
    assert "linear-quadratic regulator" in readme
    assert "in 0.1 s" in readme
    assert understood("gcc", tmp_path / "out", tmp_path / "out" / "zittau_axial.c").returncode == 0


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["tum_mlps", "--add", "calibration", "--filter", "augmented"],
            "more than noise, gate, mass and k",
        ),
        (["zittau_axial", "--filter", "linear+unbalance"], "is of a rigid or flexible rotor"),
        (["zittau_axial", "--editable"], "editable applies to filters only"),
    ],
)
def test_what_is_not_exported_is_reported(words, message, call):
    Path("s.toml").write_text('duration = "0.1 s"\n')
    told = call("export", "c", *words, "--out", "out", "--controller", "s.toml")
    assert told.code == 2
    assert message in told.err
