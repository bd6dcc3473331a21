"""A log that holds an estimate in the sensor's place, or a rotor that lies, is told of."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ambkit
from ambkit import Bearing, Record
from ambkit.data import recordings
from ambkit.data.reading.suspects import longest_run, suspects
from ambkit.judge.belongs import evaluate_record
from ambkit.workflow.belonging import check_belongs
from ambkit.workflow.inspection import inspect

BEARING = Bearing.preset("zittau_axial")
RUN = ambkit.simulate(BEARING, step="0.3 mm", load="2 N")
LOST = ambkit.simulate(BEARING, step="0.3 mm", load="30 N")
UNITS = {"y": "m", "u": "V", "x_logged": "m", "r": "m", "other": "V"}


def log(**signals: Any) -> Record:
    return Record(RUN.t, signals, {name: UNITS[name] for name in signals})


def of_suspects(record: Record) -> list[str]:
    return list(suspects(record.t, record.signals, record.units))


def test_a_sound_log_is_not_suspected() -> None:
    assert of_suspects(RUN) == []
    assert of_suspects(log(y=RUN["y"], u=RUN["u"], x_logged=RUN["x"], other=RUN["y"])) == []
    assert check_belongs(log(y=RUN["y"], u=RUN["u"]), BEARING) == []


@pytest.mark.parametrize("name", ["sinus_kalman.csv", "sinus_no_filter.csv"])
def test_a_real_log_is_not_suspected(name: str) -> None:
    record = ambkit.load(recordings.folder() / name)
    assert of_suspects(record) == []
    assert not any("lie" in text for text in check_belongs(record, Bearing.preset("inteco_ml")))


def test_an_estimate_in_the_sensor_s_place_is_noticed() -> None:
    twice = log(y=RUN["x"], u=RUN["u"], x_logged=RUN["x"] * (1 + 1e-13))
    assert of_suspects(twice) == [
        "y and x_logged hold the same numbers: is y what the sensor shows, or what was made of it?"
    ]
    assert any("the same numbers" in text for text in check_belongs(twice, BEARING))
    still = log(y=0 * RUN["x"], u=RUN["u"], r=0 * RUN["x"])
    assert of_suspects(still) == []


@pytest.mark.parametrize("smooth", [
    lambda y: np.convolve(y, np.ones(20) / 20, "same"),
    lambda y: y + 0.02 * (RUN["y"] - RUN["x"]) - (y - RUN["x"]),
])  # fmt: skip
def test_a_smoothed_position_is_noticed(smooth: Any) -> None:
    (told,) = check_belongs(log(y=smooth(RUN["y"]), u=RUN["u"]), BEARING)
    assert "the bearing's sensor has 9.1 µm; was y smoothed before it was logged" in told


def test_a_rotor_that_lies_is_noticed_with_its_bearing_and_without() -> None:
    assert LOST.meta["stop_touched"] > 1000
    lying = log(y=LOST["y"], u=LOST["u"])
    (told,) = of_suspects(lying)
    assert "y rests at its end, 1.0" in told
    assert "and u stands still: does the rotor lie on a stop there?" in told
    verdict = evaluate_record(lying, BEARING)
    (told,) = [text for text in verdict.remarks if "stop" in text]
    assert told.startswith("y rests at 1 mm, the rotor's stop, in 49 % of the samples, from 0.2")
    assert told in check_belongs(lying, BEARING)


def test_one_that_only_touches_a_stop_does_not_lie() -> None:
    y = RUN["y"].copy()
    y[2000:2050] = BEARING.rotor.travel_limit  # 5 ms, less than the plant's own time
    verdict = evaluate_record(log(y=y, u=RUN["u"]), BEARING)
    assert not any("rests at" in text for text in verdict.remarks)


def test_read_and_check_tell_it(tmp_path: Path) -> None:
    log(y=RUN["x"], u=RUN["u"], x_logged=RUN["x"]).save(tmp_path / "twice.csv")
    reading = ambkit.read(tmp_path / "twice.csv")
    assert any("hold the same numbers" in text for text in reading.account())
    assert any("the same numbers" in text for text in inspect(tmp_path / "twice.csv").remarks)


def test_the_longest_run() -> None:
    assert longest_run(np.array([False, True, True, False, True, True, True])) == (4, 3)
    assert longest_run(np.zeros(3, bool)) == (0, 0)
    assert longest_run(np.zeros(0, bool)) == (0, 0)


def test_a_rotor_that_a_load_pushed_away_and_that_came_back_does_not_lie() -> None:
    """It floats at its least place, before the load and after it: with two currents, but not on a
    stop, where the current would change in one visit.
    """
    for seed in range(6):
        record = ambkit.simulate(BEARING, ambkit.Scenario(
            seed=seed, controller=ambkit.PID.textbook(BEARING),
            disturbance=ambkit.Step(amplitude=3.0, time=0.25),
        ))  # fmt: skip
        assert of_suspects(record) == []
