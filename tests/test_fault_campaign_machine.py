"""Faults of any reading of a machine with several axes, in its loop and beside it."""

import numpy as np
import pytest

from ambkit import AmbkitError, KalmanFilter, Machine
from ambkit.judge.faults import inject_faults
from ambkit.judge.faults.fault_run import Flight
from ambkit.judge.faults.faults import FAULTS

TUM = Machine.preset("tum_mlps")
READINGS = [each.name for each in TUM.readings]


def test_a_fault_is_of_the_reading_that_is_named_and_of_no_other():
    at = READINGS.index("Lb1")
    flight = Flight(TUM, None, in_loop=True, seed=0, reading=at)
    assert TUM.axes[flight.at].name == "A1"
    channel, (window,) = flight.through(FAULTS["stuck"])
    record = flight.fly(channel, KalmanFilter(TUM)).record
    for name in READINGS:
        moved = np.ptp(record[f"y_{name}"][window])
        assert (moved == 0) == (name == "Lb1")
    assert np.ptp(record["r_A1"]) > 0
    assert np.ptp(record["r_B1"]) == 0


def test_every_estimator_comes_back_and_the_rotor_stays_up():
    found = inject_faults(
        TUM, ["linear"], reading="Lb1", faults=["stuck", "infinite-y", "lift-off"], steps=0
    )
    assert found.faults == ["clean", "stuck", "infinite-y"]
    assert found.failures == []
    assert {each.levitation for each in found.outcomes} == {"kept"}
    with pytest.raises(AmbkitError, match="has no reading A9; there are La1"):
        inject_faults(TUM, ["linear"], reading="A9", steps=0)
