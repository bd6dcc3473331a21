"""A measured current with what drives it: the sensor's noise is no motion, and no delay."""

import math

import numpy as np
import pytest

from ambkit import Record
from ambkit.identification.maximum_likelihood.current_state import Coil, smooth_current
from ambkit.identification.maximum_likelihood.joint import Joint
from ambkit.identification.maximum_likelihood.likelihood import Data
from ambkit.identification.maximum_likelihood.parameters import named
from ambkit.machine.magnets import own_time
from benchmarks import quiet_rig
from benchmarks.quiet_rig import (
    LAG,
    OFFSET,
    SENSOR,
    TRUTH,
    flowing_at_the_truth,
    identified,
    quiet_loops,
)


@pytest.fixture(scope="module")
def records():
    return quiet_loops(2)


def without(record, name):
    return Record(record.t, {n: record[n] for n in record if n != name}, record.units, record.meta)


def test_the_current_is_known_as_well_as_is_reported(records):
    for record in records[:1]:
        found = smooth_current([record])
        assert found.noise == pytest.approx(SENSOR, rel=0.03)
        assert found.lag == pytest.approx(LAG, rel=0.1)
        assert abs(found.delay) < 0.5e-3
        off = (found.records[0]["u"] + record.meta["offset"] - record["iu"])[500:-500]
        assert np.std(off) == pytest.approx(found.unknown, rel=0.15)
        assert found.unknown < SENSOR / 4


def test_at_its_start_the_current_is_known_almost_as_well_as_later():
    off = []
    for record in quiet_loops(60, duration=0.4, first=7000):
        current = at_the_truth(record).current
        off.append(current.records[0]["u"] + record.meta["offset"] - record["iu"])
    scatter = np.std(off, axis=0)
    assert np.all(scatter[:200] < 2.2 * current.unknown)  # 3.4 from the first measurement


def test_a_current_that_was_measured_starts_where_it_was(records):
    """Else the first measurements throw it about, and a magnet is no line over amperes."""
    for record in records:
        joint = at_the_truth(record)
        found = joint.model.states(joint.current.records[0])["i"]
        assert np.all(np.abs(found - record["iu"])[:30] < 5 * joint.current.unknown)


def test_at_the_truth_nothing_has_a_slope():
    for name, row in quiet_rig.slopes(12, first=3000).items():
        assert abs(row["in_errors"]) < 4, name
        assert abs(row["slope"]) < 4 / 12**0.5, name  # it scatters as the information says


def test_magnet_and_delay_are_found_in_a_quiet_loop(records):
    found = identified(records[1])
    for name, true in (("magnet_constant", 1.0012e-4), ("air_gap", 12.149e-3), ("delay", 0.0)):
        assert abs(found[name] - true) < 3 * found.standard_error(name), name
    assert found["control_noise"] == pytest.approx(SENSOR**2, rel=0.4)
    assert found.to_dict()["current"]["noise"] == pytest.approx(SENSOR, rel=0.03)
    assert found.model.memory == 0
    raw = identified(records[1], use_control=False)
    assert raw["delay"] < -2.5 * raw.standard_error("delay")
    assert any("too little motion" in said or "good part" in said for said in raw.remarks)


def test_what_drives_no_current_is_not_taken_for_its_control(records):
    record = records[0]
    assert smooth_current([without(record, "control")]) is None
    other = np.random.default_rng(0).normal(size=len(record))
    for control in (other, np.zeros(len(record)), np.where(other > 2, np.nan, record["control"])):
        signals = {name: record[name] for name in record} | {"control": control}
        assert smooth_current([Record(record.t, signals, record.units, record.meta)]) is None


def at_the_truth(record, free=()):
    """Coil and loop as they were simulated."""
    current = flowing_at_the_truth(record)
    model = current.driving(TRUTH.replace(current_offset=record.meta["offset"]))
    settling = own_time(model.isolated)
    return Joint([record], current, model, named(free), settling, current.coil.settled)


def test_at_the_true_coil_the_likelihood_of_both_signals_has_no_slope_that_of_one_has():
    """The control answers to the position, and so tells what the current has done."""
    both, alone = [], []
    for record in quiet_loops(24, first=3000):
        joint = at_the_truth(record)
        _, scores, _ = joint.slopes()
        both.append(scores.sum(axis=1))
        coil, h = joint.current.coil, 1e-3
        up, down = (
            coil.predicted(record["u"], record["control"])[1][coil.settled :]
            for coil in (Coil.at(coil.theta + side * h * np.eye(5)[2]) for side in (1, -1))
        )
        alone.append(-float(np.sum(up**2 - down**2)) / (4 * h))
    assert np.all(np.abs(in_their_errors(np.array(both))) < 3.5)
    assert in_their_errors(np.array(alone)) < -4  # a gain that is too small


def in_their_errors(slopes):
    return slopes.mean(axis=0) / slopes.std(axis=0, ddof=1) * math.sqrt(len(slopes))


def test_slopes_are_those_of_the_likelihood_of_both_signals(records):
    joint = at_the_truth(records[0], ("air_gap",))
    information, scores, known = joint.slopes()
    assert known == 0
    for at, step in enumerate(1e-3 / np.sqrt(np.diag(information))):
        if at == 2:
            continue  # the delay: at a whole sample there is a kink
        h = step * np.eye(6)[at]
        slope = (joint.moved(h).value - joint.moved(-h).value) / (2 * step)
        assert scores[at].sum() == pytest.approx(slope, rel=1e-2, abs=0.02 * 1e-3 / step)


def test_an_unknown_coil_is_in_the_errors(records):
    joint = at_the_truth(records[0], ("air_gap", "current_offset"))
    alone = Data(joint.current.records, joint.settling).local(joint.model, joint.parameters)
    with_coil = joint.local(alone)
    errors, larger = (np.sqrt(np.diag(np.linalg.inv(x.information))) for x in (alone, with_coil))
    assert np.all(larger > 1.02 * errors)
    assert np.all(larger < 1.2 * errors)


@pytest.mark.study
def test_over_seeds_nothing_is_biased_and_the_errors_hold():
    """``python -m benchmarks.quiet_rig`` runs the 200 of docs/explanation/rig.md."""
    table = quiet_rig.study(12, first=1000)
    for name in ("magnet_constant", "air_gap", "delay", "current_offset"):
        assert abs(table[name]["bias"]) < 3.5, name
        assert table[name]["ratio"] < 1.6, name
    assert table["delay"]["error"] < TRUTH.isolated.sampling_time / 2
    assert table["current_offset"]["error"] < OFFSET
