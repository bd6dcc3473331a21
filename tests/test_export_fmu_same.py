"""FMUs in FMPy are the library, to the last bit: machines x scenarios x what is exported."""

import shutil
from typing import Any, NamedTuple

import fe_map
import numpy as np
import pytest
from exporting import export_fmu
from iron import TWO_SIDED as IRON
from machine_cases import bearing, machine, sensor
from quick import quick

import ambkit
from ambkit import PID, ClosedLaw, Control, FilterNoise, KalmanFilter, Machine, Scenario, Step
from ambkit.control.control import WITH_CURRENT, LiftOff, Mode
from ambkit.control.controller_states import Controller
from ambkit.data.record import Record
from ambkit.estimate.kalman import AdaptiveKalmanFilter
from ambkit.estimate.registry import KINDS
from ambkit.export import fmu
from ambkit.machine.magnets import magnet_of
from ambkit.machine.stiffness import stiffness_map
from ambkit.simulation.recording import noise_samples
from ambkit.simulation.run import simulate_run
from ambkit.simulation.scenario import (
    Disturbance,
    Reference,
    energised,
    fly_command,
    settled_scenario,
)

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

from fmpy.validation import validate_fmu  # noqa: E402
from fmu_instance import simulated  # noqa: E402

AXIS = Machine.preset("zittau_axial")
ONE_SIDED = Machine.preset("inteco_ml")
RIG = Machine.preset("tum_mlps")
FIVE = machine(
    name="five_axes",
    bearing=[bearing("A", 0.2), bearing("B", -0.3), bearing("T", 0.1, type="thrust")],
    sensor=[
        sensor("A", 0.2, quantisation=0.2e-6), sensor("B", -0.3), sensor("T", 0.1, type="axial"),
    ],
    unbalance=[{"place": 0.1, "amount": 2e-5}],
)  # fmt: skip
# A current that lags, late controls, a bent sensor that rounds, runout and stops that bounce.
PARTS = {
    "amplifier__bandwidth": "1 kHz",
    "amplifier__voltage_limit": "20 V",
    "amplifier__resistance": "2 ohm",
    "sensor__quantisation": "0.5 um",
    "sensor__quadratic": "20 1/m",
    "speed": "6000 rpm",
    "sensor__runout": [{"order": n, "amplitude": "3 um", "phase": "90 deg"} for n in (1, 3)],
    "stop": {"stiffness": "1e8 N/m^1.5", "damping": "0.3 s/m"},
    "rotor__clearance": "0.2 mm",
}
LATE = {"delay": "0.03 ms"}
EDDY = {"magnet__eddy_current_lag": "0.2 ms"}
# All that adds a state.
STATES = {
    "amplifier__bandwidth": "500 Hz",
    "delay": "0.15 ms",
    "sensor__coloured_noise": {"variance": "4 um^2", "bandwidth": "200 Hz"},
    "sensor__hum": [{"frequency": "50 Hz", "amplitude": "10 um", "bandwidth": "0.5 Hz"}],
}
STOPS = PARTS | STATES | {
    "rotor__clearance": "0.1 mm", "sensor__runout": [{"order": 2, "amplitude": "3 um"}],
}  # fmt: skip
SOFT = AXIS.replace(amplifier__bandwidth="1 kHz", delay="0.12 ms")
QUICK = LiftOff(wait=2e-3, lift=0.02, land=0.02, stop=0.06)
LIFTS = {"share": 0.05, "start": "landed", "sequence": QUICK}
EAGER = {"noise": False, "controller": PID(setpoint_weight=1.0, kd=5.0)}  # it comes to the stop
SHAKEN = {"type": "sine", "amplitude": 2.0, "frequency": 40.0}


class Case(NamedTuple):
    machine: Any
    kinds: tuple[tuple[str, int], ...]  # with the version of FMI
    scenario: dict[str, Any] = {}
    filter: str = "linear"


PLANT, LOOP, WHOLE, LAW = "plant", "closed-loop", "whole-controller", "controller"
PLANTS, BOTH = ((PLANT, 2), (LOOP, 3)), ((LOOP, 2), (WHOLE, 3))
CASES = {
    "axis": Case(AXIS, (*((kind, fmi) for kind in (PLANT, LOOP) for fmi in (2, 3)), (LAW, 2))),
    "measured": Case(AXIS, ((LAW, 3),), {"controller": {"feedback": "measurement"}}),
    "one-sided": Case(ONE_SIDED, ((PLANT, 3), (LOOP, 2))),
    "iron": Case(IRON, PLANTS),
    "all parts": Case(AXIS.replace(**PARTS, **LATE), PLANTS, EAGER | {"share": 1.5}),
    "noisy parts": Case(AXIS.replace(**PARTS, **LATE), ((LOOP, 2),)),
    "late": Case(AXIS.replace(delay="0.12 ms"), PLANTS, EAGER),
    "eddy currents": Case(AXIS.replace(**EDDY), ((LOOP, 3),)),
    "lagging eddy currents": Case(
        AXIS.replace(**EDDY, amplifier__bandwidth="1 kHz"), ((PLANT, 3),), EAGER
    ),
    "solid iron": Case(
        AXIS.replace(magnet__eddy_current_corner="1 kHz", amplifier__bandwidth="1 kHz"),
        PLANTS, {"noise": False},
    ),
    "one-sided, late": Case(
        ONE_SIDED.replace(amplifier__bandwidth="1 kHz", delay="0.3 ms"), ((PLANT, 3),), EAGER
    ),
    "more states": Case(IRON.replace(**STATES), ((LOOP, 2),), {"share": 0.05}, "extended"),
    "more states and stops": Case(
        IRON.replace(**STOPS), ((LOOP, 2),), {"share": 0.05}, "extended"
    ),
    "force map": Case(
        lambda folder: Machine.load(fe_map.written(folder)), ((LOOP, 3),), {}, "extended"
    ),
    "lqg": Case(AXIS, ((LOOP, 2), (WHOLE, 2), (LAW, 2)), {"controller": Control(type="lqg")}),
    "feed forward": Case(
        AXIS, ((LOOP, 3), (WHOLE, 3), (LAW, 3)), {"controller": PID(feed_forward=0.8)}, "extended"
    ),
    "lqg that lifts": Case(
        AXIS, ((LOOP, 2), (WHOLE, 2), (LOOP, 3), (WHOLE, 3)),
        LIFTS | {"controller": Control(type="lqg")},
    ),
    "lqg of an amplifier's states": Case(
        SOFT, (*BOTH, (LAW, 3)), {"controller": Control(type="lqg")}, "extended"
    ),
    "one-sided that lifts": Case(
        ONE_SIDED, ((LOOP, 2), (WHOLE, 2)),
        LIFTS | {"sequence": QUICK.model_copy(update={"stop": 0.3})},
    ),
    "sensor's PID that lifts": Case(
        IRON, ((LOOP, 3), (WHOLE, 3)), LIFTS | {"controller": Control(feedback="measurement")}
    ),
    "feed forward in flight that lands": Case(
        SOFT, BOTH, {"sequence": QUICK, "controller": PID(feed_forward=1.0)}
    ),
    "power failure": Case(
        AXIS, ((WHOLE, 2), (WHOLE, 3)),
        {"sequence": LiftOff(wait=1e-3, lift=5e-3), "off": 0.01, "on": 0.012}, "contact",
    ),
    "from rest": Case(
        AXIS, ((LOOP, 3), (WHOLE, 2)), {"start": "released", "controller": Control(type="lqg")}
    ),
    "rig": Case(RIG, ((PLANT, 2), (WHOLE, 3), (LAW, 2)), {"controller": {"feedback": "estimate"}}),
    "rig, measured": Case(RIG, ((LOOP, 2), (LAW, 3)), {"controller": {"feedback": "measurement"}}),
    "rig that lifts": Case(RIG, BOTH, LIFTS | {"controller": {"feedback": "measurement"}}),
    "shaken rig": Case(
        RIG, ((PLANT, 3),),
        {"base": [{"direction": "x", "acceleration": SHAKEN}], "noise": False},
    ),
    "rig with lags": Case(Machine.preset("ufu_rig"), ((PLANT, 3),), {"noise": False}),
    "five axes": Case(FIVE, PLANTS, {"noise": False}),
    "five noisy axes": Case(FIVE, ((LOOP, 2),)),
    "compressor": Case(Machine.preset("compressor"), ((LOOP, 3),)),
}  # fmt: skip


def scenario_of(machine, share=0.3, **options):
    """A step of the first reference, by a share of the clearance, and one of the last load."""
    T, levitated = machine.sampling_time, options.get("start", "levitated") == "levitated"
    axes = machine.axes
    one, last = axes[0].bearing, axes[-1] if len(axes) > 1 else None
    reference = Step(amplitude=share * one.clearance, time=20 * T)
    load = Step(amplitude=0.5 if last else 0.3 * machine.weight, time=60 * T)
    steps = {
        "reference": [Reference(axis=axes[0].name, position=reference)] if last else reference,
        "disturbance": [Disturbance(axis=last.name, force=load)] if last else load,
    }
    duration = (300 if levitated else 1200) * T
    return Scenario.model_validate({"duration": duration, "seed": 3} | steps | options)


def inputs_of(path, kind, scenario, run):
    """Signals of a run for the inputs of an FMU; faults are left at what they begin with."""
    machine, record, n = run.machine, run.record, len(run.record.t)
    known = {name: record[name] for name in record.signals}
    if kind in (PLANT, LOOP):
        for what, of, noise in zip(
            ("noise_u", "noise_y"), (machine.axes, machine.readings),
            noise_samples(machine, scenario, n), strict=True,
        ):  # fmt: skip
            for k, at in enumerate(of):
                ours = noise[:, k] if kind == LOOP or what == "noise_u" else np.zeros(n)
                known[what if "y" in record.signals else f"{what}_{at.name}"] = ours
    if kind == LAW:
        known |= {name: run.estimate[name] for name in run.estimate.names}
        if "y" in record.signals and scenario.controller.feedback == "measurement":
            known["x"] = record["y"]
    if scenario.sequence is not None:
        on = energised(scenario.off, scenario.on, record.t, machine.sampling_time)
        known |= {"power_failure": 1 - on, "fly": fly_command(scenario.sequence, record.t, on)}
    if "y" not in record.signals:
        known["speed"] = np.full(n, machine.speed)
    described = fmpy.read_model_description(str(path)).modelVariables
    wanted = [variable.name for variable in described if variable.causality == "input"]
    assert all(
        name in known
        for name in wanted
        if not name.startswith(("fault", "base_", "on", "power_failure"))
    )
    return {name: known[name] for name in wanted if name in known}


def outputs_of(kind, scenario, run, names):
    """What a run has under the names of an FMU's outputs, and from which row on it is there."""
    record, machine = run.record, run.machine
    lags = any(at.bearing.amplifier.bandwidth is not None for at in machine.axes)
    late = getattr(machine, "delay", None)
    for name in names:
        if name.startswith("estimate."):
            values = estimated(run.estimate, name.removeprefix("estimate."), machine)
            if values is not None:
                yield name, values, 1
        elif name == "status":
            yield name, run.status, 1
        elif name == "on" and "mode" in record.signals:  # as commanded, whether or not supplied
            yield name, np.isin(record["mode"], WITH_CURRENT), 1
        elif name not in record.signals or name.startswith("f_mag"):
            continue
        elif name.startswith(("x", "v", "q_", "s_")):
            yield name, record[name], 0
        elif name.startswith("y") and kind == PLANT:
            if not scenario.noise:
                yield name, record[name], 0
        elif not name.startswith("iu"):
            yield name, record[name], 1
        elif kind != WHOLE and (lags or not late or kind == LOOP):  # there it is what is demanded
            yield name, record[name], 0 if lags and kind == PLANT else 1


def estimated(estimate, name, machine):
    """An estimate's series under the name that an FMU has for it; None: a deviation."""
    if name in estimate.names:
        return estimate[name]
    for what in ("k_i", "k_s", "innovation", "variance", "status"):
        if name == what or name.startswith(f"{what}_"):
            values = estimate.status if what == "status" else estimate[OF_CORE.get(what, what)]
            if values.ndim == 1:
                return values
            of = machine.axes if what in ("k_i", "k_s") else machine.readings
            return values[:, [at.name for at in of].index(name.removeprefix(f"{what}_"))]
    return None


OF_CORE = {"variance": "innovation_variance"}


def compare(path, kind, scenario, run, start=None, within=0.0):
    """Hold an FMU in FMPy to a run; return what FMPy has."""
    assert validate_fmu(str(path)) == []
    inputs = inputs_of(path, kind, scenario, run)
    found, compared = simulated(path, run.machine.sampling_time, start, **inputs), []
    for name, values, row in outputs_of(kind, scenario, run, found.dtype.names[1:]):
        at = 4e-16 * run.machine.bearings[0].clearance if name.startswith("s_") else within
        shown = found[name][row:][: len(values)]
        np.testing.assert_allclose(shown, values, rtol=0, atol=at, err_msg=name)
        compared.append(name)
    left = {name.partition("_")[0] for name in {*found.dtype.names[1:]} - {*compared}}
    assert left <= {"f", "iu", "y", "coil", "on", "estimate.std"}
    return found


EVERY = [(name, *kind) for name, case in CASES.items() for kind in case.kinds]
IN_TURN = [
    *((name, *case.kinds[k % len(case.kinds)]) for k, (name, case) in enumerate(CASES.items())),
    ("rig that lifts", LOOP, 2), ("lqg that lifts", WHOLE, 2), ("axis", LAW, 2),
]  # fmt: skip
"""One kind of each case, and each kind."""


@pytest.mark.parametrize(("name", "kind", "fmi"), quick(EVERY, IN_TURN))
def test_all_kinds_do_what_simulate_does(name, kind, fmi, tmp_path):
    case = CASES[name]
    machine = case.machine(tmp_path) if callable(case.machine) else case.machine
    scenario = settled_scenario(machine, scenario_of(machine, **case.scenario))
    precision = "float" if kind == WHOLE and fmi == 2 else "double"
    numbers = {"float": "float32", "double": "float64"}[precision]
    estimator = KINDS[case.filter].make(machine, precision=numbers)
    run = simulate_run(machine, scenario, estimator=estimator)
    path = export_fmu(
        machine, None, tmp_path / "made.fmu", kind=kind, fmi=fmi, precision=precision,
        scenario=scenario, **({} if kind in (PLANT, LAW) else {"filter": case.filter}),
    ).path  # fmt: skip
    found, record = compare(path, kind, scenario, run), run.record
    single = "x" in record.signals
    moved = record["x"] if single else record[f"s_{run.machine.axes[0].name}"]
    assert np.ptp(moved) > (1e-6 if single else 1e-7)
    if case.scenario.get("start") == "landed":
        modes = {Mode(int(mode)) for mode in record["mode"]}
        assert modes >= {Mode.WAITING, Mode.LIFTING, Mode.FLYING, Mode.LANDING, Mode.OFF}
    if single and kind in (PLANT, LOOP) and not case.scenario.get("noise", True):
        assert (record.meta["stop_touched"] > 0) == (machine.stop is not None)
    if single and kind == PLANT and machine.amplifier.bandwidth is None and not machine.delay:
        force = magnet_of(machine).force(found["iu"], found["x"])
        np.testing.assert_array_equal(found["f_mag"], force)
    if single and kind == WHOLE and scenario.start == "landed":
        inputs = inputs_of(path, kind, scenario, run)
        law = Controller.of_axis(machine, estimator, scenario.controller, scenario.sequence)
        inputs["energised"] = 1 - inputs.pop("power_failure")
        told = law.run(**inputs)
        coils = {f"coil_{k}": told["coil"][:, k] for k in range(told["coil"].shape[1])}
        for output, values in {"iu": told["iu"], "on": told["on"], **coils}.items():
            np.testing.assert_array_equal(found[output][1:], values, output)
        assert set(found["on"]) == {0.0, 1.0}


def test_parameters_of_a_plant_are_the_library_s(tmp_path):
    other = ONE_SIDED.replace(rotor__mass=0.07, magnet__magnet_constant=1.1e-4)
    scenario = settled_scenario(other, scenario_of(other))
    path = export_fmu(ONE_SIDED, None, tmp_path / "plant.fmu", kind=PLANT).path
    start = {"mass": 0.07, "magnet_constant": 1.1e-4}
    # The weight is found by a ratio, which rounds once more.
    compare(path, PLANT, scenario, simulate_run(other, scenario), start, within=1e-9)


# ---- Estimators ----


def spoilt(machine):
    """A closed-loop record with measurements far away, a frozen sensor and a saturated demand."""
    record = simulate_run(machine, scenario_of(machine).fed("measurement")).record
    reading, control = (next(name for name in record.signals if name[0] == of) for of in "yu")
    signals = {name: record[name].copy() for name in record.signals if name[0] in "yu"}
    signals[reading][100:103] = 1e3
    signals[reading][120:140] = signals[reading][120]
    signals[control][200] = 100 * np.abs(signals[control]).max()
    return Record(record.t, signals, {name: record.units[name] for name in signals})


def kind(name, **options):
    return lambda machine: KINDS[name].make(machine, **options)


def adaptive(magnet):
    return lambda machine: AdaptiveKalmanFilter(machine, magnet(machine))


WITH_STATES = IRON.replace(**STATES)
optimised = pytest.mark.optimised
ESTIMATORS = {
    **{f"axis, FMI {fmi}": (AXIS, kind("linear"), fmi) for fmi in (2, 3)},
    **{f"one-sided, FMI {fmi}": (ONE_SIDED, kind("linear"), fmi) for fmi in (2, 3)},
    # One of each state, and of each structure that only a kind has.
    **{
        name: (AXIS, kind(name), 3)
        for name in (
            "low-pass", "observer", "extended", "ud", "unscented", "augmented", "multiple-model",
            "contact",
        )
    },
    # The paper's own step, a kind with more than the model, one gain, and none.
    **{
        f"{name} of more states": (WITH_STATES, kind(name), 3)
        for name in ("linear", "augmented", "observer", "low-pass")
    },
    "float": (AXIS, kind("linear", precision="float32"), 3),
    "of the law": (AXIS, adaptive(ClosedLaw), 3),
    "of a map": (AXIS, adaptive(stiffness_map), 3),
    "of an expert": (AXIS, adaptive(lambda machine: ambkit.train(machine).expert), 3),
    "rig": (RIG, KalmanFilter, 3),
    "rig, with unbalance": (RIG, kind("linear", synchronous=("unbalance",)), 2),
}  # fmt: skip


def check_estimate(found, estimate, machine, names, precision="float64"):
    for name in names:
        if name.startswith("std_"):  # by the core's own root
            rtol = 1e-15 if precision == "float64" else 1e-6
            expected = estimate.std(name.removeprefix("std_"))
            np.testing.assert_allclose(found[name][1:], expected, rtol=rtol, err_msg=name)
        else:
            expected = estimated(estimate, name, machine)
            np.testing.assert_array_equal(found[name][1:], expected, name)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=optimised) if name.startswith("of ") else name for name in ESTIMATORS
])  # fmt: skip
def test_an_estimator_alone_has_the_library_s_bits(name, tmp_path):
    machine, make, fmi = ESTIMATORS[name]
    record, kf = spoilt(machine), make(machine)
    if name == "contact":
        on = np.where((record.t > 0.005) & (record.t < 0.008), 0.0, 1.0)
        record = Record(record.t, record.signals | {"on": on}, record.units | {"on": "1"})
    constant = isinstance(kf, ambkit.LowPass | ambkit.ExtendedStateObserver)
    estimate = kf.run(record, covariance=not constant)
    path = fmu.export_fmu(machine, kf, tmp_path / "made.fmu", fmi=fmi).path
    assert validate_fmu(str(path)) == []
    inputs = dict(record.signals)
    if "on" in inputs:
        inputs["power_failure"] = 1 - inputs.pop("on")
    found = simulated(path, machine.sampling_time, **inputs)
    names = [at for at in found.dtype.names[1:] if not (constant and at.startswith("std_"))]
    check_estimate(found, estimate, machine, names, kf.precision)
    assert {*estimate.names, "status"} <= {*names}
    if machine is not RIG and type(kf) is KalmanFilter:
        assert len(set(estimate.status)) >= 4  # the record has what it is said to have


@pytest.mark.parametrize("fmi", [2, 3])
def test_parameters_of_the_filter_are_the_library_s(fmi, tmp_path):
    record = spoilt(AXIS)
    path = export_fmu(AXIS, None, tmp_path / "made.fmu", fmi=fmi).path
    start = {"control_variance": 3e-4, "disturbance_growth": 7.0}
    found = simulated(path, AXIS.sampling_time, start, y=record["y"], u=record["u"])
    tuned = KalmanFilter(AXIS, noise=FilterNoise(control=3e-4, disturbance=7.0)).run(record)
    check_estimate(found, tuned, AXIS, [*tuned.names, "innovation", "variance", "status"])
    assert np.any(tuned.f_d != KalmanFilter(AXIS).run(record).f_d)
