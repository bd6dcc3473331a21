"""FMUs, judged by tools that others wrote: FMPy and fmutool; their values: test_export_fmu_same."""

import os
import pickle
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from exporting import export_fmu, export_ssp

import ambkit
from ambkit import ClosedLaw, KalmanFilter, Machine, magnet_of
from ambkit.base.errors import AmbkitError
from ambkit.control.control import LiftOff, Mode
from ambkit.control.controller_states import Controller
from ambkit.export.fmu import sources
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Reference

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import Instance, check_sources, simulated, unpacked  # noqa: E402
from iron import TWO_SIDED as IRON  # noqa: E402
from quick import quick  # noqa: E402

BEARING = Machine.preset("zittau_axial")
RIG = ambkit.Machine.preset("tum_mlps")
WITH_PARTS = BEARING.replace(name="parts", amplifier__bandwidth=1500.0, delay=1.3e-4)
QUICK = LiftOff(wait=2e-3, lift=0.02, land=0.02, stop=0.06)
LQG = ambkit.Control(type="lqg")
LIFTS = ambkit.Scenario(start="landed", sequence=QUICK, controller=LQG)
SCENARIOS = {
    "lifting": LIFTS, "whole-controller": LIFTS, "controller": ambkit.Scenario(controller=LQG),
}  # fmt: skip
KINDS = ("estimator", "plant", "closed-loop", *SCENARIOS)
ALL = [(kind, fmi) for kind in KINDS for fmi in (2, 3)]
EACH = [one for one in ALL if one[0] not in SCENARIOS or one[1] == 2 + (one[0] == "lifting")]
ESTIMATES = ("x", "v", "f_d", "x_m", "k_i", "k_s", "innovation", "variance", "status")


def disturbed(bearing):
    """A step, a load, and noise in 300 samples."""
    T = bearing.sampling_time
    return ambkit.Scenario(
        duration=299 * T,
        seed=3,
        reference=ambkit.Step(amplitude=3e-4, time=20 * T),
        disturbance=ambkit.Step(amplitude=0.5 * bearing.weight, time=150 * T),
        controller=ambkit.PID.for_bearing(bearing),
    )


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    """Export an FMU once for each level of optimisation, which conftest sets for each test."""
    folder, done = tmp_path_factory.mktemp("fmu"), {}

    def make(kind="estimator", fmi=3, bearing=BEARING, **options):
        case = bearing.name, kind, fmi, sources._FLAGS[0], *options.values()
        key = "-".join(map(str, case)) + ".fmu"
        if key not in done:
            if kind in SCENARIOS:
                options["scenario"] = SCENARIOS[kind]
            of = "closed-loop" if kind == "lifting" else kind
            done[key] = export_fmu(bearing, None, folder / key, kind=of, fmi=fmi, **options).path
            assert validate_fmu(str(done[key])) == []
        return done[key]

    return make


@pytest.fixture
def instance(made, tmp_path):
    def make(kind="estimator", fmi=3, **options):
        folder = tmp_path / f"{kind}{fmi}"
        return Instance(folder if folder.exists() else unpacked(made(kind, fmi), folder), **options)

    return make


@pytest.fixture
def command(call):
    """Call ``ambkit export fmu zittau_axial`` with further words."""
    return lambda *words: call("export", "fmu", "zittau_axial", *words)


# ---- What the tools say ----


def fmutool(path):
    pytest.importorskip("fmu_manipulation_toolbox", reason="fmutool is not installed")
    command = [str(Path(sys.executable).with_name("fmutool")), "-input", str(path), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


@pytest.mark.parametrize(
    ("kind", "fmi"), quick(ALL, [("estimator", 3), ("plant", 2), ("lifting", 3)])
)
def test_fmutool_finds_nothing(made, kind, fmi):
    said = fmutool(made(kind, fmi))
    assert f"compliant with FMI-{fmi}.0" in said
    assert f"No semantic error against the FMI-{fmi} standard" in said
    assert "ERROR" not in said
    assert "WARNING" not in said


def test_the_tools_would_find_a_fault(made, tmp_path):
    bad = tmp_path / "bad.fmu"
    with zipfile.ZipFile(made()) as old, zipfile.ZipFile(bad, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'<Output valueReference="3" dependencies="" />', b"")
            new.writestr(name, content)
    assert validate_fmu(str(bad)) != []
    assert "is not listed in <Output>" in fmutool(bad)


@pytest.mark.parametrize(
    ("kind", "fmi", "compiler"),
    quick(
        [(*one, compiler) for one in ALL for compiler in ("gcc", "clang")],
        [(*one, ("gcc", "clang")[k % 2]) for k, one in enumerate(EACH)],
    ),
)
def test_sources_compile_without_warnings(made, tmp_path, kind, fmi, compiler):
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    check_sources(made(kind, fmi), tmp_path, compiler, "-Wdouble-promotion")


def test_a_scenario_s_controller_closes_the_loop(command, tmp_path):
    pid = ambkit.Control(kp=2500, kd=10, derivative_filter=1e-4, feedback="measurement")
    scenario = disturbed(BEARING).replace(controller=pid)
    scenario.save(tmp_path / "run.toml")
    out, own = tmp_path / "loop.fmu", tmp_path / "own.fmu"
    words = ("--kind", "closed-loop", "--scenario", str(tmp_path / "run.toml"))
    assert command(*words, "--filter", "closed-law", "--out", str(out)).code == 0
    export_fmu(BEARING, ClosedLaw(BEARING), own, kind="closed-loop", scenario=scenario)
    assert out.read_bytes() == own.read_bytes()


@pytest.mark.skipif(not shutil.which("cmake") or not shutil.which("make"), reason="cmake and make")
@pytest.mark.parametrize(
    ("kind", "fmi"), quick([("estimator", 2), ("closed-loop", 3)], [("estimator", 2)])
)
def test_sources_alone_compile_to_the_same(made, tmp_path, monkeypatch, kind, fmi):
    monkeypatch.delenv("CC", raising=False)  # CMake looks for a compiler itself
    bare = tmp_path / "bare.fmu"
    with zipfile.ZipFile(made(kind, fmi)) as whole, zipfile.ZipFile(bare, "w") as without:
        for name in whole.namelist():
            if not name.startswith("binaries/"):
                without.writestr(name, whole.read(name))
    with zipfile.ZipFile(bare) as archive:
        assert not any(name.startswith("binaries/") for name in archive.namelist())
    done = subprocess.run(
        [sys.executable, "-m", "fmpy", "compile", str(bare)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    noise = np.random.default_rng(0).normal(0, 1e-5, 300)
    inputs = {"y": noise, "u": 1e4 * noise} if kind == "estimator" else {"r": noise}
    expected = simulated(made(kind, fmi), BEARING.sampling_time, **inputs)
    found = simulated(bare, BEARING.sampling_time, **inputs)
    np.testing.assert_array_equal(found, expected)
    assert np.ptp(found[found.dtype.names[1]]) > 0


# ---- State, instances, parameters ----


NOISY = np.random.default_rng(1).normal(0, 2e-5, (2, 60))
INPUTS = {
    "estimator": {"y": NOISY[0], "u": 5e3 * NOISY[1]},
    "plant": {"u": 5e3 * NOISY[0], "noise_y": NOISY[1]},
    "closed-loop": {"r": NOISY[0], "noise_y": NOISY[1]},
    "lifting": {"r": NOISY[0], "noise_y": NOISY[1]},
    "whole-controller": {"r": NOISY[0], "y": NOISY[1]},
    "controller": {"r": NOISY[0], "x": NOISY[1]},
}
OUTPUTS = {
    "estimator": ESTIMATES,
    "plant": ("x", "v", "x_m", "y", "iu", "f_mag"),
    "closed-loop": ("x", "v", "y", "u", "estimate.f_d", "estimate.variance", "estimate.status"),
    "lifting": ("x", "u", "f_mag", "mode", "estimate.f_d"),
    "whole-controller": ("u", "iu", "coil_0", "on", "mode", "estimate.f_d", "estimate.x"),
    "controller": ("u",),
}


@pytest.mark.parametrize(("kind", "fmi"), EACH)
def test_a_run_is_repeated_exactly_from_a_state(instance, kind, fmi):
    one = instance(kind, fmi).start()
    inputs, names = INPUTS[kind], ("time", *OUTPUTS[kind])
    one.run(inputs, names)
    state = one.fmu.getFMUState()
    stored = one.fmu.serializeFMUState(state)
    first, at = one.run(inputs, names), one.at

    one.fmu.setFMUState(state)
    one.at = len(NOISY[0])
    assert one.run(inputs, names) == first

    other = instance(kind, fmi, name="other").start()
    other.fmu.setFMUState(other.fmu.deserializeFMUState(stored))
    other.at = len(NOISY[0])
    assert other.run(inputs, names) == first
    assert other.at == at

    one.fmu.freeFMUState(state)
    assert not state.value
    one.fmu.reset()
    one.at = 0
    again = one.start().run(inputs, names)
    fresh = instance(kind, fmi, name="fresh").start().run(inputs, names)
    assert again == fresh != first


@pytest.mark.parametrize(("kind", "fmi"), EACH)
def test_instances_do_not_know_of_each_other(instance, kind, fmi):
    inputs, names = INPUTS[kind], OUTPUTS[kind]
    reversed_inputs = {name: values[::-1] for name, values in inputs.items()}
    alone = [instance(kind, fmi).start().run(given, names) for given in (inputs, reversed_inputs)]
    pair = [instance(kind, fmi, name=name).start() for name in ("a", "b")]
    rows = [[], []]
    for k in range(len(NOISY[0])):
        for one, given, found in zip(pair, (inputs, reversed_inputs), rows, strict=True):
            one.step(**{name: values[k] for name, values in given.items()})
            found.append(one.get(*names))
    assert rows == alone
    assert rows[0] != rows[1]


@pytest.mark.parametrize(("kind", "fmi"), [one for one in EACH if one[0] != "controller"])
def test_parameters_can_be_changed_on_the_way(instance, kind, fmi):
    name = "mass" if kind == "plant" else "disturbance_growth"
    runs = []
    for value in (None, "same", "other"):
        one = instance(kind, fmi).start()
        one.run(INPUTS[kind], OUTPUTS[kind])
        old = one.get(name)[0]
        if value is not None:
            one.set(**{name: old if value == "same" else 2 * old})
        runs.append(one.run(INPUTS[kind], OUTPUTS[kind]))
    assert runs[0] == runs[1]
    assert runs[0][1:] != runs[2][1:]


@pytest.mark.parametrize("kind", ["closed-loop", "whole-controller"])
def test_it_starts_where_the_parameters_say(kind, tmp_path):
    """Off the middle, with the current that holds it there, it stays as long as nothing happens."""
    x = 1e-4
    current = float(ambkit.machine.loading.levitation_current(
        BEARING, magnet_of(BEARING), x, BEARING.weight
    ))  # fmt: skip
    scenario = ambkit.Scenario(controller=LQG)
    path = export_fmu(BEARING, None, tmp_path / "made.fmu", kind=kind, scenario=scenario).path
    one = Instance(unpacked(path, tmp_path / "fmu")).start(start_position=x, start_current=current)
    assert one.get("estimate.x") == [x]
    one.step(r=x, **({"y": x} if kind == "whole-controller" else {}))
    pid = LQG.completed(BEARING)
    held = Controller.of_axis(BEARING, KalmanFilter(BEARING), pid).integral(current, x)
    assert one.get("u")[0] * BEARING.amplifier.gain == pytest.approx(current, rel=1e-2)
    assert held != pytest.approx(current, rel=1e-2)  # of another number than the current itself


# ---- Time ----


@pytest.mark.parametrize(("kind", "fmi"), EACH)
def test_whole_multiples_are_as_many_steps_and_time_does_not_drift(instance, kind, fmi):
    start, samples = 12.5, 0
    one = instance(kind, fmi).start(start)
    T = BEARING.sampling_time
    for many in (1, 2, 3, 7, 11) * 40:
        one.fmu.doStep(start + samples * T, (start + (samples + many) * T) - (start + samples * T))
        samples += many
    assert one.get("time") == [start + samples * T]

    single, triple = instance(kind, fmi).start(), instance(kind, fmi).start()
    held = {name: float(values[0]) for name, values in INPUTS[kind].items()}
    for _ in range(3):
        single.step(**held)
    triple.step(3, **held)
    assert single.get(*OUTPUTS[kind]) == triple.get(*OUTPUTS[kind])


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_estimator_samples_inside_whatever_the_master_steps(instance, fmi):
    """Steps of half a sample, and of 1.23: y and u are those set when a sample begins."""
    T, held = BEARING.sampling_time, INPUTS["estimator"]
    y, u = (np.asarray(held[name]) for name in ("y", "u"))
    for step in (0.5, 0.25, 1.23, 3.7, 1 / 3):
        one, whole = instance("estimator", fmi).start(), instance("estimator", fmi).start()
        taken, k = 0, 0
        while True:
            begin, end = k * step, (k + 1) * step
            ends = round(end) if abs(end - round(end)) < 1e-9 else int(end) + 1
            if ends > len(y):
                break
            at = min(int(begin + 1e-9), len(y) - 1)
            one.set(y=y[at], u=u[at])
            one.fmu.doStep(begin * T, step * T)
            for _ in range(taken, ends):
                whole.step(y=y[at], u=u[at])
            taken, k = ends, k + 1
            assert one.get(*ESTIMATES) == whole.get(*ESTIMATES), (step, k)
        assert one.get("time") == [pytest.approx(k * step * T, rel=1e-12)]


@pytest.mark.parametrize(
    "bearing", [BEARING, IRON, WITH_PARTS], ids=["plain", "iron", "with parts"]
)
@pytest.mark.parametrize("kind", ["plant", "closed-loop"])
def test_a_plant_can_be_asked_between_two_samples(made, tmp_path, kind, bearing):
    folder = unpacked(made(kind, 3, bearing), tmp_path / "fmu")
    inputs = {"u": 0.5, "f_d": 2.0} if kind == "plant" else {"r": 1e-4, "f_d": 2.0}
    coarse, fine = Instance(folder).start(), Instance(folder).start()
    T = bearing.sampling_time
    xs = [coarse.get("x", "v")]
    for n in range(40):
        coarse.step(**inputs)
        xs.append(coarse.get("x", "v"))
        fine.set(**inputs)
        fine.fmu.doStep(n * T, T / 2)
        half = fine.get("x", "v")
        fine.fmu.doStep((n + 0.5) * T, T / 2)
        np.testing.assert_allclose(fine.get("x", "v"), xs[-1], rtol=1e-9, atol=1e-13)
        (x0, v0), (x1, v1) = xs[-2:]
        middle = (x0 + x1) / 2 + T / 8 * (v0 - v1)
        assert half[0] == pytest.approx(middle, rel=1e-6, abs=1e-11)


@pytest.mark.parametrize("fmi", [2, 3])
def test_any_output_interval_comes_to_an_end(made, fmi):
    for kind in ("estimator", "plant", "closed-loop"):
        result = fmpy.simulate_fmu(
            str(made(kind, fmi)), stop_time=0.0123 * 5, output_interval=0.0123
        )
        assert result["time"][-1] == pytest.approx(0.0123 * 5)


@pytest.mark.parametrize("fmi", [2, 3])
def test_nan_is_a_lost_sensor(instance, fmi):
    one = instance("estimator", fmi).start()
    for k in range(20):
        one.step(y=1e-6 * (k % 3), u=0.0)
    sure = one.get("std_x")
    one.step(y=np.nan, u=np.nan)
    one.step(y=np.nan, u=np.nan)
    assert one.get("status") == [ambkit.Status.MISSING | ambkit.Status.BAD_CONTROL]
    assert one.get("std_x") > sure
    assert np.isfinite(one.get(*ESTIMATES)).all()


def test_faults_of_the_plant(instance):
    one, well = instance("plant").start(), instance("plant").start()
    for n in range(30):
        one.step(u=-1.0, noise_y=1e-6 * n)
        well.step(u=-1.0, noise_y=1e-6 * n)
    assert one.get("x", "y", "iu") == well.get("x", "y", "iu")
    (y,) = well.get("y")
    one.set(fault_y_gain=2.0, fault_y_offset=1e-4)
    assert one.get("y") == [2.0 * y + 1e-4]
    one.set(fault_y_gain=1.0, fault_y_offset=0.0, fault_frozen=1.0)
    frozen = one.get("y")
    one.step(u=1.0)
    assert one.get("y") == frozen
    one.set(fault_frozen=0.0, noise_y=np.nan)
    assert np.isnan(one.get("y")).all()
    one.step(u=1.0, fault_current=0.2)
    assert one.get("iu") == [pytest.approx(0.2 * BEARING.current_max)]
    one.step(u=0.5, fault_u_gain=-1.0, fault_current=1.0)
    assert one.get("iu") == [pytest.approx(-0.5 * BEARING.amplifier.gain)]


# ---- Several in one file ----


@pytest.mark.parametrize("law", [ambkit.Control(), LQG], ids=["PID", "LQG"])
def test_a_system_wires_plant_estimator_and_controller(law, tmp_path):
    """Driven by FMPy: the rotor levitates under a load, which the estimate finds."""
    from fmpy.ssp.simulation import simulate_ssp

    path, T = tmp_path / "loop.ssp", BEARING.sampling_time
    export_ssp(BEARING, None, path, scenario=ambkit.Scenario(controller=law))
    at_rest = dict.fromkeys(("r", "noise_u", "noise_y"), lambda _t: 0.0)
    load = {"f_d": lambda t: 1.0 if t > 0.05 else 0.0}
    found = simulate_ssp(str(path), stop_time=0.3, step_size=T, input=at_rest | load)
    assert np.abs(found["x"]).max() < 0.15 * BEARING.clearance
    assert abs(found["x"][-1]) < 0.05 * BEARING.clearance
    assert found["estimate_f_d"][-1] == pytest.approx(1.0, rel=0.05)


def test_a_system_is_what_the_standard_says(tmp_path):
    from fmpy.ssp.ssd import read_ssd

    for feedback in ("estimate", "measurement"):
        path = tmp_path / f"{feedback}.ssp"
        scenario = ambkit.Scenario(controller=ambkit.Control(feedback=feedback))
        export_ssp(BEARING, None, path, scenario=scenario, fmi=3)
        system = read_ssd(str(path)).system  # validates against the schema
        assert {element.name for element in system.elements} == {
            "plant", "estimator", "controller",
        }  # fmt: skip
        wires = {(c.startElement, c.endElement) for c in system.connections}
        assert (("estimator", "controller") in wires) == (feedback == "estimate")
        assert (("plant", "controller") in wires) == (feedback == "measurement")


def test_a_system_lifts_off_and_lands(tmp_path):
    """Driven by FMPy: plant and whole controller, two files."""
    from fmpy.ssp.simulation import simulate_ssp
    from fmpy.ssp.ssd import read_ssd

    path = tmp_path / "lift.ssp"
    export_ssp(BEARING, None, path, scenario=LIFTS)
    system = read_ssd(str(path)).system  # validates against the schema
    assert {element.name for element in system.elements} == {"plant", "controller"}
    zero = dict.fromkeys(("r", "noise_u", "f_d"), lambda _t: 0.0)
    noise = np.random.default_rng(0).normal(0, 2e-6, 2000)  # without, the sensor is a frozen one
    found = simulate_ssp(
        str(path), stop_time=0.1, step_size=BEARING.sampling_time,
        input=zero | {
            "fly": lambda t: 1.0 if t < 0.06 else 0.0,
            "noise_y": lambda t: float(noise[round(t / BEARING.sampling_time)]),
        },
    )  # fmt: skip
    assert {0.0, 1.0, 2.0, 3.0, 4.0} <= set(found["mode"])
    flying = found["x"][found["mode"] == Mode.FLYING]
    assert found["x"][0] == -BEARING.clearance
    assert np.abs(flying[-50:]).max() < 0.1 * BEARING.clearance


GOES_ON = """
import pickle, sys
from fmu_instance import Instance
folder, given, out = sys.argv[1:]
state, inputs, names = pickle.load(open(given, "rb"))
other = Instance(folder).start()
other.fmu.setFMUState(other.fmu.deserializeFMUState(state))
other.at = len(inputs["y_La1"])
pickle.dump(other.run(inputs, names), open(out, "wb"))
"""


def test_the_bytes_of_a_state_go_on_in_another_process(tmp_path):
    scenario = ambkit.Scenario(seed=3, duration=40 * RIG.sampling_time)
    run = simulate_run(RIG, scenario, estimator=KalmanFilter(RIG))
    axes = [axis.name for axis in RIG.axes]
    path = export_fmu(RIG, None, tmp_path / "filter.fmu", fmi=2).path
    folder, names = unpacked(path, tmp_path / "unpacked"), tuple(f"f_d_{name}" for name in axes)
    inputs = {name: run.record[name] for name in run.record.signals if name[0] in "yu"}
    first, rest = ({name: at[part] for name, at in inputs.items()}
                   for part in (slice(20), slice(20, 40)))  # fmt: skip
    one = Instance(folder).start()
    one.run(first, names)
    state = one.fmu.serializeFMUState(one.fmu.getFMUState())
    given, out = tmp_path / "given", tmp_path / "out"
    given.write_bytes(pickle.dumps((state, rest, names)))
    command = [sys.executable, "-c", GOES_ON, str(folder), str(given), str(out)]
    subprocess.run(command, check=True, cwd=Path(__file__).parent)
    assert pickle.loads(out.read_bytes()) == one.run(rest, names)


def test_the_system_of_several_axes_wires_all_of_them(tmp_path):
    from fmpy.ssp.simulation import simulate_ssp

    axes, readings = [at.name for at in RIG.axes], [f"y_{at.name}" for at in RIG.readings]
    path, step = tmp_path / "system.ssp", 0.05 * RIG.bearings[0].clearance
    made = export_ssp(RIG, None, path, scenario=ambkit.Scenario(noise=False))
    assert [one.kind for one in made] == ["plant", "controller", "estimator"]
    zero = dict.fromkeys(
        ["base_x", "base_y", *(f"{what}_{name}" for what in ("r", "f_d", "noise_u")
         for name in axes), *(f"noise_{name}" for name in readings)], lambda _t: 0.0,
    )  # fmt: skip
    found = simulate_ssp(
        str(path), stop_time=0.2, step_size=RIG.sampling_time,
        input=zero | {"speed": lambda _t: RIG.speed,
                      "r_A1": lambda t: step if t > 0.02 else 0.0},
    )  # fmt: skip
    reference = [Reference(axis="A1", position=ambkit.Step(amplitude=step, time=0.02))]
    scenario = ambkit.Scenario(noise=False, duration=0.2, reference=reference)
    run = simulate_run(RIG, scenario, estimator=KalmanFilter(RIG))
    for name in axes:  # each wire of an SSP holds its value back by a sample
        wanted = run.record[f"s_{name}"][-1]
        assert abs(found[f"s_{name}"][-1] - wanted) < 0.05 * step, name
    np.testing.assert_allclose(found["estimate_x"][-1], found["q_x"][-1], atol=0.05 * step)


@pytest.mark.skipif(
    shutil.which("aarch64-linux-gnu-gcc") is None, reason="aarch64-linux-gnu-gcc is not installed"
)
@pytest.mark.parametrize(("fmi", "folder"), [(2, "aarch64-linux"), (3, "aarch64-linux")])
def test_several_platforms_in_one_file(tmp_path, fmi, folder):
    path = export_fmu(BEARING, None, tmp_path / "f.fmu", fmi=fmi, everywhere=True).path
    with zipfile.ZipFile(path) as archive:
        binaries = [name for name in archive.namelist() if name.startswith("binaries/")]
        (arm,) = (name for name in binaries if name.startswith(f"binaries/{folder}/"))
        header = archive.read(arm)[:20]
    assert len(binaries) >= 2
    assert header[:4] == b"\x7fELF"
    assert int.from_bytes(header[18:20], "little") == 183  # EM_AARCH64


# ---- What is refused ----


def refused(capsys, said, call, *arguments):
    """The call fails, and its message has these words."""
    capsys.readouterr()
    with pytest.raises((FMICallException, Exception), match=r"returned|failed|Failed"):
        call(*arguments)
    assert said in capsys.readouterr().out


@pytest.mark.parametrize("fmi", [2, 3])
def test_what_is_refused_is_told_and_changes_nothing(instance, capsys, fmi):
    no = lambda said, call, *arguments: refused(capsys, said, call, *arguments)  # noqa: E731
    inputs, names = INPUTS["estimator"], ESTIMATES
    expected = instance("estimator", fmi).start().run(inputs, names)

    no("is not that of this model", lambda: instance("estimator", fmi, token="{100%s}"))
    one = instance("estimator", fmi)
    no("a step is not possible before initialization", one.fmu.doStep, 0.0, 1e-4)
    no("the end of initialization is not", one.fmu.exitInitializationMode)
    no("there is no state to go back to", one.fmu.setFMUState, None)
    one.start()
    half = len(NOISY[0]) // 2
    found = one.run({name: values[:half] for name, values in inputs.items()}, names)
    at = one.at * one.T
    for bad in (np.nan, np.inf, -np.inf):
        no(" must be ", lambda bad=bad: one.set(u=1.0, control_variance=bad))
    no("control_variance must be 0 or greater", lambda: one.set(control_variance=-1.0))
    no("measurement_variance must be greater", lambda: one.set(measurement_variance=0.0))
    no("x cannot be set between steps", lambda: one.set(x=0.0))
    no("is not possible", one.fmu.doStep, at, 0.0)
    no("is not possible", one.fmu.doStep, at, -1e-4)
    no("is not possible", one.fmu.doStep, at, 1e300)
    no("a step must begin at", one.fmu.doStep, at + 1e-4, 1e-4)
    no("is not possible", one.fmu.doStep, at, np.nan)
    no("is not possible", one.fmu.doStep, np.nan, 1e-4)
    no("initialization is not possible between steps", one.fmu.enterInitializationMode)
    getter = one.fmu.getReal if fmi == 2 else one.fmu.getFloat64
    no("no variable with the value reference 4000000000", getter, [4_000_000_000])
    no("status is an integer variable", getter, [one.vr["status"]])
    no("there are no Boolean", one.fmu.getBoolean, [0])
    stored = bytearray(one.fmu.serializeFMUState(one.fmu.getFMUState()))
    stored[len(stored) // 2] ^= 1
    no("are not a state of this model", one.fmu.deserializeFMUState, bytes(stored))
    no("are not a state of this model", one.fmu.deserializeFMUState, b"short")
    # All of that left no trace.
    found += one.run({name: values[half:] for name, values in inputs.items()}, names)
    assert found == expected
    one.fmu.terminate()
    no("a step is not possible after termination", one.fmu.doStep, at, 1e-4)


def test_states_of_another_model_are_refused(instance, capsys):
    plant, loop = instance("plant").start(), instance("closed-loop").start()
    stored = plant.fmu.serializeFMUState(plant.fmu.getFMUState())
    refused(capsys, "are not a state", loop.fmu.deserializeFMUState, stored)


def test_what_is_refused_of_a_loop(tmp_path):
    lifts = ambkit.Scenario(sequence=QUICK)
    with pytest.raises(AmbkitError, match="use kind whole-controller"):
        export_fmu(BEARING, None, tmp_path / "a.fmu", kind="controller", scenario=lifts)
    with pytest.raises(AmbkitError, match="closed-loop computes in double"):
        export_fmu(BEARING, None, tmp_path / "a.fmu", kind="closed-loop", precision="float")
    with pytest.raises(AmbkitError, match="plant computes in double"):
        export_fmu(BEARING, None, tmp_path / "a.fmu", kind="plant", precision="float")


@pytest.mark.parametrize("kind", ["estimator", "closed-loop", "whole-controller"])
def test_a_filter_that_needs_the_angle_is_refused(kind, tmp_path):
    rig = RIG.replace(angle={"type": "pulses"})
    with pytest.raises(AmbkitError, match="no input for the sensor of the angle"):
        ambkit.export_fmu(rig, "linear+unbalance", out=tmp_path / "a.fmu", kind=kind)
    assert os.listdir(tmp_path) == []


def test_a_controller_without_its_filter_needs_no_angle(tmp_path):
    rig = RIG.replace(angle={"type": "pulses"})
    ambkit.export_fmu(rig, "linear+unbalance", out=tmp_path / "a.fmu", kind="controller")
    assert validate_fmu(str(tmp_path / "a.fmu")) == []


# ---- The file ----


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_same_input_gives_the_same_bytes(made, tmp_path, fmi):
    again = export_fmu(BEARING, None, tmp_path / "again.fmu", fmi=fmi)
    assert again.path.read_bytes() == made("estimator", fmi).read_bytes()
    heavier = export_fmu(BEARING.replace(rotor__mass=0.519), None, tmp_path / "h.fmu", fmi=fmi)
    assert heavier.token != again.token


def test_all_needs_no_python_and_no_other_library(made, tmp_path):
    if shutil.which("ldd") is None:
        pytest.skip("there is no ldd")
    (binary,) = unpacked(made("closed-loop"), tmp_path).rglob("*.so")
    used = subprocess.run(["ldd", str(binary)], capture_output=True, text=True, check=True).stdout
    libraries = {line.split()[0].split("/")[-1].split(".")[0] for line in used.splitlines()}
    assert libraries <= {"linux-vdso", "libc", "ld-linux-x86-64", "ld-linux-aarch64", "statically"}


def test_without_a_compiler_it_says_so(tmp_path, monkeypatch):
    out = tmp_path / "a.fmu"
    monkeypatch.setenv("CC", "no-such-compiler -O2")
    with pytest.raises(AmbkitError, match=r"no C compiler \(no-such-compiler\)"):
        export_fmu(BEARING, None, out)
    monkeypatch.setenv("CC", "false")
    with pytest.raises(AmbkitError, match="false cannot compile"):
        export_fmu(BEARING, None, out)
    monkeypatch.delenv("CC")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(AmbkitError, match=r"no C compiler \(cc, gcc, clang\)"):
        export_fmu(BEARING, None, out)
    assert not out.exists()


def test_command(command, tmp_path):
    out = tmp_path / "plant.fmu"
    done = command("--kind", "plant", "--fmi", "2", "--out", str(out))
    assert (done.code, validate_fmu(str(out))) == (0, [])
    assert f"{out}: FMI 2.0, " in done.out
    assert done.err == f"wrote {out}\n"
    assert os.listdir(tmp_path) == ["plant.fmu"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--kind plant --filter e.json --out plant.fmu", "a plant has none"),
        ("--scenario run.toml --out filter.fmu", "only these have a controller"),
        ("--kind closed-loop --scenario run.toml --out loop.fmu", "run.toml: cannot be read"),
        ("--out plant.zip", "must end with .fmu"),
        ("--filter closed-lav --out filter.fmu", "did you mean closed-law?"),
        ("--filter missing.json --out filter.fmu", "missing.json: cannot be read"),
    ],
)
def test_what_the_command_refuses(command, words, said):
    done = command(*words.split())
    assert done.code == 2
    assert said in done.err
    assert os.listdir() == []


def test_an_fmu_estimates_what_turns_with_the_rotor_too(tmp_path):
    made = ambkit.export_fmu("tum_mlps", "linear+unbalance", out=tmp_path / "f.fmu")
    names = [state.name for state in KalmanFilter(RIG, synchronous=("unbalance",)).states]
    assert set(names) <= set(made.to_dict()["variables"])
