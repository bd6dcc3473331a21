"""A record beside the bearing that it is said to be of: rate, range, noise, signs."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit.arguments import check_plausibility
from ambkit.base.errors import RecordError
from ambkit.data import recordings
from ambkit.data.record import Record
from ambkit.judge.plausibility import evaluate_record
from ambkit.judge.signs import sign_test
from ambkit.workflow.check import inspect

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "closed_loop"
BEARING = ambkit.preset("zittau_axial")
SCENARIOS = {
    "rest": {},
    "step": {"reference": ambkit.Step(amplitude=0.3e-3, time=0.05)},
    "slow": {"reference": ambkit.Sine(amplitude=0.3e-3, frequency=5.0)},
    "fast": {"reference": ambkit.Sine(amplitude=0.1e-3, frequency=50.0)},
    "load": {"disturbance": ambkit.Step(amplitude=3.0, time=0.25)},
}


def run(name="slow", seed=0):
    pid = ambkit.PID.textbook(BEARING)
    return ambkit.simulate(
        BEARING, ambkit.Scenario(seed=seed, controller=pid, **SCENARIOS[name])
    ).record


def changed(record, **factors):
    signals = {name: factors.get(name, 1.0) * record[name] for name in ("y", "u")}
    return Record(record.t, signals)


@pytest.mark.parametrize("seed", quick(range(2), [0]))
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_record_belongs_to_its_bearing_and_not_with_a_sign_reversed(name, seed):
    record = run(name, seed)
    assert evaluate_record(record, BEARING) == ((), ())
    for wrong in (changed(record, y=-1.0), changed(record, u=-1.0)):
        (problem,) = evaluate_record(wrong, BEARING).problems
        assert "the sign of y or of u is wrong" in problem
    assert evaluate_record(changed(record, y=-1.0, u=-1.0), BEARING).problems == ()


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_control_signal_that_is_logged_at_another_instant_is_reported(name):
    record = run(name)
    for samples, told in ((-20, "2.1 ms later"), (20, "2.1 ms earlier")):
        u = record["u"][np.clip(np.arange(len(record)) - samples, 0, len(record) - 1)]
        shifted = Record(record.t, {"y": record["y"], "u": u})
        (remark,) = evaluate_record(shifted, BEARING).remarks
        assert f"with u about {told} the model predicts the record better" in remark


PRESETS = {
    name: ambkit.preset(name)
    for name in ("zittau_axial", "inteco_ml", "tum_mlps", "ufu_rig", "heart_pump", "compressor")
}


@pytest.mark.parametrize("steps", [0, 30], ids="{} deviations".format)
@pytest.mark.parametrize("preset", PRESETS)
def test_a_sign_is_known_of_quiet_records_of_coarse_sensors_and_of_a_rig_that_is_not_the_model(
    preset, steps
):
    plant = PRESETS[preset]
    axis = plant if plant.single else plant.isolated_axis(plant.axes[0].name)
    if steps:
        std = axis.sensor.noise_variance**0.5
        axis = axis.replace(sensor__quantisation=steps * std)
    rig = axis.replace(rotor__mass=1.2 * axis.rotor.mass,
                       magnet__air_gap=1.08 * axis.magnet.air_gap)  # fmt: skip
    c = axis.clearance
    kinds = {
        "rest": {}, "step": {"reference": ambkit.Step(amplitude=0.3 * c, time=0.05)},
        "load": {"disturbance": ambkit.Step(amplitude=3 * axis.rotor.mass, time=0.1)},
    }  # fmt: skip
    for of in (axis, rig):
        for name, what in kinds.items():
            duration = min(2.0, 10000 * axis.sampling_time)
            record = ambkit.simulate(of, ambkit.Scenario(duration=duration, seed=3, **what)).record
            record = Record(record.t, {"y": record["y"], "u": record["u"]})
            found = sign_test(record, axis)
            assert found.decisive, (name, found)
            assert not found.wrong, (name, found)
            assert sign_test(changed(record, u=-1.0), axis).wrong, name


@pytest.mark.parametrize(
    "preset", quick(["tum_mlps", "ufu_flexible", "compressor"], ["tum_mlps", "ufu_flexible"])
)
def test_a_channel_of_several_that_is_reversed_is_named(preset):
    machine = ambkit.preset(preset)
    record = ambkit.simulate(
        machine, duration=min(0.4, 4000 * machine.sampling_time), seed=3
    ).record
    assert evaluate_record(record, machine).problems == ()
    for name in (f"y_{machine.readings[-1].name}", f"u_{machine.axes[1].name}"):
        wrong = replace(record, signals={**record.signals, name: -record[name]})
        (problem,) = evaluate_record(wrong, machine).problems
        assert problem.startswith(f"the sign of {name}, or of what belongs to its axis, is wrong")


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_mirrored_record_pulls_with_gravity(name):
    upright = BEARING.replace(rotor__gravity="-x")
    record = ambkit.simulate(upright, ambkit.Scenario(seed=1, **SCENARIOS[name])).record
    assert evaluate_record(record, upright) == ((), ())
    mirrored = changed(record, y=-1.0, u=-1.0)
    problems, (remark,) = evaluate_record(mirrored, upright)
    assert problems == ()
    assert "the magnet pulls with gravity" in remark
    assert "signs of y and of u both swapped" in remark
    assert evaluate_record(changed(record, u=-1.0), upright).remarks == ()  # told as a problem
    (_, found) = evaluate_record(mirrored, upright.replace(rotor__gravity="none"))
    assert found == ()


@pytest.mark.skipif(not RIG.is_dir(), reason="the rig's logs are not here (../shared/data/inteco)")
def test_the_signs_of_the_rig_are_reported():
    bearing = ambkit.preset("inteco_ml")
    for log in sorted(RIG.glob("*.mat")):
        record = ambkit.load(log, recordings.folder() / "closed_loop.toml")
        assert evaluate_record(record, bearing).problems == (), log.name
        (problem,) = evaluate_record(changed(record, y=-1.0), bearing).problems
        assert "the sign of y or of u is wrong" in problem


def test_a_record_that_does_not_tell_its_signs_is_called_so():
    rng = np.random.default_rng(0)
    t = 1e-4 * np.arange(5000)
    record = Record(t, {"y": 1e-5 * rng.normal(size=5000), "u": 0.1 * rng.normal(size=5000)})
    problems, remarks = evaluate_record(record, BEARING)
    assert problems == ()
    assert any("does not determine the signs of y and u" in remark for remark in remarks)
    still = Record(t, {"y": np.zeros(5000), "u": np.zeros(5000)})
    assert sign_test(still, BEARING) is None
    gone = Record(t, {"y": np.full(5000, np.nan), "u": np.zeros(5000)})
    assert evaluate_record(gone, BEARING).problems == ()


def planted():
    """Records of the bearing that no work may begin with unsaid, and what is to be named."""
    good, rng = run("slow"), np.random.default_rng(0)
    t, y, u = good.t, good["y"], good["u"]
    hiss = rng.normal(size=y.size)

    def clipped(values):
        middle, most = values.mean(), np.quantile(np.abs(values - values.mean()), 0.6)
        return np.clip(values, middle - most, middle + most)

    return {
        "u turned": (t, y, -u, "sign"), "y turned": (t, -y, u, "sign"),
        "both turned": (t, -y, -u, "pulls with gravity"),
        "y in micrometres": (t, 1e3 * y, u, "air gap"), "u in mV": (t, y, 1e3 * u, "asks for"),
        "y in km": (t, 1e-3 * y, u, "unit"), "u in kV": (t, y, 1e-3 * u, "unit"),
        "y constant": (t, 0 * y + 1e-5, u, "stands still"),
        "u constant": (t, y, 0 * u + 0.1, "stands still"),
        "nothing moves": (t, 0 * y + 1e-5, 0 * u + 0.1, "stands still"),
        "y clipped": (t, clipped(y), u, "y stands still"),
        "u clipped": (t, y, clipped(u), "u stands still"),
        "y stuck": (t, np.where(t > 0.9 * t[-1], y[-y.size // 10], y), u, "y stands still"),
        "noise alone": (t, 1e-5 * hiss, 0.1 * rng.normal(size=y.size), "does not determine"),
        "noise a thousandfold": (t, y + 30 * 9e-6 * hiss, u, "noise of y"),
        "on its stop": (t, -1e-3 + 9e-6 * hiss, u, "rests at"),
    }  # fmt: skip


@pytest.mark.parametrize("name", planted())
def test_no_record_that_is_planted_wrong_passes_without_a_sentence(name):
    t, y, u, word = planted()[name]
    try:
        found = check_plausibility(Record(t, {"y": y, "u": u}), BEARING)
    except RecordError as error:
        found = error.problems
    assert any(word in text for text in found), found


@pytest.mark.parametrize("steps", quick([0, 1, 5, 20], [0, 5]))
@pytest.mark.parametrize("name", SCENARIOS)
def test_no_good_record_is_accused(name, steps):
    std = BEARING.sensor.noise_variance**0.5
    rig = BEARING.replace(sensor__quantisation=steps * std) if steps else BEARING
    pid = ambkit.PID.textbook(rig)
    record = ambkit.simulate(rig, ambkit.Scenario(controller=pid, **SCENARIOS[name])).record
    record = Record(record.t, {"y": record["y"], "u": record["u"]})
    assert check_plausibility(record, rig) == []


@pytest.mark.parametrize(
    ("factors", "problem", "remark"),
    [
        ({"y": 1e3}, r"y reaches .* m, beyond the air gap of 2 mm: is a unit", "noise of y"),
        ({"y": 1e-4}, None, "less than a thousandth of clearance"),
        ({"y": 4.0}, None, r"beyond clearance, 1 mm, in .* % of the samples"),
        ({"u": 1e3}, r"u asks for .* A, the control current goes from -1.5 A to 1.5 A", None),
        ({"y": 10.0}, "air gap", "the noise of y is about .* rms, the bearing's sensor has 9.1 µm"),
    ],
)
def test_wrong_units_are_reported(factors, problem, remark):
    verdict = evaluate_record(changed(run(), **factors), BEARING)
    for expected, found in ((problem, verdict.problems), (remark, verdict.remarks)):
        if expected is not None:
            assert any(re.search(expected, each) for each in found), found


@pytest.mark.parametrize(("each", "wrong"), [(20, True), (200, False)])
def test_a_wild_sample_is_a_spike_and_five_in_a_hundred_are_a_wrong_map(each, wrong):
    record = run()
    y = record["y"].copy()
    y[::each] = 1.5 * BEARING.magnet.air_gap * BEARING.sensor.gain
    problems = evaluate_record(Record(record.t, {"y": y, "u": record["u"]}), BEARING).problems
    assert any("air gap" in text for text in problems) == wrong


def test_a_wrong_rate_is_a_problem_of_the_file(tmp_path):
    record = run()
    Record(10 * record.t, {"y": record["y"], "u": record["u"]}).save(tmp_path / "r.csv")
    found = inspect(tmp_path / "r.csv", machine=BEARING)
    assert found.problems == (
        f"{tmp_path / 'r.csv'}: it is sampled every 1 ms, the machine's sampling_time is 0.1 ms",
    )
    assert inspect(tmp_path / "r.csv").ok


def test_check_tells_the_faults_of_a_record_without_a_bearing_too(tmp_path):
    record = run()
    y = record["y"].copy()
    y[1000:1200] = y[1000]
    Record(record.t, {"y": y, "u": record["u"]}).save(tmp_path / "r.csv")
    found = inspect(tmp_path / "r.csv")
    assert found.ok
    (remark,) = found.remarks
    assert remark.startswith("y: 200 samples from 0.1 s to 0.1199 s: stands still at")


SOFT = """
name = "soft"
sampling_time = "0.1 ms"
delay = "0.25 ms"
rotor = {mass = "8.5 kg", gravity = "-x", clearance = "0.2 mm"}
amplifier = {gain = "0.6 A/V", current_limit = "2 A", noise_variance = "2e-5 V^2"}
sensor = {gain = 1, lag = "0.08 ms", noise_variance = "0.16 µm^2", quantisation = "1.5 µm"}
stop = {stiffness = "3e9 N/m^1.5", damping = "0.2 s/m"}
[magnet]
type = "two-sided"
turns = 150
pole_area = "900 mm^2"
air_gap = "0.5 mm"
bias_current = "2 A"
"""


def test_contact_with_a_soft_stop_is_no_delay_and_coarse_steps_are_no_smoothing(tmp_path):
    """The stop yields by a third of the clearance here, and steps of the sensor hide its noise."""
    (tmp_path / "soft.toml").write_text(SOFT, encoding="utf-8")
    machine = ambkit.load(tmp_path / "soft.toml")
    pushed = ambkit.Sequence(times=(0.0, 0.1, 0.3), values=(0.0, 420.0, 0.0))
    for scenario in (
        ambkit.Scenario(duration=0.5, seed=11, disturbance=pushed),
        ambkit.Scenario(duration=0.6, seed=6, off=0.15, on=0.3),
    ):
        remarks = evaluate_record(ambkit.simulate(machine, scenario).record, machine).remarks
        assert any("beyond clearance" in text for text in remarks)
        assert not [text for text in remarks if "delay" in text or "smoothed" in text]
