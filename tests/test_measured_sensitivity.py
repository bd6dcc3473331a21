"""Sensitivity from records, sweeps of the simulated loop, and experiments for both."""

import json
import math
from functools import cache
from itertools import product

import numpy as np
import pytest
from quick import quick

import ambkit
from ambkit import PID, Control, Machine, Record, Recorded, Scenario
from ambkit.assessment.injection_experiment import design_injection
from ambkit.base.arrays import period_of
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.identification.excitation.signals import multisine, prbs, sparse_multisine
from ambkit.judge.loop.measured_sensitivity import SAME, _magnitudes, measured_sensitivity
from ambkit.simulation.run import simulate

LATE = Machine.preset("zittau_axial").replace(delay=1.5e-4, amplifier__bandwidth=2000.0)
ON_ESTIMATE = Control(feedback="estimate")
T = LATE.sampling_time


def repeated(n, count, band=(10.0, 1000.0)):
    return np.tile(sparse_multisine(n, T, band, per_decade=12).values, count)


def broad(n):
    return np.random.default_rng(7).choice([-1.0, 1.0], n // 4).repeat(4)


def chirp(n):
    """From 10 to 1500 Hz, its frequency growing evenly."""
    t = T * np.arange(n)
    return np.sin(2 * np.pi * (10 * t + 1490 / (2 * n * T) * t**2))


def measured(added, seed=0, *, noise=True, rest=500, pid=ON_ESTIMATE, bearing=LATE):
    """The record of a simulated loop with a signal added to its measurement."""
    added = np.concatenate([np.zeros(rest), added, np.zeros(rest)])
    t = T * np.arange(len(added))
    signal = Recorded.model_construct(times=tuple(t.tolist()), values=tuple(added.tolist()))
    scenario = Scenario(duration=float(t[-1]), noise=noise, seed=seed, controller=pid)
    scenario = scenario.model_copy(update={"injection": signal})
    return simulate(bearing, scenario)


@cache
def model_sensitivity(f):
    loop = ambkit.assess(LATE, "linear").loops["linear"].loop
    return loop.sensitivity(np.array(f))[:, 0, 0]


# ---- what the intervals hold


@pytest.mark.study
@pytest.mark.parametrize(
    ("added", "periods"),
    [(1e-5 * repeated(1000, 8), 7), (3e-6 * broad(8_000), 1), (1e-5 * chirp(12_000), 1)],
    ids=["periods", "polynomials", "chirp"],
)
def test_intervals_hold_what_they_say_over_200_draws_of_the_noise(added, periods):
    truth = measured_sensitivity(measured(added, noise=False))
    size = np.abs(truth.sensitivity)
    if periods == 1:  # its own bias is not in the truth
        size = np.abs(model_sensitivity(tuple(truth.frequency)))
    held, together = [], []
    for seed in range(200):
        found = measured_sensitivity(measured(added, seed))
        assert found.periods == periods
        assert found.frequency == pytest.approx(truth.frequency)
        low, high = found.interval()
        held.append((low <= size) & (size <= high))
        low, high = found.peak_interval()
        together.append(low <= size.max() <= high)
    assert 0.92 <= np.mean(held) <= 0.98
    assert np.mean(together) >= 0.94
    assert np.mean(held, axis=0).min() > 0.85  # at no frequency far from it: 3 of 200 more or less


@pytest.mark.parametrize(
    ("size", "freedom"), [(0.0, 8), (0.5, 18), (1.0, 8), (1.0, 18), (3.0, 18), (30.0, 8)]
)
def test_intervals_hold_where_s_is_as_small_as_its_error_too(size, freedom):
    rng, hits = np.random.default_rng(0), 0
    for _ in range(1000):
        real, imaginary = rng.normal(0, math.sqrt(0.5), 2)
        std = math.sqrt(rng.chisquare(freedom) / freedom)
        low, high = _magnitudes(abs(size + complex(real, imaginary)), std, freedom, 0.95)
        hits += low <= size <= high
    assert 920 <= hits <= (1000 if size < 1 else 975)  # a magnitude is not below 0


# ---- what is estimated


@pytest.mark.parametrize(
    "added",
    [1e-6 * repeated(2000, 5), 3e-6 * np.sin(np.pi * 400 * (T * np.arange(30_000)) ** 2 / 3)],
    ids=["multisine", "chirp"],
)
def test_without_noise_it_is_the_models(added):
    found = measured_sensitivity(measured(added, noise=False, rest=3000))
    expected = model_sensitivity(tuple(found.frequency))
    told = found.frequency > 5
    assert found.sensitivity[told] == pytest.approx(expected[told], rel=0.02)
    L, _ = found.open_loop()
    assert pytest.approx(found.sensitivity, rel=1e-12) == 1 / (1 + L)


def test_y_may_be_logged_before_the_sum():
    record = measured(1e-5 * repeated(1000, 6))
    signals = {"y": record["y"] - record["injected"], "injected": record["injected"]}
    before = measured_sensitivity(Record(record.t, signals), logged="before")
    after = measured_sensitivity(record)
    assert before.sensitivity == pytest.approx(after.sensitivity, rel=1e-9)


def test_the_signal_is_added_after_the_sensors_rounding():
    coarse = LATE.replace(sensor__quantisation=1e-6)
    record = measured(1e-5 * repeated(1000, 2), bearing=coarse)
    steps = (record["y"] - record["injected"]) / 1e-6
    assert steps == pytest.approx(np.round(steps), abs=1e-6)


@pytest.mark.parametrize(
    ("values", "period"),
    [
        (np.tile(multisine(777, T, (40.0, 900.0)).values, 5), 777),
        (np.tile(np.round(1000 * multisine(512, T, (40.0, 900.0)).values), 4), 512),
        (np.tile(np.repeat(prbs(63, T, (200.0, 4000.0)).values, 3), 3), 189),
        (np.sin(np.arange(4000) ** 2 / 5000), None),
        (np.random.default_rng(0).standard_normal(3000), None),
    ],
)
def test_periods_are_found(values, period):
    assert period_of(values, SAME) == period


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"injected": np.zeros(2000)}, "injected is 0 throughout"),
        ({"injected": np.sin(np.arange(2000) * math.pi / 50)}, "power at too few frequencies"),
        ({"y": np.where(np.arange(2000) == 7, np.nan, 0.0)}, "signal y has a gap at 0.7 ms"),
    ],
)
def test_what_a_record_does_not_tell_is_reported(change, message):
    rng = np.random.default_rng(0)
    signals = {"y": rng.standard_normal(2000), "injected": rng.standard_normal(2000)} | change
    record = Record(T * np.arange(2000), signals)
    with pytest.raises(RecordError, match=message):
        measured_sensitivity(record)


# ---- the sweep


@pytest.mark.parametrize(
    ("filter", "kind"),
    quick(product([None, "linear"], ["multisine", "stepped-sine"]), [("linear", "multisine")]),
)
def test_sweep_is_the_models_within_two_percent_where_the_loop_is_linear(filter, kind):
    found = ambkit.assess_sweep(LATE, filter, amplitudes=["2 um", "0.3 mm"], kind=kind)
    small, large = found.swept
    assert small.deviation < 0.02
    assert not small.limited
    assert small.peak == pytest.approx(found.loop.margins.peak, rel=0.02)
    assert large.deviation > 0.05  # the magnet's nonlinearity, and what is cut off
    assert large.limited
    assert json.loads(found.to_json())["amplitudes"]["2 µm"]["deviation"] < 0.02
    assert len(found.figure().panels) == 2


def test_runout_is_no_part_of_a_sweep():
    turning = LATE.replace(speed=2 * math.pi * 40, sensor__runout=[
        {"order": 1, "amplitude": "3 um"}, {"order": 2, "amplitude": "2 um"}
    ])  # fmt: skip
    assert ambkit.assess_sweep(turning, "linear", amplitudes=[2e-6]).swept[0].deviation < 0.02


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"amplitudes": [0.0]}, "greater than 0 m"),
        ({"amplitudes": ["1 s"]}, "amplitude must be in m"),
        ({"kind": "noise"}, "multisine, stepped-sine"),
        ({"controller": PID(kp=100.0, ki=0.0, kd=1.0)}, "not stable"),
    ],
)
def test_what_cannot_be_swept_is_refused(options, message):
    with pytest.raises(AmbkitError, match=message):
        ambkit.assess_sweep(LATE, **options)


# ---- the experiment


def test_an_experiment_keeps_within_its_limits_and_tells_the_sensitivity():
    bearing = LATE.replace(sensor__hum=[{"frequency": "50 Hz", "amplitude": "1 um"}])
    loop = Scenario(duration=2.0)
    found = design_injection(bearing, loop, current="1.1 A", displacement="60 um")
    signal = Recorded(times=found.record.t.tolist(), values=found.added.tolist())
    for seed in range(20, 23):  # noises that it was not tried with
        record = ambkit.simulate(bearing, loop.replace(seed=seed, injection=signal)).record
        assert np.abs(record["iu"]).max() < 1.05 * 1.1
        assert np.abs(record["x"]).max() < 1.05 * 60e-6
    assert max(found.to_dict()["maximum_current"] / 1.1,
               found.to_dict()["maximum_displacement"] / 60e-6) > 0.8  # fmt: skip
    away = np.abs(found.excitation.frequencies - 50) * found.period
    assert away.min() > 1
    told = ambkit.assess_log(record, bearing, "linear")
    assert told.zone == "A"
    assert told.within["linear"] > 0.8 > told.within["measurement"]
    low, high = told.interval
    assert low <= told.model.loops["linear"].peak <= high
    assert told.measured.periods == found.periods - 1
    assert len(told.figure().panels) == 4
    assert len(found.figure().panels) == 3
    data = json.loads(json.dumps(told.to_dict()))
    assert data["models"]["linear"]["within"] == told.within["linear"]
    assert found.file()["injected"].max() == pytest.approx(found.amplitude, rel=0.3)


def test_a_zone_that_the_record_does_not_tell_is_reported_to_be_either():
    faint = ambkit.assess_log(measured(2e-6 * repeated(1000, 4)))
    assert faint.interval[1] > 3 > faint.interval[0]
    assert faint.zone in ("A or B", "A or C", "A or D")
    assert faint.model is None


def test_no_filter_in_the_loop_takes_the_signal_for_outliers():
    quiet = LATE.replace(sensor__noise_variance="0.01 um^2")
    found = design_injection(quiet, Scenario(duration=1.0))
    estimate = ambkit.KalmanFilter(quiet).run(found.record)
    assert np.mean(estimate.status & ambkit.Status.OUTLIER > 0) < 2e-3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"band": (1.0, 500.0)}, "the band must rise, from 5.2"),
        ({"band": (100.0, 101.0)}, "fewer than two lines"),
        ({"current": "0.1 A"}, "even without a signal"),
        ({"current": "9 A"}, "limit of the current must be"),
    ],
)
def test_what_cannot_be_designed_is_refused(options, message):
    with pytest.raises(AmbkitError, match=message):
        design_injection(LATE, Scenario(duration=2.0), **options)
