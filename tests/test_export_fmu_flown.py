"""FMUs of all that flies beyond a PID: equal to `simulate` to the last bit, in FMPy."""

from __future__ import annotations

import shutil
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from exporting import export_fmu, export_ssp
from quick import quick

import ambkit
from ambkit import PID, Bearing, Control, KalmanFilter, Scenario
from ambkit.base.errors import AmbkitError
from ambkit.control.controller_states import Controller
from ambkit.control.lift_off_sequence import LiftOff, Mode
from ambkit.estimate.registry import KINDS
from ambkit.simulation.run import simulate_run

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import Instance, check_sources, simulated, unpacked  # noqa: E402
from iron import TWO_SIDED as IRON  # noqa: E402
from test_export_fmu import check_loop  # noqa: E402

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


def estimator_of(case, precision="float64"):
    return KINDS[case.estimator].make(case.bearing, precision=precision)


def flown(case, precision="float64"):
    return simulate_run(case.bearing, scenario_of(case), estimator=estimator_of(case, precision))


def exported(case, folder, kind, **options):
    path = export_fmu(
        case.bearing, None, folder / "flown.fmu", kind=kind, scenario=scenario_of(case),
        filter=case.estimator, **options,
    ).path  # fmt: skip
    assert validate_fmu(str(path)) == []
    return path


BOTH_WAYS = [(name, k % 2) for k, name in enumerate(CASES)] + [("lqg that lifts", 1)]


@pytest.mark.parametrize(("name", "fmi"), [(name, 2 + way) for name, way in BOTH_WAYS])
def test_the_closed_loop_is_what_simulate_flies(name, fmi, tmp_path):
    case = CASES[name]
    path = exported(case, tmp_path, "closed-loop", fmi=fmi)
    record = check_loop(path, scenario_of(case), estimator_of(case), moved=1e-6).record
    if case.start == "landed" and case.sequence is not None:
        modes = {Mode(int(mode)) for mode in record["mode"]}
        assert modes >= {Mode.WAITING, Mode.LIFTING, Mode.FLYING, Mode.LANDING, Mode.OFF}


@pytest.mark.parametrize(
    ("name", "precision"), [(name, ("float", "double")[way]) for name, way in BOTH_WAYS]
)
def test_the_whole_controller_is_what_simulate_flies(name, precision, tmp_path):
    case = CASES[name]
    numbers = {"float": "float32", "double": "float64"}[precision]
    run = flown(case, numbers)
    record, inputs = run.record, {"y": run.record["y"], "r": run.record["r"]}
    if case.sequence is not None:
        inputs["fly"] = case.sequence.fly(record.t)
    fmi = 2 if precision == "float" else 3
    path = exported(case, tmp_path, "whole-controller", precision=precision, fmi=fmi)
    found = simulated(path, case.bearing.sampling_time, **inputs)
    np.testing.assert_array_equal(found["u"][1:], record["u"])
    for name in run.estimate.names:
        np.testing.assert_array_equal(found[f"estimate.{name}"][1:], run.estimate[name], name)
    np.testing.assert_array_equal(found["estimate.status"][1:], run.estimate.status)
    if case.sequence is None:
        return
    np.testing.assert_array_equal(found["mode"][1:], record["mode"])
    if case.start == "levitated":
        return
    pid, estimator = case.controller.completed(case.bearing), estimator_of(case, numbers)
    told = Controller.of_axis(case.bearing, estimator, pid, case.sequence).run(**inputs)
    np.testing.assert_array_equal(found["iu"][1:], told["iu"])
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
    states = {state: run.estimate[state] for state in run.estimate.names}
    path = exported(case, tmp_path, "controller", fmi=fmi)
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
    path = exported(case, tmp_path, kind)
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
    check_sources(exported(case, tmp_path, kind, precision=precision), tmp_path / "fmu", compiler)


def test_a_run_from_power_on_is_repeated_from_a_state(tmp_path):
    path = exported(CASES["lqg that lifts"], tmp_path, "closed-loop")
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
