"""The rate of a clock comes from all of its stamps: jitter, few digits and gaps do not move it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambkit.data.reading.clock import even_grid, examine, resample


def even(n, step):
    return step * np.arange(n)


def test_jitter_does_not_move_the_rate():
    """20001 stamps over 2 s, each 3 µs off: by the steps near their median it was 10.014 kHz."""
    rng = np.random.default_rng(3)
    times = np.round(even(20001, 1e-4) + 3e-6 * rng.normal(size=20001), 6)
    clock = examine("t", times)
    assert clock.rate == pytest.approx(10e3, rel=3e-6)
    assert clock.jitter == pytest.approx(np.sqrt(2) * 3e-6, rel=0.05)
    assert clock.gaps.size == clock.jumps.size == 0
    assert even_grid(clock, clock.step).size == 20001


@given(
    seed=st.integers(0, 999),
    jitter=st.floats(0, 0.14),
    lost=st.sets(st.integers(1, 38), max_size=6),
    step=st.floats(1e-5, 10),
)
def test_jitter_missing_rows_and_duplicates_do_not_move_the_rate(seed, jitter, lost, step):
    rng = np.random.default_rng(seed)
    n = 2000
    times = even(n, step) + step * np.clip(jitter * rng.normal(size=n), -0.4, 0.4)
    kept = np.array([k for k in range(n) if k not in {25 * each for each in lost}])
    clock = examine("t", np.repeat(times[kept], np.where(kept == 1003, 2, 1)))
    assert clock.step == pytest.approx(step, rel=3e-3)
    if jitter < 0.05:
        assert clock.missing.tolist() == [1] * len(lost)
    assert clock.jumps.size == 1  # the duplicate


def test_a_late_stamp_is_no_gap_and_a_gap_in_jitter_is_one():
    times = even(1000, 1e-3) + 1e-4 * np.random.default_rng(0).normal(size=1000)
    times[500] += 0.7e-3
    clock = examine("t", np.delete(times, [200, 201, 700]))
    assert clock.gaps.tolist() == [200, 698]
    assert clock.missing.tolist() == [2, 1]
    assert 498 in clock.uneven


@pytest.mark.parametrize("step", [1.05, 1.25, 1.3, 1.4, 1.6, 2.4, 3.35, 7.77])
@pytest.mark.parametrize("gap", [0, 30])
def test_stamps_rounded_to_milliseconds(step, gap):
    times = np.round(even(5000, step)) * 1e-3
    if gap:
        times = np.delete(times, slice(2000, 2000 + gap))
    clock = examine("t", times)
    assert clock.step == pytest.approx(step * 1e-3, rel=2e-4)
    assert clock.missing.tolist() == ([gap] if gap else [])
    resampled = resample(times, clock, even_grid(clock, clock.step), held=False)
    assert abs(np.isnan(resampled).sum() - gap) <= 2


def test_what_is_held_lasts_for_one_step_after_the_last_sample():
    clock = examine("t", even(10, 1e-3))
    times = clock.times[-1] + 1e-3 * np.array([-0.5, 0.0, 0.5, 1.5])
    values = np.arange(10.0)
    held = resample(values, clock, times, held=True)
    np.testing.assert_array_equal(held, [8.0, 9.0, 9.0, np.nan])
    np.testing.assert_allclose(resample(values, clock, times, held=False), [8.5, 9, *2 * [np.nan]])


def test_each_tenth_row_lost_is_no_rounding():
    clock = examine("t", np.delete(even(5000, 1e-3), slice(5, None, 10)))
    assert clock.gaps.size == 500
    assert clock.rate == pytest.approx(1000)


def test_a_jump_does_not_move_the_rate():
    times = even(3000, 1e-3) + 1e-5 * np.random.default_rng(0).normal(size=3000)
    times[1000:] -= 0.5
    times[2000:] += 1e4
    clock = examine("t", times)
    assert clock.jumps.tolist() == [1000, 2000]
    assert clock.rate == pytest.approx(1000, rel=1e-4)
