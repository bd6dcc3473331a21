"""FMUs of all that flies beyond a PID: equal to `simulate` to the last bit, in FMPy."""

from __future__ import annotations

import shutil
import subprocess
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import PID, Bearing, Control, KalmanFilter, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.control.controller_states import Controller
from ambkit.control.lift_off_sequence import LiftOff, Mode
from ambkit.estimate.registry import KINDS
from ambkit.export.fmu import export_fmu, export_ssp
from ambkit.simulation.recording import drawn
from ambkit.simulation.run import simulate_run

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import Instance, unpacked  # noqa: E402
from iron import TWO_SIDED as IRON  # noqa: E402

BEARING = Bearing.preset("zittau_axial")
ONE_SIDED = Bearing.preset("inteco_ml")
SOFT = BEARING.replace(name="soft", amplifier__bandwidth="1 kHz", delay="0.12 ms")
QUICK = LiftOff(wait=2e-3, lift=0.02, land=0.02, stop=0.06)


class Case(NamedTuple):
    bearing: Bearing
    controller: PID
    sequence: LiftOff | None = None
    start: str = "levitated"
    estimator: str = "linear"


CASES = {
    "lqg": Case(BEARING, Control(type="lqg")),
    "feed forward": Case(BEARING, PID(feed_forward=0.8), estimator="extended"),
    "lqg that lifts": Case(BEARING, Control(type="lqg"), QUICK, "landed"),
    "lqg of an amplifier's states": Case(SOFT, Control(type="lqg"), estimator="extended"),
    "one-sided that lifts": Case(
        ONE_SIDED, PID(), QUICK.model_copy(update={"stop": 0.3}), "landed"
    ),
    "sensor's PID that lifts": Case(IRON, Control(feedback="measurement"), QUICK, "landed"),
    "feed forward in flight that lands": Case(SOFT, PID(feed_forward=1.0), QUICK),
    "from rest": Case(BEARING, Control(type="lqg"), None, "released"),
}


def scenario_of(case):
    T = case.bearing.sampling_time
    return Scenario.model_validate({
        "duration": (300 if case.start == "levitated" else 1200) * T,
        "seed": 3,
        "start": case.start,
        "sequence": case.sequence,
        "controller": case.controller,
        "reference": ambkit.Step(amplitude=0.05 * case.bearing.rotor.clearance, time=40 * T),
        "disturbance": ambkit.Step(amplitude=0.3 * case.bearing.weight, time=150 * T),
    })  # fmt: skip


def flown(case, precision="float64"):
    estimator = KINDS[case.estimator].make(case.bearing, precision=precision)
    return simulate_run(case.bearing, scenario_of(case), estimator=estimator)


def simulated(path, T, **inputs):
    n = len(next(iter(inputs.values())))
    signals = np.zeros(n, dtype=[("time", float), *((name, float) for name in inputs)])
    signals["time"] = T * np.arange(n)
    for name, values in inputs.items():
        signals[name] = values
    return fmpy.simulate_fmu(str(path), stop_time=n * T, output_interval=T, input=signals)


def check_estimate(found, run):
    assert run.estimate is not None
    for name in run.estimate.names:
        np.testing.assert_array_equal(found[f"estimate.{name}"][1:], run.estimate[name], name)
    np.testing.assert_array_equal(found["estimate.status"][1:], run.estimate.status)


BOTH_WAYS = [(name, k % 2) for k, name in enumerate(CASES)] + [("lqg that lifts", 1)]


@pytest.mark.parametrize(("name", "fmi"), [(name, 2 + way) for name, way in BOTH_WAYS])
def test_the_closed_loop_is_what_simulate_flies(name, fmi, tmp_path):
    case = CASES[name]
    run, scenario = flown(case), scenario_of(case)
    record, n = run.record, len(run.record.t)
    noise_u, noise_y = (noise[:, 0] for noise in drawn(case.bearing, scenario, n))
    inputs = {"r": record["r"], "f_d": record["f_d"], "noise_u": noise_u, "noise_y": noise_y}
    if case.sequence is not None:
        inputs["fly"] = case.sequence.fly(record.t)
    path = export_fmu(
        case.bearing, None, tmp_path / "loop.fmu", kind="closed-loop", fmi=fmi, scenario=scenario,
        filter=case.estimator,
    ).path  # fmt: skip
    assert validate_fmu(str(path)) == []
    found = simulated(path, case.bearing.sampling_time, **inputs)
    for signal in ("x", "v", "x_m"):
        np.testing.assert_array_equal(found[signal][:n], record[signal], signal)
    for signal in ("y", "u", "iu", *(["mode"] if case.sequence else [])):
        np.testing.assert_array_equal(found[signal][1:], record[signal], signal)
    check_estimate(found, run)
    assert np.ptp(record["x"]) > 1e-6
    if case.start == "landed" and case.sequence is not None:
        modes = {Mode(int(mode)) for mode in record["mode"]}
        assert modes >= {Mode.WAITING, Mode.LIFTING, Mode.FLYING, Mode.LANDING, Mode.OFF}


@pytest.mark.parametrize(
    ("name", "precision"), [(name, ("float", "double")[way]) for name, way in BOTH_WAYS]
)
def test_the_whole_controller_is_what_simulate_flies(name, precision, tmp_path):
    case = CASES[name]
    numbers = {"float": "float32", "double": "float64"}[precision]
    run, scenario = flown(case, numbers), scenario_of(case)
    record = run.record
    inputs = {"y": record["y"], "r": record["r"]}
    if case.sequence is not None:
        inputs["fly"] = case.sequence.fly(record.t)
    path = export_fmu(
        case.bearing, None, tmp_path / "flown.fmu", kind="whole-controller", scenario=scenario,
        filter=case.estimator, precision=precision, fmi=2 if precision == "float" else 3,
    ).path  # fmt: skip
    assert validate_fmu(str(path)) == []
    found = simulated(path, case.bearing.sampling_time, **inputs)
    np.testing.assert_array_equal(found["u"][1:], record["u"])
    check_estimate(found, run)
    if case.sequence is None:
        return
    np.testing.assert_array_equal(found["mode"][1:], record["mode"])
    if case.start == "levitated":
        return
    estimator = KINDS[case.estimator].make(case.bearing, precision=numbers)
    pid = case.controller.completed(case.bearing)
    told = Controller.of_axis(case.bearing, estimator, pid, case.sequence).run(**inputs)
    for k in range(told["coil"].shape[1]):
        np.testing.assert_array_equal(found[f"coil_{k}"][1:], told["coil"][:, k])
    np.testing.assert_array_equal(found["on"][1:], told["on"])
    np.testing.assert_array_equal(found["status"][1:], told["status"])
    assert {0.0, 1.0} == set(found["on"])


@pytest.mark.parametrize(
    ("name", "fmi"), [("lqg", 2), ("feed forward", 3), ("lqg of an amplifier's states", 3)]
)
def test_a_controller_alone_takes_all_states(name, fmi, tmp_path):
    case = CASES[name]
    run = flown(case)
    assert run.estimate is not None
    states = {state: run.estimate[state] for state in run.estimate.names}
    path = export_fmu(
        case.bearing, None, tmp_path / "c.fmu", kind="controller", fmi=fmi,
        scenario=scenario_of(case), filter=case.estimator,
    ).path  # fmt: skip
    assert validate_fmu(str(path)) == []
    found = simulated(path, case.bearing.sampling_time, r=run.record["r"], **states)
    np.testing.assert_array_equal(found["u"][1:], run.record["u"])
    one = Instance(unpacked(path, tmp_path / "fmu")).start()
    assert one.get("u")[0] * case.bearing.amplifier.gain == pytest.approx(
        one.get("start_current")[0]
    )


@pytest.mark.parametrize("kind", ["closed-loop", "whole-controller"])
def test_it_starts_where_the_parameters_say(kind, tmp_path):
    """Off the middle, with the current that holds it there, it stays as long as nothing happens."""
    case = CASES["lqg"]
    x = 1e-4
    current = float(ambkit.machine.loading.levitation_current(
        BEARING, ambkit.magnet_of(BEARING), x, BEARING.weight
    ))  # fmt: skip
    path = export_fmu(BEARING, None, tmp_path / "a.fmu", kind=kind, scenario=scenario_of(case)).path
    one = Instance(unpacked(path, tmp_path / "fmu")).start(start_position=x, start_current=current)
    assert one.get("estimate.x") == [x]
    one.step(r=x, **({"y": x} if kind == "whole-controller" else {}))
    pid = case.controller.completed(BEARING)
    held = Controller.of_axis(BEARING, KalmanFilter(BEARING), pid).integral(current, x)
    assert one.get("u")[0] * BEARING.amplifier.gain == pytest.approx(current, rel=1e-2)
    assert held != pytest.approx(current, rel=1e-2)  # of another number than the current itself


@pytest.mark.parametrize(("kind", "compiler"), quick(
    product(["closed-loop", "whole-controller", "controller"], ["gcc", "clang"]),
    [("closed-loop", "gcc"), ("whole-controller", "clang"), ("controller", "gcc")],
))  # fmt: skip
def test_sources_compile_without_warnings(kind, compiler, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"there is no {compiler}")
    case = CASES["lqg" if kind == "controller" else "lqg that lifts"]
    precision = "float" if kind == "whole-controller" else "double"
    path = export_fmu(
        BEARING, None, tmp_path / "a.fmu", kind=kind, scenario=scenario_of(case),
        precision=precision,
    ).path  # fmt: skip
    sources = unpacked(path, tmp_path / "fmu") / "sources"
    warnings = "-Wall -Wextra -Wpedantic -Wconversion -Wno-unused-parameter"
    files = [str(file.relative_to(sources)) for file in sources.rglob("*.c")]
    command = [compiler, "-std=c99", "-fsyntax-only", "-Werror", *warnings.split(), "-I.", *files]
    subprocess.run(command, cwd=sources, check=True)


def test_a_run_from_power_on_is_repeated_from_a_state(tmp_path):
    case = CASES["lqg that lifts"]
    path = export_fmu(
        BEARING, None, tmp_path / "a.fmu", kind="closed-loop", scenario=scenario_of(case)
    ).path
    one = Instance(unpacked(path, tmp_path / "fmu")).start()
    names, noise = ("x", "u", "f_mag", "mode"), np.random.default_rng(0).normal(0, 1e-6, 250)
    first = one.run({"noise_y": noise}, names)
    assert first[0][names.index("f_mag")] == 0
    state = one.fmu.getFMUState()
    on = one.run({"noise_y": noise}, names)
    one.fmu.setFMUState(state)
    one.at = len(noise)
    assert one.run({"noise_y": noise}, names) == on != first


def test_a_system_lifts_off_and_lands(tmp_path):
    """Driven by FMPy: plant and whole controller, two files."""
    from fmpy.ssp.simulation import simulate_ssp
    from fmpy.ssp.ssd import read_ssd

    scenario = Scenario(start="landed", sequence=QUICK, controller=Control(type="lqg"))
    path = tmp_path / "lift.ssp"
    export_ssp(BEARING, None, path, scenario=scenario)
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
    assert found["x"][0] == -BEARING.rotor.clearance
    assert np.abs(flying[-50:]).max() < 0.1 * BEARING.rotor.clearance


def test_a_system_of_a_regulator_wires_all_states(tmp_path):
    from fmpy.ssp.simulation import simulate_ssp

    export_ssp(BEARING, None, tmp_path / "a.ssp", scenario=Scenario(controller=Control(type="lqg")))
    zero = dict.fromkeys(("r", "noise_u", "noise_y"), lambda _t: 0.0)
    found = simulate_ssp(
        str(tmp_path / "a.ssp"), stop_time=0.2, step_size=BEARING.sampling_time,
        input=zero | {"f_d": lambda t: 1.0 if t > 0.05 else 0.0},
    )  # fmt: skip
    assert found["estimate_f_d"][-1] == pytest.approx(1.0, rel=0.1)
    assert abs(found["x"][-1]) < 0.05 * BEARING.rotor.clearance


def test_what_is_refused(tmp_path):
    lifts = Scenario(sequence=QUICK)
    with pytest.raises(AmbkitError, match="use kind whole-controller"):
        export_fmu(BEARING, None, tmp_path / "a.fmu", kind="controller", scenario=lifts)
    with pytest.raises(AmbkitError, match="closed-loop computes in double"):
        export_fmu(BEARING, None, tmp_path / "a.fmu", kind="closed-loop", precision="float")
