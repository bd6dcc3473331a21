"""Truth judges the filters over every sensor: the bound, raw sensor, a filter without magnet."""

import pytest
from quick import quick

from benchmarks import sensors


@pytest.mark.parametrize(("lag", "noise"), quick(sensors.SENSORS, sensors.SENSORS[::3]))
def test_the_extended_filter_reaches_the_bound(lag, noise):
    found = sensors.efficiency(lag, noise, runs=64)
    for name in ("x", "v", "f_d"):
        assert 0.98 <= found[name] < 1.02, found
    assert 0.93 < found["nees"] < 0.97, found


@pytest.mark.parametrize("seed", quick([3, 5, 6, 8, 12], [3]))
def test_no_kalman_filter_is_worse_than_a_naive_one(seed):
    """On sensible bearings drawn at random; 300 of them in benchmarks/README.md."""
    found = sensors.judged(seed)
    worst = max(sensors.KALMAN, key=found.ratio)
    assert found.ratio(worst) < 1.0, (worst, found)
