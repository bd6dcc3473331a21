"""A log that holds an estimate in the sensor's place, or a rotor that lies, is told of."""

import re

import numpy as np
import pytest

import ambkit
from ambkit import Machine, Record
from ambkit.arguments import check_plausibility
from ambkit.data import recordings
from ambkit.data.reading.plausibility import longest_run, suspects
from ambkit.judge.plausibility import averaged, evaluate_record
from ambkit.workflow.check import inspect

BEARING = Machine.preset("zittau_axial")
RUN = ambkit.simulate(BEARING, step="0.3 mm", disturbance="2 N").record
LOST = ambkit.simulate(BEARING, step="0.3 mm", disturbance="30 N").record
UNITS = {"y": "m", "u": "V", "x_logged": "m", "r": "m", "other": "V"}


def log(**signals):
    return Record(RUN.t, signals, {name: UNITS[name] for name in signals})


def of_suspects(record):
    return list(suspects(record.t, record.signals, record.units))


def test_a_sound_log_is_not_suspected():
    assert of_suspects(RUN) == []
    assert of_suspects(log(y=RUN["y"], u=RUN["u"], x_logged=RUN["x"], other=RUN["y"])) == []
    assert check_plausibility(log(y=RUN["y"], u=RUN["u"]), BEARING) == []


@pytest.mark.parametrize("name", ["sinus_kalman.csv", "sinus_no_filter.csv"])
def test_a_real_log_is_not_suspected(name):
    record = ambkit.load(recordings.folder() / name)
    assert of_suspects(record) == []
    assert not any(
        "lie" in text for text in check_plausibility(record, Machine.preset("inteco_ml"))
    )


def test_an_estimate_in_the_sensor_s_place_is_noticed():
    twice = log(y=RUN["x"], u=RUN["u"], x_logged=RUN["x"] * (1 + 1e-13))
    assert of_suspects(twice) == [
        "y and x_logged hold the same numbers: is y the sensor reading, or computed from it?"
    ]
    assert any("the same numbers" in text for text in check_plausibility(twice, BEARING))
    still = log(y=0 * RUN["x"], u=RUN["u"], r=0 * RUN["x"])
    assert of_suspects(still) == []


@pytest.mark.parametrize("smooth", [
    lambda y: np.convolve(y, np.ones(20) / 20, "same"),
    lambda y: y + 0.02 * (RUN["y"] - RUN["x"]) - (y - RUN["x"]),
])  # fmt: skip
def test_a_smoothed_position_is_noticed(smooth):
    (told,) = check_plausibility(log(y=smooth(RUN["y"]), u=RUN["u"]), BEARING)
    assert "the bearing's sensor has 9.1 µm; was y smoothed before it was logged" in told


def test_a_rotor_that_lies_is_noticed_with_its_bearing_and_without():
    assert LOST.meta["stop_touched"] > 1000
    lying = log(y=LOST["y"], u=LOST["u"])
    (told,) = of_suspects(lying)
    assert "y rests at its end, 1.0" in told
    assert "and u stands still: is the rotor in contact with a stop there?" in told
    verdict = evaluate_record(lying, BEARING)
    (told,) = [text for text in verdict.remarks if "stop" in text]
    assert told.startswith("y rests at 1 mm, the rotor's stop, in 49 % of the samples, from 0.2")
    assert told in check_plausibility(lying, BEARING)


def test_one_that_only_touches_a_stop_does_not_lie():
    y = RUN["y"].copy()
    y[2000:2050] = BEARING.clearance  # 5 ms, less than the plant's time constant
    verdict = evaluate_record(log(y=y, u=RUN["u"]), BEARING)
    assert not any("rests at" in text for text in verdict.remarks)


def test_read_and_check_tell_it(tmp_path):
    log(y=RUN["x"], u=RUN["u"], x_logged=RUN["x"]).save(tmp_path / "twice.csv")
    reading = ambkit.read(tmp_path / "twice.csv")
    assert any("hold the same numbers" in text for text in reading.account())
    assert any("the same numbers" in text for text in inspect(tmp_path / "twice.csv").remarks)


def test_the_longest_run():
    assert longest_run(np.array([False, True, True, False, True, True, True])) == (4, 3)
    assert longest_run(np.zeros(3, bool)) == (0, 0)
    assert longest_run(np.zeros(0, bool)) == (0, 0)


def test_a_rotor_that_a_load_pushed_away_and_that_came_back_does_not_lie():
    """It floats at its least place, before the load and after it: with two currents, but not on a
    stop, where the current would change in one visit.
    """
    for seed in range(6):
        record = ambkit.simulate(BEARING, ambkit.Scenario(
            seed=seed, controller=ambkit.PID.textbook(BEARING),
            disturbance=ambkit.Step(amplitude=3.0, time=0.25),
        )).record  # fmt: skip
        assert of_suspects(record) == []


RNG = np.random.default_rng(2)
STILL = ambkit.simulate(BEARING).record


def lying(record, share, u=None):
    """Lay the rotor on its lower stop for the last part of a record."""
    y, control, start = record["y"].copy(), record["u"].copy(), round((1 - share) * len(record))
    y[start:] = -1e-3 + 9e-6 * RNG.normal(size=y.size - start)
    if u is not None:
        control[start:] = u + 0.01 * RNG.normal(size=y.size - start)
    return Record(record.t, {"y": y, "u": control}, {"y": "m", "u": "V"})


def test_a_part_that_lies_spoils_no_sign_and_no_weight():
    """Of no problem there is one, and the end that is named is that on which the rotor lies."""
    record = lying(STILL, 0.3, 0.45)
    problems, remarks = evaluate_record(record, BEARING)
    assert problems == ()
    assert not any("pulls with gravity" in text for text in remarks)
    assert any(text.startswith("y rests at -1 mm, the rotor's stop, in 30 %") for text in remarks)
    assert not any("greatest" in text for text in of_suspects(record))
    _, remarks = evaluate_record(lying(STILL, 1.0, 0.45), BEARING)
    assert any("the rotor's stop, in 100 % of the samples" in text for text in remarks)


def test_a_noise_that_hides_the_travel_shows_no_stop():
    problems, remarks = evaluate_record(log(y=1e3 * RUN["y"], u=RUN["u"]), BEARING)
    assert any("is a unit, scale or offset wrong?" in text for text in problems)
    assert not any("stop" in text for text in remarks)


def test_channels_that_stand_still_are_reported_as_what_they_are():
    assert of_suspects(log(y=RUN["y"], u=0 * RUN["u"])) == [
        "u stands still throughout: is it the control signal?"
    ]
    _, remarks = evaluate_record(log(y=0 * RUN["y"] + 1e-4, u=RUN["u"]), BEARING)
    assert remarks == ("y stands still at 0.1 mm: is it the sensor's?",)


def test_a_current_at_its_limit_is_not_one_in_steps():
    u = np.where(np.arange(len(RUN)) < len(RUN) / 2, 1.5, RUN["u"])
    assert not any("steps of a converter" in text for text in of_suspects(log(y=RUN["y"], u=u)))


def test_a_slow_measurement_on_a_finer_grid_is_no_reference():
    y = np.interp(RUN.t, RUN.t[::2], RUN["y"][::2])
    assert of_suspects(log(y=y, u=RUN["u"])) == []


def test_a_light_low_pass_is_reported_by_the_colour_of_the_noise():
    from scipy.signal import butter, lfilter

    assert check_plausibility(log(y=RUN["y"], u=RUN["u"]), BEARING) == []
    smoothed = lfilter(*butter(1, 0.3), RUN["y"])
    (told,) = check_plausibility(log(y=smoothed, u=RUN["u"]), BEARING)
    assert (
        "is not white, as the bearing's sensor's is: was y smoothed before it was logged?" in told
    )


def test_a_control_signal_too_small_to_hold_the_rotor_is_reported():
    sine = ambkit.Scenario(reference=ambkit.Sine(amplitude=0.3e-3, frequency=5.0))
    record = ambkit.simulate(BEARING, sine).record
    assert check_plausibility(log(y=record["y"], u=record["u"]), BEARING) == []
    (told,) = check_plausibility(log(y=record["y"], u=record["u"] / 10), BEARING)
    assert told.startswith("u varies by 2")
    assert "is the record of another rig, or a unit or a scale wrong?" in told


def test_an_offset_that_the_weight_contradicts_is_reported():
    rig = Machine.preset("inteco_ml")
    record = ambkit.simulate(rig, duration=2.0).record
    away = Record(record.t, {"y": record["y"] + 7e-3, "u": record["u"]}, {"y": "m", "u": "V"})
    (told,) = check_plausibility(away, rig)
    assert told.startswith("at the mean of the record the magnet pulls by 3.")
    assert "where the weight is 0.594 N" in told
    assert "Is an offset or a scale of y or of u wrong" in told


@pytest.mark.parametrize("size", [3, 8])
def test_a_running_mean_is_reported_with_its_length(size):
    assert check_plausibility(log(y=RUN["y"], u=RUN["u"]), BEARING) == []
    mean = np.convolve(RUN["y"], np.ones(size) / size, "same")
    (told,) = check_plausibility(log(y=mean, u=RUN["u"]), BEARING)
    assert f"is that of means of {size} samples" in told or "was y smoothed" in told


@pytest.mark.parametrize("preset", ["zittau_axial", "inteco_ml"])
def test_no_healthy_log_holds_a_running_mean(preset):
    told, means = [], []
    for seed in range(3):
        for times in (0.5, 1.0, 2.0):
            bearing = Machine.preset(preset)
            bearing = bearing.replace(sampling_time=times * bearing.sampling_time)
            for given in ({}, {"controller": ambkit.PID.textbook(bearing)}):
                duration = 4000 * bearing.sampling_time
                run = ambkit.Scenario(seed=seed, duration=duration, **given)
                y = ambkit.simulate(bearing, run).record["y"]
                told.append(averaged(y))
                means.append(averaged(np.convolve(y, np.ones(3) / 3, "valid")))
    assert told == [0] * len(told)
    assert means.count(3) >= 0.9 * len(means)


def test_a_record_at_rest_on_a_stop_identifies_nothing_and_says_so():
    rng = np.random.default_rng(0)
    y = -1e-3 + 9e-6 * rng.normal(size=1000)
    rest = Record(RUN.t[:1000], {"y": y, "u": np.full(1000, 0.3)}, {"y": "m", "u": "V"})
    found = ambkit.identify(BEARING, rest)
    notes = " ".join(found.notes)
    assert "magnet constant is not identifiable" in notes
    assert "air gap is not identifiable" in notes
    assert re.search("offset of -0.7. mm is implausible", notes)
    assert not any(check.good for check in found.validation)
