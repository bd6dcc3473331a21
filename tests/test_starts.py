"""From anywhere back to the rotor: random starts, lift-off, outages, spikes and gaps."""

import numpy as np
import pytest

import ambkit
from ambkit import Machine, Record, Scenario, Status
from ambkit.estimate.registry import KINDS
from benchmarks import starts

BEARING = Machine.preset("zittau_axial")
RECORD = ambkit.simulate(
    BEARING, Scenario(duration=2.5, seed=4, reference=ambkit.Sine(amplitude=3e-4, frequency=3.0))
).record
PRECISIONS = ("float64", "float32")
every_kind = pytest.mark.parametrize("kind", starts.kinds())
both = pytest.mark.parametrize("precision", PRECISIONS)


@every_kind
@both
def test_random_starts_end_at_the_rotor(kind, precision):
    """Within 50 ms: by its own standard deviations, not held, as sure as after a long run."""
    assert starts.campaign(kind, precision, 150, seed=11) == []


@every_kind
@both
def test_the_start_that_stood_still_for_ever(kind, precision):
    for std in ([1.01e-3, 1, 10, 1e-3], [2e-4, 10, 10, 1e-3], "diffuse"):
        kf = KINDS[kind].make(BEARING, precision=precision)
        kf.reset([0, 0, 0, 0], std)
        out = kf.core.run(*(RECORD[n][5000:5500].astype(precision) for n in ("y", "u")))
        assert not out["status"][-1] & (Status.HELD | Status.RESTARTED)
        assert abs(out["mean"][-1][0] - RECORD["x"][5499]) < 3e-5


@pytest.mark.parametrize("kind", KINDS)
@both
@pytest.mark.parametrize("first", [10, 100, 1000, 10_000])
def test_after_an_outage_with_spikes_and_gaps_it_is_back(kind, precision, first):
    if KINDS[kind].magnet is None:
        pytest.skip("its magnet is made elsewhere; it is the closed law's filter otherwise")
    y = RECORD["y"].copy()
    end = 5000 + first
    y[5000:end] = np.nan
    y[end - 7 : end : 2] = 0.9e-3
    y[end + 5 : end + 25 : 5] = np.nan
    kf = KINDS[kind].make(BEARING, precision=precision)
    estimate = kf.run(Record(RECORD.t, {"y": y, "u": RECORD["u"]}))
    assert np.isfinite(estimate.mean).all()
    late = slice(end + 2000, end + 3000)
    assert np.abs(estimate.x - RECORD["x"])[late].max() < 4e-5


@every_kind
@both
def test_a_first_measurement_that_is_a_spike(kind, precision):
    y = RECORD["y"].copy()
    y[0] = -0.95e-3
    estimate = (
        KINDS[kind]
        .make(BEARING, precision=precision)
        .run(Record(RECORD.t, {"y": y, "u": RECORD["u"]}))
    )
    assert np.abs(estimate.x - RECORD["x"])[100:].max() < 5e-5


@pytest.mark.parametrize("name", ["observer", "steady-state"])
@pytest.mark.parametrize("lag", [2e-4, 2e-5])
@both
def test_an_observer_that_saw_the_clearance_comes_back(name, lag, precision):
    """The paper's rig, and a sensor much faster than a sample."""
    bearing = BEARING.replace(sensor__lag=lag)
    record = ambkit.simulate(bearing, Scenario(duration=1.0, seed=2)).record
    y = record["y"].copy()
    limit = bearing.clearance
    y[3000:3100] = limit + np.random.default_rng(0).normal(0, 1e-6, 100)
    estimate = (
        KINDS[name]
        .make(bearing, precision=precision)
        .run(Record(record.t, {"y": y, "u": record["u"]}))
    )
    assert np.isfinite(estimate.mean).all()
    assert np.abs(estimate.mean[:, 0]).max() < 100 * limit
    assert np.abs(estimate.x - record["x"])[4000:].max() < 4e-5


def test_a_start_that_is_none_is_refused():
    kf = ambkit.KalmanFilter(BEARING)
    with pytest.raises(ValueError, match="'diffuse', got 'wide'"):
        kf.reset(std="wide")


def test_the_start_is_rounded_as_in_the_exported_c():
    """The C divides the first reading by the gain in its own precision."""
    gain = 1.07
    bearing = Machine.preset("zittau_axial").replace(sensor__gain=gain)
    y = np.random.default_rng(0).uniform(-2e-4, 2e-4, 200)
    single = ambkit.KalmanFilter(bearing, precision="float32")
    expected = y.astype(np.float32) / np.float32(gain)
    assert [single.initial_state(np.array([one]))[0] for one in y] == expected.tolist()
    double = ambkit.KalmanFilter(bearing)
    assert [double.initial_state(np.array([one]))[0] for one in y] == (y / gain).tolist()
