"""Estimators through faults: the harness says what happened, and all come back."""

import functools
import math

import numpy as np
import pytest

import ambkit
from ambkit import AmbkitError, KalmanFilter, Machine, Scenario, Sine, Status
from ambkit.control.control import Control
from ambkit.control.pid import PID
from ambkit.estimate.registry import KINDS
from ambkit.judge.faults import FAULTS, inject_faults
from ambkit.judge.faults.fault_run import Flight
from ambkit.judge.faults.fault_test import BASELINE, faults_figure, recovery_text
from ambkit.judge.faults.faults import CLEAN, Channel
from ambkit.result.report import Cells
from ambkit.simulation.external_inputs import ExternalInputs, Faults
from ambkit.simulation.run import simulate_run

PAPER = Machine.preset("zittau_axial")
BEARINGS = {
    "zittau_axial": PAPER,
    "inteco_ml": Machine.preset("inteco_ml"),
    "fast sensor": PAPER.replace(sensor__lag=20e-6, sensor__noise_variance=0.5e-6**2),
}
QUICK = ("lift-off", "knock", "outage-100ms", "outage-1s", "spikes", "rail", "greatest-y",
         "infinite-y", "nan-u", "overdriven", "long-saturation")  # fmt: skip
N = 400
MEASURED = Control(feedback="measurement")


def flown(estimator=None, *, beside=False, window=slice(100, 150), **series):
    """A short flight with these series of faults in the window."""
    faults = Faults.none(N, beside=beside)
    for name, values in series.items():
        getattr(faults, name)[window] = values
    scenario = Scenario(
        duration=(N - 1) * PAPER.sampling_time, seed=3, controller=MEASURED,
        reference=Sine(amplitude=1e-4, frequency=50.0),
    )  # fmt: skip
    return simulate_run(
        PAPER, scenario, estimator=estimator, external_inputs=ExternalInputs(faults=faults)
    )


# ---- faults in the loop ----


def test_a_loop_without_faults_is_the_plain_loop_to_the_last_bit():
    plain = ambkit.simulate(
        PAPER,
        Scenario(duration=(N - 1) * PAPER.sampling_time, seed=3, controller=MEASURED,
                 reference=Sine(amplitude=1e-4, frequency=50.0)),
    ).record  # fmt: skip
    for name in plain:
        np.testing.assert_array_equal(flown().record[name], plain[name])


@pytest.mark.parametrize("late", [0.25, 1.0, 2.5])
def test_a_late_measurement_lies_between_two_earlier_ones(late):
    true = flown().record["y"]
    y = flown(beside=True, late=late).record["y"]
    window = np.arange(100, 150)
    expected = np.interp(window - late, np.arange(N), true)
    np.testing.assert_allclose(y[window], expected, rtol=0, atol=1e-18)
    np.testing.assert_array_equal(np.delete(y, window), np.delete(true, window))


def test_a_delay_that_grows_with_time_is_a_stuck_sensor():
    y = flown(late=1.0 + np.arange(50)).record["y"]
    assert (y[100:150] == y[99]).all()
    assert y[150] != y[99]


def test_before_the_first_sample_there_is_the_first():
    y = flown(window=slice(0, 50), beside=True, late=7.0).record["y"]
    assert (y[:8] == y[0]).all()
    assert y[8] != y[0]


def test_beside_the_loop_the_rotor_does_not_notice():
    clean, beside = flown().record, flown(beside=True, y_times=0.0, y_plus=np.nan).record
    np.testing.assert_array_equal(beside["x"], clean["x"])
    assert np.isnan(beside["y"][100:150]).all()
    assert (flown(y_times=0.0, y_plus=1e-4).record["x"] != clean["x"]).any()


def test_the_estimator_is_told_what_the_amplifier_does_not_get():
    kf = ambkit.KalmanFilter(PAPER)
    run = flown(kf, u_times=0.0, u_plus=np.inf)
    told = np.flatnonzero(run.estimate.status & Status.BAD_CONTROL)
    assert told.tolist() == list(range(101, 151))
    assert np.isnan(run.record["u"][100:150]).all()
    np.testing.assert_array_equal(run.record["iu"], flown().record["iu"])


def test_an_amplifier_without_current_drops_the_rotor():
    run = flown(current=0.0)
    assert (run.record["iu"][100:150] == 0).all()
    assert run.record["x"][150] < flown().record["x"][150] - 1e-5


def test_series_of_the_wrong_length_are_refused():
    with pytest.raises(ValueError, match="external_inputs fault late must have 2 values"):
        ambkit.simulate(
            PAPER,
            Scenario(duration=PAPER.sampling_time),
            external_inputs=ExternalInputs(faults=Faults.none(3)),
        )


def test_who_lies_on_a_stop_is_found_there():
    scenario = Scenario(duration=0.01, controller=MEASURED)
    record = ambkit.simulate(PAPER, scenario, external_inputs=ExternalInputs(place=-1e-3)).record
    assert record["x"][0] == -1e-3
    assert record["y"][0] == pytest.approx(-1e-3, abs=6e-5)


# ---- what is said of a flight ----


def test_every_fault_is_felt():
    """Each changes what an estimator gets, or what the rotor does; the clean flight nothing."""
    flight = Flight(PAPER, PID.for_bearing(PAPER), in_loop=False, seed=1)
    for fault in (CLEAN, *FAULTS.values()):
        channel, (window,) = flight.through(fault)
        run = flight.fly(channel, None).record
        none = Channel(PAPER, channel.n, beside=True, seed=1)
        clean = flight.fly(none, None).record
        same = all(np.array_equal(run[s], clean[s], equal_nan=True) for s in ("y", "u", "x"))
        assert same == (fault is CLEAN), fault.name
        assert window.stop - window.start == fault.length(PAPER)


def test_a_filter_that_does_not_come_back_is_told():
    """A sensor with an offset that is not there in the clean flight, and never ends."""
    flight = Flight(PAPER, PID.for_bearing(PAPER), in_loop=False, seed=0)
    channel, windows = flight.through(CLEAN)
    clean = flight.fly(channel, ambkit.KalmanFilter(PAPER))
    band = flight.band(clean)
    assert flight.evaluate(clean, windows, band, fault="clean", estimator="linear").recovery == 0
    end = windows[0].stop
    channel.faults.y_plus[end:] = 2e-4
    run = flight.fly(channel, ambkit.KalmanFilter(PAPER))
    told = flight.evaluate(run, windows, band, fault="offset", estimator="linear")
    assert told.recovery == math.inf
    assert not told.recovered
    assert told.levitation == "kept"
    assert told.worst_x == pytest.approx(2e-4, rel=0.8)
    assert told.after_x == told.worst_x
    assert told.final_x > 10
    assert recovery_text([told]) == "never"
    channel.faults.y_plus[end:] = 0.0
    channel.faults.y_plus[end + 50 : end + 60] = 2e-4
    run = flight.fly(channel, ambkit.KalmanFilter(PAPER))
    told = flight.evaluate(run, windows, band, fault="offset", estimator="linear")
    assert 60 < told.recovery < 500


def test_a_rotor_that_is_lost_is_told():
    flight = Flight(PAPER, PID.for_bearing(PAPER), in_loop=True, seed=0)
    channel, windows = flight.through(CLEAN)
    band = flight.band(flight.fly(channel, ambkit.KalmanFilter(PAPER)))
    channel.faults.current[windows[0].stop :] = 0.0
    run = flight.fly(channel, ambkit.KalmanFilter(PAPER))
    told = flight.evaluate(run, windows, band, fault="weak", estimator="linear")
    assert told.levitation == "lost"
    assert told.at_stop > 0.5
    assert math.isnan(told.recovery)
    assert recovery_text([told]) == "lost"


@functools.cache
def small():
    return inject_faults(
        PAPER, ["linear", "low-pass"], faults=["outage-10ms", "rail"], steps=20_000
    )


def test_the_result_is_whole_and_repeats():
    found = small()
    assert found.estimators == ["linear", "low-pass"]
    assert found.faults == ["clean", "outage-10ms", "rail", "mixture"]
    # Each in four flights beside the loop and three in it, and the controller in those three.
    assert len(found.outcomes) == 2 * (4 + 3) + 3
    assert "17 runs with 4 faults" in repr(found)
    again = inject_faults(
        PAPER, ["linear", "low-pass"], faults=["outage-10ms", "rail"], steps=20_000, threads=1
    )
    assert str(again.to_dict()) == str(found.to_dict())
    assert found.slowest("linear") < 1000
    assert len(found.select(estimator=BASELINE)) == 3
    assert found.to_dict()["estimators"]["linear"]["recovered"]


def test_the_picture_has_a_row_for_each_fault_and_a_column_for_each_estimator():
    beside, in_loop = (panel.item(Cells) for panel in faults_figure(small()).panels)
    assert list(beside.rows) == ["clean", "outage-10ms", "rail", "mixture"]
    assert list(in_loop.rows) == ["clean", "outage-10ms", "mixture"]
    heads = [name.split("\n")[0] for name in in_loop.columns]
    assert heads == ["linear", "low", "measurement"]
    assert [name.split("\n")[0] for name in beside.columns] == heads[:2]  # no filter, no estimate
    assert beside.texts[0] == ["0", "0"]


# ---- the campaign ----


@functools.cache
def campaign(bearing, precision):
    return inject_faults(BEARINGS[bearing], faults=QUICK, steps=20_000, precisions=(precision,))


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("bearing", BEARINGS)
def test_every_estimator_comes_back_from_every_fault(bearing, precision, kind):
    found = campaign(bearing, precision)
    failed = [each for each in found.failures if each.estimator == kind]
    assert [(e.fault, e.setting, recovery_text([e])) for e in failed] == []
    # In the loop nobody loses a rotor that the controller alone would have kept.
    lost = {e.fault for e in found.select(estimator=kind, setting="closed loop", levitation="lost")}
    assert lost <= {e.fault for e in found.select(estimator=BASELINE, levitation="lost")}


# ---- a long saturation, and then rest ----


@pytest.mark.parametrize("kind", ["augmented", "multiple-model"])
@pytest.mark.parametrize(("times", "plus"), [(20.0, 0.0), (1.0, 3.0), (1.0, -3.0)])
def test_a_long_saturation_does_not_pass_for_a_weak_magnet(kind, times, plus):
    """The control signal is told far too large for three seconds of motion; then all is at rest."""
    T, moves = PAPER.sampling_time, 40
    reference = ambkit.Constant(value=0.0)
    for place in range(moves):
        size = 1e-4 * (1 if place == 0 else 2 if place % 2 == 0 else -2)
        reference = reference + ambkit.Step(amplitude=size, time=0.2 + 0.1 * place)
    reference = reference + ambkit.Step(amplitude=1e-4, time=0.2 + 0.1 * moves)
    n = round(6.0 / T) + 1
    faults = Faults.none(n, beside=True)
    faults.u_times[10_000:40_000], faults.u_plus[10_000:40_000] = times, plus
    scenario = Scenario(duration=(n - 1) * T, reference=reference, controller=MEASURED, seed=1)
    run = simulate_run(PAPER, scenario, estimator=KINDS[kind].make(PAPER),
                       external_inputs=ExternalInputs(faults=faults))  # fmt: skip
    estimate = run.estimate
    assert ((estimate.status[10_000:40_000] & Status.SATURATED) > 0).mean() > 0.9
    off = (estimate.f_d - run.record["f_d"])[-5000:]
    assert abs(off.mean()) < 0.5  # 3.6 N and 1.5 N where it was believed
    assert abs(estimate.scale[-1] - 1) < 0.1


def test_a_loop_with_faults_runs_in_one_go():
    """What is late would have to reach back into the stretch before."""
    from ambkit.simulation.run import Loop

    scenario = Scenario(duration=(N - 1) * PAPER.sampling_time, controller=MEASURED)
    loop = Loop(PAPER, scenario, external_inputs=ExternalInputs(faults=Faults.none(N)))
    with pytest.raises(ValueError, match="a loop with faults runs in one go; until must be None"):
        loop.run(until=0.01)
    assert len(loop.run().record) == N


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
