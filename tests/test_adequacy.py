"""Filters that must not fly are named, and no other: planted wrong, and good ones."""

import re
from pathlib import Path

import numpy as np
import pytest
from exporting import export_c
from machine_cases import PRESETS
from quick import quick

import ambkit
from ambkit import FilterNoise, KalmanFilter, Machine
from ambkit.base.errors import AmbkitError
from ambkit.control.control import Control
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.registry import KINDS, learned_magnet
from ambkit.judge import adequacy_criteria
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.load_following import least_process_noise
from ambkit.machine.axes import load_capacity
from ambkit.machine.magnets import ConstantStiffness, magnet_of
from ambkit.simulation.scenario import Scenario
from ambkit.simulation.waveforms import Step
from ambkit.workflow import design_candidates, identified

AXIS, BALL = Machine.preset("zittau_axial"), Machine.preset("inteco_ml")
MLPS = Machine.preset("tum_mlps")
USUAL = KalmanFilter(AXIS).variances


def noisy(**factors):
    """The linear filter with some of its variances off by factors."""
    return KalmanFilter(
        AXIS, noise=FilterNoise(**{n: f * getattr(USUAL, n) for n, f in factors.items()})
    )


def other(**changes):
    """The filter of an axis with other numbers."""
    return KalmanFilter(AXIS.replace(**changes))


K = ConstantStiffness.of(AXIS)

# Each filter with what it is to fly on, and a word that its sentence has; True: it must not fly.
WRONG = {
    "of another bearing": (lambda: KalmanFilter(BALL), AXIS, "fingerprint", True),
    "of a machine with other axes": (
        lambda: KalmanFilter(Machine.preset("compressor")), MLPS, "fingerprint", True),
    "process noise 1e-4": (lambda: noisy(disturbance=1e-4), None, "noise.disturbance", True),
    "process noise 1e-8": (lambda: noisy(disturbance=1e-8), None, "is followed to 63 %", True),
    "process noise 1e4": (lambda: noisy(disturbance=1e4), None, "noise.disturbance", True),
    "no process noise": (lambda: noisy(disturbance=0.0), None, "is followed to 63 %", True),
    "measurement noise 1e-4": (lambda: noisy(measurement=1e-4), None, "noise.measurement", True),
    "measurement noise 1e4": (lambda: noisy(measurement=1e4), None, "noise.measurement", True),
    "control noise 1e4": (lambda: noisy(control=1e4), None, "noise.control", False),
    "control noise 1e-4": (lambda: noisy(control=1e-4), None, "noise.control", False),
    "gate of a hundredth": (lambda: KalmanFilter(AXIS, gate=0.01), None, "gate of 0.01", True),
    "gate of two": (lambda: KalmanFilter(AXIS, gate=2.0), None, "rejects 0.0455", False),
    "eq. 19 as printed": (
        lambda: KalmanFilter(AXIS, as_printed=True), None, "lead the rotor by", False),
    "process noise of a machine 1e-4": (
        lambda: KalmanFilter(MLPS, noise=FilterNoise(disturbance=0.05)), None,
        "is followed to 63 %", True),
    "process noise of a machine 1e4": (
        lambda: KalmanFilter(MLPS, noise=FilterNoise(disturbance=5.8e6)), None,
        "noise.disturbance", False),
    "wrong sign of the current": (
        lambda: KalmanFilter(AXIS, ConstantStiffness(-K.k_i, K.k_s)), None, "k_i", True),
    "wrong sign of the stiffness": (
        lambda: KalmanFilter(AXIS, ConstantStiffness(K.k_i, -K.k_s)), None, "k_s", True),
    "magnet of another bearing": (
        lambda: ExtendedKalmanFilter(AXIS, magnet_of(BALL)), None, "k_s", True),
    "another sampling time": (lambda: other(sampling_time="1 ms"), AXIS, "sampling_time", True),
    "sampled every 0.1 s": (lambda: other(sampling_time="0.1 s"), None, "sampling time", True),
    "mass of 0.5 g": (lambda: other(rotor__mass="0.5 g"), None, "rotor.mass", True),
    "mass of 0.5 g for another": (lambda: other(rotor__mass="0.5 g"), AXIS, "rotor.mass", True),
    "no gravity": (lambda: other(rotor__gravity="none"), AXIS, "weight", True),
    "weight as a disturbance": (
        lambda: KalmanFilter(AXIS, gravity="disturbance"), None, "weight", False),
    "another air gap": (
        lambda: other(magnet__air_gap="2.6 mm"), AXIS, "magnet.air_gap", True),
    "another magnet constant": (
        lambda: other(magnet__magnet_constant=2 * AXIS.magnet.magnet_constant), AXIS,
        "magnet.magnet_constant", True),
    "another sensor gain": (lambda: other(sensor__gain=2.0), AXIS, "sensor.gain", True),
    "another amplifier": (lambda: other(amplifier__gain="2 A/V"), AXIS, "amplifier.gain", True),
    "sensor far too late": (
        lambda: other(sensor__lag="30 ms"), None, "peak of |S|", False),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_no_filter_that_is_planted_wrong_passes_without_a_sentence(name):
    make, plant, word, fatal = WRONG[name]
    found = judge_adequacy(make(), plant)
    said = sentences(found)
    assert any(word in text for text in said), said
    assert any(each.fatal for each in found) == fatal


def test_innovations_are_held_against_their_band():
    record = ambkit.simulate(AXIS, step=0.2e-3, duration=0.1, seed=1).record
    for factor, said, fatal in ((1.0, False, False), (0.1, True, False), (1e-3, True, True),
                                (1e3, True, True)):  # fmt: skip
        estimate = noisy(measurement=factor).run(record)
        (nis,) = judge_adequacy(None, AXIS, nis=float(np.nanmean(estimate.nis[1:])))
        assert bool(nis.sentence) == said
        assert nis.fatal == fatal


def test_what_a_run_asks_for_is_held_against_what_there_is():
    high = Scenario(reference=Step(amplitude=1.2e-3), disturbance=Step(amplitude=-12.0))
    said = sentences(judge_adequacy(KalmanFilter(AXIS), None, high))
    assert any("reaches 1.2 mm, beyond the clearance of 1 mm" in text for text in said)
    assert any("load capacity" in text for text in said)


def test_a_controller_that_does_not_hold_the_rotor_is_named():
    weak = Scenario(controller=Control(kp=100.0, ki=0.0, kd=1.0, derivative_filter=3e-4))
    (unstable,) = (e for e in judge_adequacy(KalmanFilter(AXIS), None, weak) if e.sentence)
    assert unstable.fatal
    assert unstable.sentence == "with this controller the loop is unstable"


def kinds_of_machine(name):
    """A preset in the long part: some of a second each."""
    return pytest.param(Machine.preset(name), marks=pytest.mark.long, id=name)


SPINDLE = Path(__file__).parents[1] / "examples" / "spindle.toml"
GOOD = [
    pytest.param(AXIS, id=AXIS.name), pytest.param(BALL, id=BALL.name),
    *map(kinds_of_machine, PRESETS),
    pytest.param(Machine.load(SPINDLE), id="spindle"),
]  # fmt: skip


@pytest.mark.parametrize(
    "plant",
    quick([MLPS, Machine.preset("tum_mlps_flexible")], [MLPS]),
    ids=lambda plant: plant.name,
)
def test_no_good_filter_of_a_machine_is_accused(plant):
    assert sentences(judge_adequacy(KalmanFilter(plant))) == []


@pytest.mark.parametrize("plant", GOOD)
def test_no_good_filter_is_accused(plant):
    axis = plant.single
    for name, kind in KINDS.items():
        if name == "adaptive" or not (axis or (kind.estimator.several_axes and name != "table")):
            continue  # which is trained for seconds
        if name == "constant-velocity" and not axis:
            continue  # without the magnets' stiffness it cannot feed every machine's controller
        found = judge_adequacy(kind.make(plant, learned_magnet(name, plant)))
        assert sentences(found) == [], name
        assert not any(each.fatal for each in found)


@pytest.mark.parametrize(
    ("what", "factor"), [("disturbance", 1e-2), ("disturbance", 1e2), ("measurement", 1e-2),
                         ("measurement", 1e2)],
)  # fmt: skip
def test_what_tuning_may_find_is_not_accused(what, factor):
    assert sentences(judge_adequacy(noisy(**{what: factor}))) == []


def test_a_bearing_as_it_is_identified_is_not_another(tmp_path):
    found = other(
        magnet__magnet_constant=0.93 * AXIS.magnet.magnet_constant, rotor__mass=0.53,
        sensor__noise_variance=3 * AXIS.sensor.noise_variance,
    )  # fmt: skip
    assert sentences(judge_adequacy(found, AXIS)) == []


def test_a_magnet_of_the_same_stiffnesses_is_not_another():
    """A log tells k/s0^2 and k/s0^3, and of k and s0 little more."""
    share = 0.86
    found = other(
        magnet__air_gap=share * AXIS.magnet.air_gap,
        magnet__magnet_constant=share**2.5 * AXIS.magnet.magnet_constant,
    )
    assert sentences(judge_adequacy(found, AXIS)) == []


def test_the_same_filter_is_judged_once(monkeypatch):
    judge_adequacy(noisy(disturbance=1.5))
    monkeypatch.setattr(adequacy_criteria, "of_filter", None)
    assert judge_adequacy(noisy(disturbance=1.5))


def test_a_load_that_the_record_says_nothing_of_is_followed_all_the_same():
    def build(disturbance):
        return KalmanFilter(AXIS, noise=FilterNoise(disturbance=disturbance))

    least = least_process_noise(build, 1.1e-6)
    assert 1e-3 * USUAL.disturbance < least < USUAL.disturbance
    assert sentences(judge_adequacy(build(least))) == []
    assert sentences(judge_adequacy(build(1.1e-6)))
    assert least_process_noise(build, 200.0) == 200.0


def test_the_judgement_holds_against_a_simulated_step_of_half_the_load_capacity():
    step = Step(amplitude=0.5 * load_capacity(AXIS)[0], time=0.05)
    happening = ambkit.scenario_for(AXIS, Scenario(duration=0.3, disturbance=step))
    record = ambkit.simulate(AXIS, happening).record
    after = record.t > 0.05
    for factor in (1.0, 1e-4):
        (told,) = (e for e in judge_adequacy(noisy(disturbance=factor))
                   if e.name == "time to follow a load")  # fmt: skip
        f_d = noisy(disturbance=factor).run(record).f_d[after]
        took = record.t[after][np.flatnonzero(f_d > 0.63 * step.amplitude)[0]] - 0.05
        assert took == pytest.approx(told.value, rel=0.25)


def test_an_export_is_refused_without_force(call):
    noisy(disturbance=1e-8).save("slow.toml")
    text = "is followed to 63 %"
    refused = call("export", "c", "slow.toml", "--out", "c")
    assert refused.code == 2
    assert text in refused.err
    assert not Path("c").exists()
    file = ambkit.FilterFile.load("slow.toml")
    with pytest.raises(AmbkitError, match=text):
        export_c(AXIS, None, "c", filter_file=file)
    with pytest.raises(AmbkitError, match="fingerprint"):  # of another bearing
        export_c(BALL, None, "c", filter_file=file)
    assert call("export", "c", "slow.toml", "--out", "c", "--force").code == 0
    assert "MUST NOT FLY" in Path("c/README.md").read_text()
    for words in ("mat slow.toml --out m.mat", "fmu slow.toml --out c/f.fmu",
                  "c inteco_ml --filter slow.toml --out c"):  # fmt: skip
        assert call("export", *words.split()).code == 2


def test_an_export_says_what_does_not_need_force(call):
    KalmanFilter(AXIS, gravity="disturbance").save("weight.toml")
    told = call("export", "c", "weight.toml", "--out", "c")
    assert told.code == 0
    assert "is part of the estimated disturbance force" in told.err


def test_check_and_simulate_say_the_same(call):
    slow = noisy(disturbance=1e-8)
    slow.save("slow.toml")
    (fatal,) = {e.sentence for e in judge_adequacy(slow) if e.name == "time to follow a load"}
    refused = call("check", "slow.toml")
    assert refused.code == 2
    assert fatal in refused.err
    for words in ("simulate zittau_axial --filter slow.toml --out run.csv",
                  "filter run.csv --filter slow.toml"):  # fmt: skip
        assert fatal in call(*words.split()).out  # among the notes of the result
    KalmanFilter(AXIS).save("good.toml")
    good = call("check", "good.toml")
    assert (good.code, good.err) == (0, "")
    assert call("check", "good.toml", "--machine", "inteco_ml").code == 2


def test_check_judges_a_filter_on_a_machine_with_several_axes(call):
    """``--machine`` took one axis only, and a machine's filter was not held to it."""
    KalmanFilter(Machine.preset("heart_pump")).save("filter.toml")
    for other in ("tum_mlps", "zittau_axial"):
        refused = call("check", "filter.toml", "--machine", other)
        assert refused.code == 2
        assert "axes or readings are others" in refused.err
    assert call("check", "filter.toml", "--machine", "heart_pump").code == 0


def test_identify_writes_no_process_noise_that_follows_no_load():
    # As a record whose load rests has it.
    made, raised = identified.filter_following_load(AXIS, 1.12e-3)
    assert sentences(judge_adequacy(made)) == []
    assert raised == {"noise.disturbance": identified.RAISED}
    kept, raised = identified.filter_following_load(AXIS, 9620.0)
    assert (kept.variances.disturbance, raised) == (9620.0, {})


def test_design_judges_with_the_stated_load_and_not_with_the_assumed_one(tmp_path):
    errors = {}
    for factor in (1.0, 1e-4):
        noisy(disturbance=factor).save(tmp_path / "filter.toml")
        found = design_candidates.judged(tmp_path / "filter.toml", 0)
        assert found["load"] == pytest.approx(0.5 * load_capacity(AXIS)[0])
        errors[factor] = found["errors"]
    assert errors[1e-4]["f_d"] > 1.5 * errors[1.0]["f_d"] > 0.5
    assert errors[1e-4]["x"] > 5 * errors[1.0]["x"]


STUDY = """
name = "slow"
machine = "slow.bearing.toml"
runs = 4
scenario = {duration = "50 ms"}

[[vary]]
what = "rotor.mass"
type = "uniform"
tolerance = "2 %"
"""


@pytest.mark.parametrize("words", [
    ["compare", "slow.bearing.toml", "--filter", "linear", "--budget", "1", "--seeds", "1", "--out",
     "filters=filters"],
    ["train", "slow.bearing.toml", "--rules", "2x2", "--out", "filter=filter.toml"],
    ["tune", "robust", "slow.toml", "--budget", "1", "--max-sensitivity", "5",
     "--out", "filter.toml"],
], ids=lambda words: words[0])  # fmt: skip
def test_whatever_writes_a_filter_shows_whether_it_may_fly(words, call):
    if "robust" in words:
        pytest.importorskip("optuna")
    slow = AXIS.replace(sampling_time="2.5 ms", name="slow")  # of 8.3 ms in which the rotor falls
    slow.save("slow.bearing.toml")
    Path("slow.toml").write_text(STUDY)
    written = call(*words, "--json")
    assert written.code == 0
    assert "a sampling time of 2.5 ms is 0.302 times" in written.err
    judged = written.json["adequacy"]
    judged = judged["linear"] if words[0] == "compare" else judged
    assert any(each["name"] == "time to follow a load" for each in judged)


def test_an_axis_is_judged_alike_as_a_bearing_and_as_a_machine():
    machine = AXIS
    one, other = (judge_adequacy(KalmanFilter(of), on) for of, on in
                  ((AXIS, None), (machine, machine)))  # fmt: skip
    assert [each.name for each in one] == [each.name for each in other]
    assert [e.value for e in other] == pytest.approx([e.value for e in one], rel=0.05)
    assert sentences(other) == []


def test_a_record_with_a_sign_swapped_is_named_in_python_too(caplog):
    record = ambkit.simulate(AXIS, step="0.5 mm", duration="0.5 s", seed=1).record
    ambkit.tune(AXIS, record, "linear", budget=1)
    assert not caplog.messages
    swapped = ambkit.Record(record.t, {"y": record["y"], "u": -record["u"]})
    ambkit.tune(AXIS, swapped, "linear", budget=1)
    assert caplog.messages[0].startswith("record 1: the sign of y or of u is wrong")
    notes = ambkit.filter(swapped, "linear", machine=AXIS).notes
    assert any(text.startswith("the record: the sign of y or of u is wrong") for text in notes)


def test_design_names_what_is_wrong_with_a_record_before_it_identifies(
    tmp_path, caplog, monkeypatch
):
    def stop(*_, **__):
        raise AmbkitError("no further")

    monkeypatch.setattr("ambkit.workflow.design.identify", stop)
    record = ambkit.simulate(AXIS, step="0.5 mm", duration="0.3 s", seed=1).record
    path = tmp_path / "run.csv"
    ambkit.Record(record.t, {"y": record["y"], "u": -record["u"]}).save(path)
    with pytest.raises(AmbkitError, match="no further"):
        ambkit.design(AXIS, [str(path)], out=tmp_path / "design")
    assert "the sign of y or of u is wrong" in caplog.messages[0]
    ambkit.Record(record.t, {"y": 1e3 * record["y"], "u": record["u"]}).save(path)
    with pytest.raises(AmbkitError, match="beyond the air gap"):
        ambkit.design(AXIS, [str(path)], out=tmp_path / "other")


def test_a_controller_at_fault_is_named_with_a_better_one():
    """A PID cannot hold a rotor by a coil of 6 Hz with margins."""
    slow = BALL.replace(amplifier__bandwidth="6 Hz")
    (text,) = (text for text in sentences(judge_adequacy(KalmanFilter(slow))) if "|S|" in text)
    peak, lqg = (float(number) for number in re.findall(r"(?:is|has) ([0-9.]+)", text))
    assert "the controller is at fault" in text
    assert lqg < 0.5 * peak
