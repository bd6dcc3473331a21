"""A record beside the bearing that it is said to be of: rate, range, noise, signs."""

import re
from pathlib import Path

import numpy as np
import pytest

import ambkit
from ambkit.data import recordings
from ambkit.data.record import Record
from ambkit.judge.plausibility import SURE, evaluate_record, mirror_correlation
from ambkit.workflow.check import inspect

RIG = Path(__file__).parents[2] / "shared" / "data" / "inteco" / "closed_loop"
BEARING = ambkit.Bearing.preset("zittau_axial")
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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_record_belongs_to_its_bearing_and_not_with_a_sign_swapped(name, seed):
    record = run(name, seed)
    assert evaluate_record(record, BEARING) == ((), ())
    assert mirror_correlation(record, BEARING) < -SURE
    for swapped in (changed(record, y=-1.0), changed(record, u=-1.0)):
        (problem,) = evaluate_record(swapped, BEARING).problems
        assert "the sign of y or of u is swapped" in problem
    assert evaluate_record(changed(record, y=-1.0, u=-1.0), BEARING).problems == ()


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
def test_the_signs_of_the_rig_are_told():
    bearing = ambkit.Bearing.preset("inteco_ml")
    for log in sorted(RIG.glob("*.mat")):
        record = ambkit.load(log, recordings.folder() / "closed_loop.toml")
        assert evaluate_record(record, bearing).problems == (), log.name
        (problem,) = evaluate_record(changed(record, y=-1.0), bearing).problems
        assert "swapped" in problem


def test_where_signs_cannot_be_told_nothing_is_said():
    rng = np.random.default_rng(0)
    t = 1e-4 * np.arange(5000)
    record = Record(t, {"y": 1e-5 * rng.normal(size=5000), "u": 0.1 * rng.normal(size=5000)})
    assert abs(mirror_correlation(record, BEARING)) < SURE
    still = Record(t, {"y": np.zeros(5000), "u": np.zeros(5000)})
    assert mirror_correlation(still, BEARING) == 0.0
    gone = Record(t, {"y": np.full(5000, np.nan), "u": np.zeros(5000)})
    assert evaluate_record(gone, BEARING).problems == ()


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
def test_wrong_units_are_told(factors, problem, remark):
    verdict = evaluate_record(changed(run(), **factors), BEARING)
    for expected, found in ((problem, verdict.problems), (remark, verdict.remarks)):
        if expected is not None:
            assert any(re.search(expected, each) for each in found), found


def test_a_wrong_rate_is_a_problem_of_the_file(tmp_path):
    record = run()
    Record(10 * record.t, {"y": record["y"], "u": record["u"]}).save(tmp_path / "r.csv")
    found = inspect(tmp_path / "r.csv", machine=BEARING)
    assert found.problems == (
        f"{tmp_path / 'r.csv'}: it is sampled every 1 ms, the bearing's sampling_time is 0.1 ms",
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
