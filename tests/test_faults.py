"""What goes wrong on a rig: the status says so, the state stays finite, the filter finds back."""

import numpy as np
import pytest
from filter_cases import full
from hypothesis import given, settings
from hypothesis import strategies as st

import ambkit
from ambkit import ClosedLaw, KalmanFilter, Machine, Record, Scenario, Status

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(
    BEARING,
    Scenario(
        duration=6.5,
        seed=2,
        reference=ambkit.Sine(amplitude=3e-4, frequency=2.0),
        disturbance=ambkit.Sine(amplitude=2.0, frequency=3.0),
    ),
).record
START = 3000  # Sample at which the trouble begins.

MAGNETS = {"linear": None, "closed law": ClosedLaw(BEARING)}
every_filter = pytest.mark.parametrize(
    ("magnet", "precision"),
    [(name, precision) for name in MAGNETS for precision in ("float64", "float32")],
)


def broken(n, **changes):
    """The record with n samples of y or u replaced; "frozen" repeats the last good one."""
    signals = {name: RECORD[name].copy() for name in ("y", "u")}
    for name, value in changes.items():
        last = signals[name][START - 1]
        signals[name][START : START + n] = last if value == "frozen" else value
    return Record(RECORD.t, signals)


def run(record, magnet, precision, **options):
    kf = KalmanFilter(BEARING, MAGNETS[magnet], precision=precision, **options)
    estimate = kf.run(record, covariance=True)
    assert np.isfinite(estimate.mean).all()
    assert np.isfinite(estimate.innovation_variance).all()
    return estimate


def samples_to_recover(estimate, end):
    """Samples after ``end`` until all states stay within what they are without any trouble.

    That is: six of the standard deviations that the settled filter believes in, and for the linear
    filter what its wrong stiffness adds to the disturbance force.
    """
    calm = KalmanFilter(BEARING, ClosedLaw(BEARING)).run(RECORD, covariance=True)
    late = 0
    for name in calm.names:
        room = 6 * calm.std(name)[-1] + (1.5 if name == "f_d" else 0.0)
        out = np.nonzero(np.abs(estimate[name] - RECORD[name])[end:] > room)[0]
        late = max(late, int(out[-1]) + 1 if out.size else 0)
    return late


# ---- measurements ----


@every_filter
@pytest.mark.parametrize(("n", "recovered_in"), [(1, 0), (20, 10), (200, 200)])
def test_missing_samples_are_flagged_and_bridged(magnet, precision, n, recovered_in):
    estimate = run(broken(n, y=np.nan), magnet, precision)
    missing = estimate.status == Status.MISSING
    assert np.flatnonzero(missing).tolist() == list(range(START, START + n))
    assert (estimate.innovation[missing] == 0).all()
    assert not estimate.used[missing].any()
    assert estimate.used[~missing].all()
    grown = estimate.std("x")
    assert (np.diff(grown[START - 1 : START + n]) > 0).all()  # it knows that it knows less
    assert samples_to_recover(estimate, START + n) <= recovered_in


@every_filter
def test_five_seconds_without_samples_end_in_3_ms(magnet, precision):
    """The unstable plant is predicted until its place is any between the stops: that is held."""
    n = 50_000
    estimate = run(broken(n, y=np.nan), magnet, precision)
    gone = estimate.status[START : START + n]
    assert (gone & Status.MISSING).all()
    held = (gone & Status.HELD) > 0
    first = int(np.argmax(held))
    assert 100 < first < 2000
    assert held[first:].all()
    assert (np.diff(estimate.mean[START + first : START + n], axis=0) == 0).all()
    assert estimate.std("x")[START + n - 1] == pytest.approx(BEARING.clearance, rel=1e-6)
    assert not estimate.status[START + n + 1 :].any()
    assert np.abs(estimate.x - RECORD["x"])[START + n :].max() < 1e-4
    assert np.abs(estimate.x - RECORD["x"])[START + n + 30 :].max() < 3e-5
    assert samples_to_recover(estimate, START + n) <= 200


@every_filter
def test_a_frozen_sensor_is_not_believed(magnet, precision):
    n = 300
    estimate = run(broken(n, y="frozen"), magnet, precision)
    frozen = (estimate.status & Status.FROZEN) > 0
    # The sample that is repeated was a good one; the tenth repetition is one too many.
    assert np.flatnonzero(frozen).tolist() == list(range(START + 9, START + n))
    assert samples_to_recover(estimate, START + n) <= 200
    believed = run(broken(n, y="frozen"), magnet, precision, frozen_limit=0)
    assert not (believed.status & Status.FROZEN).any()


@every_filter
@pytest.mark.parametrize("value", [0.0101, -1.0, 1e6, 1e30])
def test_what_cannot_be_the_rotor_counts_as_missing(magnet, precision, value):
    """Beyond ten clearances."""
    estimate = run(broken(3, y=value), magnet, precision)
    without = run(broken(3, y=np.nan), magnet, precision)
    assert (estimate.status == without.status).all()
    assert (estimate.mean == without.mean).all()


@every_filter
def test_a_spike_of_nine_travels_is_an_outlier(magnet, precision):
    """Just within what counts as a measurement: told, and left out."""
    estimate = run(broken(1, y=9e-3), magnet, precision)
    without = run(broken(1, y=np.nan), magnet, precision)
    assert estimate.status[START] & Status.OUTLIER
    assert not estimate.used[START]
    assert estimate.nis[START] > 1e5
    assert (estimate.mean == without.mean).all()
    assert samples_to_recover(estimate, START + 1) == 0
    believed = run(broken(1, y=9e-3), magnet, precision, outlier_limit=0)
    assert believed.status[START] == Status.OK
    assert 0 < samples_to_recover(believed, START + 1) <= 200


@every_filter
def test_after_three_outliers_the_measurement_is_believed(magnet, precision):
    """The rotor really is elsewhere, and then again: it is the estimate that was wrong."""
    estimate = run(broken(100, y=0.9e-3), magnet, precision, frozen_limit=0)
    outlier = np.flatnonzero(estimate.status & Status.OUTLIER)
    assert outlier[:3].tolist() == [START, START + 1, START + 2]
    assert np.flatnonzero(estimate.status & Status.RESTARTED)[0] == START + 3
    assert estimate.x[START + 3] == pytest.approx(0.9e-3, rel=1e-6)
    assert not estimate.status[START + 600 :].any()
    assert samples_to_recover(estimate, START + 100) <= 400


def test_a_record_without_one_good_sample_leaves_the_filter_whole():
    nothing = Record(RECORD.t[:5000], {"y": np.full(5000, np.nan), "u": RECORD["u"][:5000]})
    kf = KalmanFilter(BEARING)
    estimate = kf.run(nothing, covariance=True)
    assert (estimate.status & Status.MISSING).all()
    assert np.isfinite(estimate.mean).all()
    assert np.isfinite(kf.covariance).all()
    again, fresh = kf.run(RECORD), KalmanFilter(BEARING).run(RECORD)
    assert (again.mean == fresh.mean).all()


@pytest.mark.parametrize("first", [np.nan, 0.5, 2e-3])
def test_a_record_may_begin_with_nonsense(first):
    """Even with the place where the closed law has its pole, the air gap of 2 mm."""
    y = RECORD["y"].copy()
    y[0] = first
    estimate = run(Record(RECORD.t, {"y": y, "u": RECORD["u"]}), "closed law", "float64")
    assert samples_to_recover(estimate, 1) <= 300


def test_an_estimate_in_the_pole_of_the_law_stays_finite():
    kf = ambkit.AdaptiveKalmanFilter(BEARING, ClosedLaw(BEARING))
    kf.reset([2e-3, 0.0, 0.0, 2e-3])
    for k in range(START, START + 500):
        assert np.isfinite(kf.step(RECORD["y"][k], RECORD["u"][k - 1])).all()
        assert not kf.status & ~(Status.OUTLIER | Status.INCONSISTENT | Status.RESTARTED)
    assert kf.status == Status.OK
    assert kf.mean[0] == pytest.approx(RECORD["x"][START + 499], abs=3e-5)


@pytest.mark.parametrize("noise", [1e-7, 1e-8, 1e-9])
def test_in_single_precision_a_sharp_sensor_is_found_again(noise):
    """What is left of 1 mm of doubt beside 1 nm of noise, squared, is beyond float's digits."""
    sharp = BEARING.replace(sensor__noise_variance=noise**2)
    record = ambkit.simulate(
        sharp, Scenario(duration=1.0, reference=ambkit.Sine(amplitude=3e-4, frequency=5.0))
    ).record
    y = record["y"].copy()
    y[2000:7000] = np.nan
    kf = ambkit.AdaptiveKalmanFilter(sharp, ClosedLaw(sharp), precision="float32")
    estimate = kf.run(Record(record.t, {"y": y, "u": record["u"]}), covariance=True)
    assert np.isfinite(estimate.mean).all()
    assert (np.einsum("kii->ki", full(estimate.covariance)) > 0).all()
    assert ((estimate.status & Status.BAD_VARIANCE) > 0).sum() <= 3
    assert np.abs(estimate.x - record["x"])[7300:].max() < 2e-6


# ---- control signal ----


@every_filter
def test_a_missing_control_signal_is_replaced_by_the_last_good_one(magnet, precision):
    estimate = run(broken(100, u=np.nan), magnet, precision)
    held = run(broken(100, u="frozen"), magnet, precision)
    bad = (estimate.status & Status.BAD_CONTROL) > 0
    # u[k] acts from sample k to k + 1: it is missed one sample later.
    assert np.flatnonzero(bad).tolist() == list(range(START + 1, START + 101))
    assert (estimate.mean == held.mean).all()
    assert samples_to_recover(estimate, START + 101) <= 200


@every_filter
@pytest.mark.parametrize(("asked", "given_out"), [(1000.0, 1.5), (-1e30, -1.5)])
def test_a_current_beyond_its_limit_counts_as_the_limit(magnet, precision, asked, given_out):
    estimate = run(broken(100, u=asked), magnet, precision)
    limited = run(broken(100, u=given_out), magnet, precision)
    saturated = (estimate.status & Status.SATURATED) > 0
    assert np.flatnonzero(saturated).tolist() == list(range(START + 1, START + 101))
    assert (estimate.mean == limited.mean).all()
    expected = Status.OUTLIER | Status.INCONSISTENT | Status.RESTARTED
    assert not (limited.status & ~np.uint16(expected)).any()


def test_infinities_are_no_better_than_missing_samples():
    """A record holds none, but a step may meet them."""
    kf, other = KalmanFilter(BEARING), KalmanFilter(BEARING)
    for filter_ in (kf, other):
        filter_.step(1e-5, 0.5)
    assert (kf.step(np.inf, 0.5) == other.step(np.nan, 0.5)).all()
    assert kf.status == Status.MISSING
    assert (kf.step(2e-5, -np.inf) == other.step(2e-5, np.nan)).all()
    assert kf.status == Status.BAD_CONTROL
    kf.step(np.nan, np.nan)
    assert kf.status == Status.MISSING | Status.BAD_CONTROL
    assert np.isfinite(kf.covariance).all()


# ---- anything at all ----

rubbish = st.one_of(
    st.floats(),
    st.floats(-0.01, 0.01),
    st.sampled_from([np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 0.0, 2e-3]),
)


@settings(max_examples=100)
@given(st.lists(st.tuples(rubbish, rubbish), max_size=60), st.sampled_from(sorted(MAGNETS)))
def test_after_any_rubbish_the_filter_is_finite_and_finds_back_in_50_ms(trouble, magnet):
    kf = KalmanFilter(BEARING, MAGNETS[magnet])
    for y, u in trouble:
        assert np.isfinite(kf.step(y, u)).all()
        assert (np.diag(kf.covariance) > 0).all()
        assert np.isfinite(kf.covariance).all()
    y, u = RECORD["y"], RECORD["u"]
    for k in range(START, START + 500):
        kf.step(y[k], u[k - 1])
    assert kf.status == Status.OK
    assert kf.mean[0] == pytest.approx(RECORD["x"][START + 499], abs=3e-5)
