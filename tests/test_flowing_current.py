"""A measured current with what drives it: the sensor's noise is no motion, and no delay."""

from __future__ import annotations

import numpy as np
import pytest

from ambkit import Record
from ambkit.identification.maximum_likelihood.current import flowing
from benchmarks import quiet_rig
from benchmarks.quiet_rig import LAG, OFFSET, SENSOR, TRUTH, identified, quiet_loops


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return quiet_loops(2)


def without(record: Record, name: str) -> Record:
    return Record(record.t, {n: record[n] for n in record if n != name}, record.units, record.meta)


def test_the_current_is_known_as_well_as_is_said(records: list[Record]) -> None:
    for record in records[:1]:
        found = flowing([record])
        assert found is not None
        assert found.noise == pytest.approx(SENSOR, rel=0.03)
        assert found.lag == pytest.approx(LAG, rel=0.1)
        assert abs(found.delay) < 0.5e-3
        off = (found.records[0]["u"] + record.meta["offset"] - record["iu"])[500:-500]
        assert np.std(off) == pytest.approx(found.unknown, rel=0.15)
        assert found.unknown < SENSOR / 4


def test_magnet_and_delay_are_found_in_a_quiet_loop(records: list[Record]) -> None:
    found = identified(records[1])
    for name, true in (("magnet_constant", 1.0012e-4), ("air_gap", 12.149e-3), ("delay", 0.0)):
        assert abs(found[name] - true) < 3 * found.standard_error(name), name
    assert found["control_noise"] == pytest.approx(SENSOR**2, rel=0.4)
    assert found.to_dict()["current"]["noise"] == pytest.approx(SENSOR, rel=0.03)
    assert found.model.memory == 0
    raw = identified(records[1], use_control=False)
    assert raw["delay"] < -2.5 * raw.standard_error("delay")
    assert any("too quiet" in said or "good part" in said for said in raw.remarks)


def test_what_drives_no_current_is_not_taken_for_its_control(records: list[Record]) -> None:
    record = records[0]
    assert flowing([without(record, "control")]) is None
    other = np.random.default_rng(0).normal(size=len(record))
    for control in (other, np.zeros(len(record)), np.where(other > 2, np.nan, record["control"])):
        signals = {name: record[name] for name in record} | {"control": control}
        assert flowing([Record(record.t, signals, record.units, record.meta)]) is None


@pytest.mark.long
def test_over_seeds_nothing_is_biased_and_the_errors_hold() -> None:
    """The 200 seeds of docs/rig.md are run by ``python -m benchmarks.identification quiet``."""
    table = quiet_rig.study(12, first=1000)
    for name in ("magnet_constant", "air_gap", "delay", "current_offset"):
        assert abs(table[name]["bias"]) < 3.5, name
        assert table[name]["ratio"] < 1.6, name
    assert table["delay"]["error"] < TRUTH.bearing.sampling_time / 2
    assert table["current_offset"]["error"] < OFFSET
