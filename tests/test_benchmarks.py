"""Everyone in benchmarks/ does the same work: each reproduces the estimates of the hand loop.

Nothing is timed here. How fast they are is measured by ``python -m benchmarks``.
"""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import ambkit
from benchmarks import batch, entries, many_loops, report
from benchmarks.batch import Many
from benchmarks.closed_loop import ClosedLoop
from benchmarks.entries import Entry
from benchmarks.hand import HandLoop, Outputs
from benchmarks.many_loops import Loops
from benchmarks.timing import Times, interleaved
from benchmarks.work import NOISE, Work

Array = NDArray[np.float64]

SAMPLES, FEW = 3000, 1000
# Of each state's largest value: the same mathematics in another order of operations.
ROUNDING = 1e-11
# Single precision, of each state's standard deviation.
SINGLE = 1e-3


@pytest.fixture(scope="module")
def work():
    return Work.simulated(SAMPLES)


@pytest.fixture(scope="module")
def hand():
    loop = HandLoop()
    return lambda work: loop(work, Outputs.empty(work.y.size))


@pytest.fixture(scope="module")
def loop(work):
    return ClosedLoop.of(work)


@pytest.fixture(scope="module")
def expert(work):
    return ambkit.Expert.from_map(ambkit.stiffness_map(work.bearing))


def by_hand(hand, work, kf):
    """The hand loop with the stiffnesses that `kf` chooses along the record."""
    chosen = kf.run(work.record)
    # The hand loop takes k[k - 1] at sample k, where the estimate has what it took at k.
    k_i, k_s = (np.append(a[1:], a[-1]) for a in (chosen.k_i, chosen.k_s))
    return hand(replace(work, k_i=k_i, k_s=k_s))


def assert_close(means, expected, scale):
    means = np.asarray(means)
    np.testing.assert_array_less(np.abs(means - expected[: len(means)]) / scale, 1.0)


def assert_same(entry, expected):
    """Within rounding, or within a part of the standard deviation in single precision."""
    means = np.asarray(entry.run())
    assert means.shape == (entry.samples, 4)
    assert_close(means, expected, ROUNDING * np.max(np.abs(expected), axis=0))


def assert_nearly_same(entry, expected, kf):
    assert_close(entry.run(), expected, SINGLE * np.sqrt(np.diag(kf.core.covariance)))


def test_core_does_the_work_of_the_hand_loop(work, hand):
    expected = hand(work)
    *double, single = entries.in_c(work)
    assert [entry.name for entry in double] == [entries.HAND, entries.HAND_NEW, entries.GIVEN]
    for entry in double:
        assert_same(entry, expected)
    kf = ambkit.KalmanFilter(work.bearing, noise=NOISE)
    kf.run(work.record)
    assert_nearly_same(single, expected, kf)


def test_the_stiffnesses_of_the_work_are_new_at_each_sample(work):
    assert np.all(np.diff(work.k_i) != 0)
    assert np.all(np.diff(work.k_s) != 0)


@pytest.mark.long
def test_numba_does_the_work_of_the_hand_loop(work, hand):
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    for entry in entries.in_numba(work):
        assert_same(entry, hand(work))


def test_numpy_and_filterpy_do_the_work_of_the_hand_loop(work, hand):
    for entry in entries.in_python(work, FEW):
        assert entry.samples == FEW
        assert_same(entry, hand(work)[:FEW])


def test_public_linear_filter_does_the_work_of_the_hand_loop(work, hand):
    expected = by_hand(hand, work, ambkit.KalmanFilter(work.bearing, noise=NOISE))
    for entry in entries.constant(work, FEW):
        assert_same(entry, expected[: entry.samples])


def test_adaptive_filters_do_the_work_of_the_hand_loop(work, hand, expert):
    *double, single = entries.adaptive(work, expert)
    law, table = ambkit.ClosedLaw(work.bearing), ambkit.stiffness_map(work.bearing)
    magnets = (law, table, expert)
    for entry, magnet in zip(double, magnets, strict=True):
        kf = ambkit.AdaptiveKalmanFilter(work.bearing, magnet, noise=NOISE)
        expected = by_hand(hand, work, kf)
        assert_same(entry, expected)
    assert_nearly_same(single, expected, kf)


def test_rules_in_numba_are_the_rules_of_the_expert(work, hand, expert):
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    kf = ambkit.AdaptiveKalmanFilter(work.bearing, expert, noise=NOISE)
    (entry,) = entries.rules_in_numba(work, expert)
    assert_same(entry, by_hand(hand, work, kf))


def test_numba_by_sample_does_the_work_of_the_public_step(work):
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    public = entries.constant(work, FEW)[1]
    (entry,) = entries.numba_by_sample(work, FEW)
    expected = np.asarray(public.run())
    assert_same(entry, expected)


def test_nonlinear_filters_take_part_under_their_names(work):
    names = [entry.name for entry in entries.nonlinear(work)]
    assert names == [entries.EXTENDED, entries.UNSCENTED]
    for entry in entries.nonlinear(work):
        assert np.isfinite(np.asarray(entry.run())).all()


def test_many_filters_do_the_work_of_the_hand_loop(work):
    many = Many.of(work, runs=5, samples=400)
    (hand,) = batch.by_hand(many)
    expected = np.asarray(hand.run())
    scale = ROUNDING * np.max(np.abs(expected), axis=0)
    errors, *means = batch.side_by_side(many)
    assert (errors.name, means[0].name) == (batch.ERRORS, batch.MEANS)
    for entry in means:
        assert_close(entry.run(), expected, scale)
    truth = np.sqrt(np.mean((expected[:, :3] - many.truth) ** 2, axis=0))
    np.testing.assert_allclose(np.asarray(errors.run())[-1], truth, rtol=1e-9)


def test_numba_in_parallel_does_the_work_of_the_hand_loop(work):
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    many = Many.of(work, runs=3, samples=300)
    expected = np.asarray(batch.by_hand(many)[0].run())
    for entry in batch.numba_parallel(many):
        assert_close(entry.run(), expected, ROUNDING * np.max(np.abs(expected), axis=0))


@pytest.mark.filterwarnings("ignore")  # libraries of others, and not those of the tests
def test_libraries_do_the_work_of_the_hand_loop(work):
    many = Many.of(work, runs=3, samples=300)
    expected = np.asarray(batch.by_hand(many)[0].run())
    found, missing = batch.libraries(many, runs=3, samples=300)
    assert len(found) + len(missing) == 3
    for entry in found:
        assert_close(entry.run(), expected, 1e-8 * np.max(np.abs(expected), axis=0))


def test_estimates_in_the_loop_are_those_of_the_hand_loop(loop, work, hand):
    out = loop.core_run()
    k = ambkit.ConstantStiffness.of(loop.bearing)
    loop.filter.reset()
    along = replace(
        work,
        y=out["y"],
        u=out["u"],
        k_i=np.full(SAMPLES, k.k_i),
        k_s=np.full(SAMPLES, k.k_s),
        mean=loop.filter.mean,
        cov=loop.filter.core.covariance,
    )
    bare, public = entries.loops(loop)
    assert_same(bare, hand(along))
    assert np.shape(public.run()) == (public.samples, 4)


def test_public_simulation_is_the_same_loop(loop):
    # The same run without noise, so that what ambkit.simulate draws does not matter.
    quiet = np.zeros(SAMPLES)
    scenario = loop.scenario.replace(noise=False)
    record = ambkit.simulate(loop.bearing, scenario, filter=loop.filter).record
    bare = replace(loop, noise_u=quiet, noise_y=quiet).core_run()
    for name in ("x", "v", "x_m", "iu", "y", "u"):
        scale = np.max(np.abs(record[name]))
        np.testing.assert_allclose(bare[name], record[name], rtol=0, atol=1e-9 * scale)


def test_loops_in_numba_are_the_loop_in_c(loop):
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    from benchmarks import numba_loop

    out = loop.core_run()
    for step in (numba_loop.TEXTBOOK, numba_loop.ARRANGED):
        signals, _, cov, touched = numba_loop.run(loop, step)
        for name, signal in zip(("x", "v", "x_m", "y", "u", "iu", "force"), signals, strict=True):
            assert_close(signal, out[name], ROUNDING * np.max(np.abs(out[name])))
        assert_close(cov, out["estimate"]["covariance"], ROUNDING * np.max(np.abs(cov), axis=0))
        assert touched == out["at_stop"].sum()
    for entry in entries.loops_in_numba(loop):
        assert_same(entry, np.asarray(out["estimate"]["mean"]))


def test_every_entry_runs_in_every_round():
    calls = []

    def entry(name):
        def run():
            calls.append(name)
            return []

        return Entry(name, 1, run)

    times = interleaved([entry("a"), entry("b")], rounds=2)
    assert calls == ["a", "a", "b", "b"] * 2  # each untimed first
    assert [t.entry.name for t in times] == ["a", "b"]
    assert all(len(t.rounds) == 2 and t.typical > 0 for t in times)


def test_ratios_are_taken_within_a_round():
    slow, fast = (Times(Entry(n, 1, list), t) for n, t in (("s", (2.0, 40.0)), ("f", (1.0, 10.0))))
    assert slow.ratios(fast) == [2.0, 4.0]
    limit = report.Limit("s", slow, (slow, fast), most=3.0)
    assert (limit.measured, limit.kept) == (3.0, True)
    assert not report.Limit("s", slow, (slow, fast), most=2.9).kept


def test_only_what_is_between_the_markers_is_written(tmp_path, monkeypatch):
    readme = tmp_path / "README.md"
    text = report.README.read_text(encoding="utf-8")
    readme.write_text(text, encoding="utf-8")
    monkeypatch.setattr(report, "README", readme)
    report.write("| new |")
    before, after = text.split(report.BEGIN)[0], text.split(report.END)[1]
    assert readme.read_text(encoding="utf-8") == (
        f"{before}{report.BEGIN}\n| new |\n{report.END}{after}"
    )


def test_many_closed_loops_have_the_same_errors(work):
    """With the same noise; ambkit's alike to the last bit, numba's but for rounding."""
    pytest.importorskip("numba", reason="numba is in the dependency group benchmarks")
    loops = Loops.of(work, many_loops.FEW, 300)
    one, every = (np.asarray(entry.run()) for entry in many_loops.side_by_side(loops))
    assert (one == every).all()
    others = [*many_loops.numba_parallel(loops), *many_loops.one_by_one(loops)]
    for entry in others:
        np.testing.assert_allclose(np.asarray(entry.run()), one, rtol=1e-9)
