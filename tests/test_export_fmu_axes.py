"""FMUs of machines with several axes: equal to the library to the last bit, in FMPy."""

import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from exporting import export_fmu, export_ssp
from quick import quick

from ambkit import KalmanFilter, Machine, Scenario, Step
from ambkit.control.lift_off_sequence import LiftOff
from ambkit.export import fmu
from ambkit.simulation.recording import drawn
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import Disturbance, Reference

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

import fmu_instance  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import Instance, unpacked  # noqa: E402
from machine_cases import bearing, machine, sensor  # noqa: E402

MACHINE = Machine.preset("tum_mlps")
FIVE = machine(
    name="five_axes",
    bearing=[bearing("A", 0.2), bearing("B", -0.3), bearing("T", 0.1, type="thrust")],
    sensor=[
        sensor("A", 0.2, quantisation=0.2e-6), sensor("B", -0.3), sensor("T", 0.1, type="axial"),
    ],
    unbalance=[{"place": 0.1, "amount": 2e-5}],
)  # fmt: skip
PLANTS = {"tum_mlps": MACHINE, "ufu_rig": Machine.preset("ufu_rig"), "five": FIVE}
""" "ufu_rig" has amplifiers that lag and a dead time. """
QUICK = LiftOff(wait=2e-3, lift=0.02, land=0.02, stop=0.08)
LOOPS = {
    "five": (FIVE, {"duration": 0.03}),
    "compressor": (Machine.preset("compressor"), {"duration": 0.02}),
    "measured": (MACHINE, {"duration": 0.03, "feedback": "measurement"}),
    "lifts": (MACHINE, {"duration": 0.12, "start": "landed", "sequence": QUICK}),
}


def loaded(machine):
    """A step of the first reference, and one of the last load."""
    axes = machine.axes
    reference = Step(amplitude=0.05 * axes[0].bearing.clearance, time=20 * machine.sampling_time)
    load = Step(amplitude=0.5, time=60 * machine.sampling_time)
    return {
        "reference": [Reference(axis=axes[0].name, position=reference)],
        "disturbance": [Disturbance(axis=axes[-1].name, force=load)],
    }


T = MACHINE.sampling_time
READINGS = [f"y_{reading.name}" for reading in MACHINE.readings]
AXES = [axis.name for axis in MACHINE.axes]
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


def flown(**options):
    scenario = Scenario(seed=3, **options)
    return scenario, simulate_run(MACHINE, scenario, estimator=KalmanFilter(MACHINE))


def simulated(path, run, names, start_values=None, **more):
    inputs = {name: run.record[name] for name in names} | more
    return fmu_instance.simulated(path, run.machine.sampling_time, start_values, **inputs)


@pytest.mark.parametrize(("fmi", "synchronous"), [(2, ()), (3, ()), (2, ("unbalance",))])
def test_an_estimator_of_several_axes_has_python_s_bits(fmi, synchronous, tmp_path):
    _, run = flown(duration=300 * T, feedback="measurement")
    kf = KalmanFilter(MACHINE, synchronous=synchronous)
    path = fmu.export_fmu(MACHINE, kf, tmp_path / "filter.fmu", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    found = simulated(path, run, READINGS + [f"u_{name}" for name in AXES])
    estimate = kf.run(run.record, covariance=True)
    for name in estimate.names:
        np.testing.assert_array_equal(found[name][1:], estimate[name], name)
        std = found[f"std_{name}"][1:]  # by the core's own root
        np.testing.assert_allclose(std, estimate.std(name), rtol=1e-15, err_msg=name)
    for k, reading in enumerate(MACHINE.readings):
        of_reading = found[f"innovation_{reading.name}"][1:]
        np.testing.assert_array_equal(of_reading, estimate.innovation[:, k])
    np.testing.assert_array_equal(found["status"][1:], estimate.status)


@pytest.mark.parametrize(
    "options",
    [
        {"duration": 300 * T, "feedback": "estimate"},
        {"duration": 1200 * T, "feedback": "measurement", "start": "landed", "sequence": QUICK},
    ],
    ids=["in flight", "from rest to rest"],
)
def test_a_whole_controller_of_several_axes_has_python_s_bits(options, tmp_path):
    scenario, run = flown(**options)
    path = export_fmu(
        MACHINE, None, tmp_path / "flown.fmu", kind="whole-controller", scenario=scenario
    ).path
    assert validate_fmu(str(path)) == []
    more = {"speed": np.full(len(run.record.t), MACHINE.speed)}
    if scenario.sequence is not None:
        more["fly"] = scenario.sequence.fly(run.record.t)
    found = simulated(path, run, READINGS + [f"r_{name}" for name in AXES], **more)
    for name in AXES:
        np.testing.assert_array_equal(found[f"u_{name}"][1:], run.record[f"u_{name}"], name)
    for name in run.estimate.names:
        np.testing.assert_array_equal(found[f"estimate.{name}"][1:], run.estimate[name], name)
    np.testing.assert_array_equal(found["status"][1:], run.status)
    if scenario.sequence is not None:
        np.testing.assert_array_equal(found["mode"][1:], run.record["mode"])
        assert set(run.record["mode"]) == {0, 1, 2, 3, 4}


def test_the_bytes_of_a_state_go_on_in_another_process(tmp_path):
    _, run = flown(duration=40 * T)
    path = export_fmu(MACHINE, None, tmp_path / "filter.fmu", fmi=2).path
    folder, names = unpacked(path, tmp_path / "unpacked"), tuple(f"f_d_{name}" for name in AXES)
    inputs = {name: run.record[name] for name in [*READINGS, *(f"u_{name}" for name in AXES)]}
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


def noises(of, scenario, n):
    noise_u, noise_y = drawn(of, scenario, n)
    of_axes = {f"noise_u_{at.name}": noise_u[:, k] for k, at in enumerate(of.axes)}
    return of_axes | {f"noise_y_{at.name}": noise_y[:, k] for k, at in enumerate(of.readings)}


def check_plant(found, run, y_from=0):
    """What the rotor does, what sensors show and how magnets pull, to the last bit."""
    n, machine = len(run.record.t), run.machine
    moving = [name for name in run.record.signals if name.startswith(("q_", "x_m_", "s_"))]
    assert len(moving) > 3 * len(machine.axes)
    for name in moving:
        at = 4e-16 * machine.bearings[0].clearance if name.startswith("s_") else 0.0
        np.testing.assert_allclose(found[name][:n], run.record[name], rtol=0, atol=at, err_msg=name)
    for reading in machine.readings:
        name = f"y_{reading.name}"
        np.testing.assert_array_equal(found[name][y_from:][:n], run.record[name], name)
    assert np.ptp(run.record[f"s_{machine.axes[0].name}"]) > 1e-7


@pytest.mark.parametrize("case", quick(PLANTS, ["ufu_rig", "five"]))
def test_the_plant_of_several_axes_is_that_of_simulate(case, tmp_path):
    machine = PLANTS[case]
    scenario = Scenario(
        duration=200 * machine.sampling_time, noise=False, **loaded(machine)
    )  # fmt: skip
    run = simulate_run(machine, scenario, estimator=KalmanFilter(machine))
    n = len(run.record.t)
    path = export_fmu(machine, None, tmp_path / "plant.fmu", kind="plant", scenario=scenario).path
    assert validate_fmu(str(path)) == []
    names = [f"{what}_{at.name}" for what in ("u", "f_d") for at in machine.axes]
    inputs = {"speed": np.full(n, machine.speed)}
    found = simulated(path, run, names, **inputs)
    check_plant(found, run)
    first = machine.axes[0]
    weaker = {f"magnet_constant_{first.name}": 0.5 * first.bearing.magnet.magnet_constant}
    half = simulated(path, run, names, start_values=weaker, **inputs)[f"f_mag_{first.name}"][1]
    np.testing.assert_allclose(half, 0.5 * found[f"f_mag_{first.name}"][1], rtol=1e-3)


@pytest.mark.parametrize(("case", "fmi"), quick(
    [(case, 2 + k % 2) for k, case in enumerate(LOOPS)], [("five", 2), ("lifts", 3)]
))  # fmt: skip
def test_the_closed_loop_of_several_axes_is_what_simulate_flies(case, fmi, tmp_path):
    machine, options = LOOPS[case]
    scenario = Scenario(seed=3, **loaded(machine) | options)
    run = simulate_run(machine, scenario, estimator=KalmanFilter(machine))
    n = len(run.record.t)
    path = export_fmu(
        machine, None, tmp_path / "loop.fmu", kind="closed-loop", fmi=fmi, scenario=scenario
    ).path
    assert validate_fmu(str(path)) == []
    names = [f"{what}_{at.name}" for what in ("r", "f_d") for at in machine.axes]
    more = noises(machine, scenario, n) | {"speed": np.full(n, machine.speed)}
    if scenario.sequence is not None:
        more["fly"] = scenario.sequence.fly(run.record.t)
    found = simulated(path, run, names, **more)
    check_plant(found, run, y_from=1)
    for at in machine.axes:
        np.testing.assert_array_equal(found[f"u_{at.name}"][1:], run.record[f"u_{at.name}"])
    for name in run.estimate.names:
        np.testing.assert_array_equal(found[f"estimate.{name}"][1:], run.estimate[name], name)


@pytest.mark.parametrize("feedback", ["estimate", "measurement"])
def test_controllers_of_several_axes_demand_what_simulate_s_do(feedback, tmp_path):
    scenario, run = flown(duration=200 * T, feedback=feedback, **loaded(MACHINE))
    path = export_fmu(
        MACHINE, None, tmp_path / "law.fmu", kind="controller", scenario=scenario
    ).path
    assert validate_fmu(str(path)) == []
    seen = READINGS if feedback == "measurement" else []
    fed = {} if seen else {name: run.estimate[name] for name in run.estimate.names}
    speed = np.full(len(run.record.t), MACHINE.speed)
    found = simulated(path, run, [f"r_{name}" for name in AXES] + seen, **fed, speed=speed)
    for name in AXES:
        np.testing.assert_array_equal(found[f"u_{name}"][1:], run.record[f"u_{name}"], name)
    assert np.ptp(run.record[f"u_{AXES[0]}"]) > 1e-3


def test_a_foundation_shakes_the_plant_of_several_axes(tmp_path):
    shaken = {"type": "sine", "amplitude": 2.0, "frequency": 40.0}
    scenario = Scenario.model_validate(
        {"duration": 200 * T, "base": [{"direction": "x", "acceleration": shaken}], "noise": False}
    )
    run = simulate_run(MACHINE, scenario, estimator=KalmanFilter(MACHINE))
    path = export_fmu(MACHINE, None, tmp_path / "plant.fmu", kind="plant", scenario=scenario).path
    names = [f"u_{name}" for name in AXES] + ["base_x", "speed"]
    check_plant(simulated(path, run, names), run)


def test_the_system_of_several_axes_wires_all_of_them(tmp_path):
    from fmpy.ssp.simulation import simulate_ssp

    path, step = tmp_path / "system.ssp", 0.05 * MACHINE.bearings[0].clearance
    made = export_ssp(MACHINE, None, path, scenario=Scenario(noise=False))
    assert [one.kind for one in made] == ["plant", "controller", "estimator"]
    zero = dict.fromkeys(
        ["base_x", "base_y", *(f"{what}_{name}" for what in ("r", "f_d", "noise_u")
         for name in AXES), *(f"noise_{name}" for name in READINGS)], lambda _t: 0.0,
    )  # fmt: skip
    found = simulate_ssp(
        str(path), stop_time=0.2, step_size=T,
        input=zero | {"speed": lambda _t: MACHINE.speed,
                      "r_A1": lambda t: step if t > 0.02 else 0.0},
    )  # fmt: skip
    reference = [Reference(axis="A1", position=Step(amplitude=step, time=0.02))]
    scenario = Scenario(noise=False, duration=0.2, reference=reference)
    run = simulate_run(MACHINE, scenario, estimator=KalmanFilter(MACHINE))
    for name in AXES:  # each wire of an SSP holds its value back by a sample
        wanted = run.record[f"s_{name}"][-1]
        assert abs(found[f"s_{name}"][-1] - wanted) < 0.05 * step, name
    np.testing.assert_allclose(found["estimate_x"][-1], found["q_x"][-1], atol=0.05 * step)
