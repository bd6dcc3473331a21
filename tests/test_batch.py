"""Many runs side by side are the runs one by one, to the last bit, whatever happens in them."""

from typing import Any

import numpy as np
import pytest
from filter_cases import START, STD
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ambkit
from ambkit import ClosedLaw, FilterNoise, KalmanFilter, Machine, Status
from ambkit.estimate.batch import instruction_sets, run_many
from ambkit.estimate.registry import KINDS
from ambkit.machine.magnets import core_module

Array = NDArray[Any]

TWO_SIDED = Machine.preset("zittau_axial")
ONE_SIDED = TWO_SIDED.replace(magnet__type="one-sided", sensor__position_noise=-900.0)
RUNS, N = 19, 700  # no multiple of any number of lanes, nor of a block
HISTORY = ("mean", "innovation", "innovation_variance", "status")
SETS = instruction_sets()
PRECISIONS = ("float64", "float32")


def records(runs=RUNS, n=N):
    """Measurements and controls (runs, n) of a moving rotor, other noise in each run."""
    rng = np.random.default_rng(7)
    t = np.arange(n) * TWO_SIDED.sampling_time
    swing = 3e-4 * np.sin(2 * np.pi * (15 + 10 * np.arange(runs))[:, None] * t)
    y = swing + 1e-5 * rng.standard_normal((runs, n))
    u = 0.3 - 900 * swing + 0.01 * rng.standard_normal((runs, n))
    return y, u


def faulty(y, u):
    """The same with everything that is out of the ordinary, in most of the runs."""
    y, u = y.copy(), u.copy()
    runs, n = y.shape
    for run in range(runs):
        k = 50 + 7 * run
        if run % 8 == 0:
            y[run, k : k + 40] = np.nan
        if run % 8 == 1:
            y[run, k : k + 25] = y[run, k]
        if run % 8 == 2:
            u[run, k : k + 30] = 50.0
        if run % 8 == 3:
            u[run, k : k + 30] = np.inf
        if run % 8 == 4:
            y[run, k : k + 2] = 9e-4
            y[run, k + 20 : k + 40] = -9e-4
        if run % 8 == 5:
            y[run, :5] = np.nan
            y[run, k:] += 5e-5 * np.sign(np.sin(np.arange(n - k)))
        if run % 8 == 6:
            y[run, k:] = np.nan
    return y, u


def table():
    return ambkit.stiffness_map(TWO_SIDED)


def expert():
    return ambkit.Expert.from_map(ambkit.stiffness_map(TWO_SIDED))


CASES = {
    "low-pass": ("low-pass", None, TWO_SIDED),
    "low-pass, law": ("low-pass", ClosedLaw(TWO_SIDED), TWO_SIDED),
    "observer": ("observer", None, TWO_SIDED),
    "observer, table": ("observer", table, TWO_SIDED),
    "steady-state": ("steady-state", None, TWO_SIDED),
    "linear": ("linear", None, TWO_SIDED),
    "table": ("table", table, TWO_SIDED),
    "adaptive": ("adaptive", expert, TWO_SIDED),
    "closed-law": ("closed-law", None, TWO_SIDED),
    "closed-law, one-sided": ("closed-law", None, ONE_SIDED),
    "extended": ("extended", None, TWO_SIDED),
    "extended, one-sided": ("extended", None, ONE_SIDED),
    "extended, expert": ("extended", expert, TWO_SIDED),
}


def estimators_of(case, precision, runs=RUNS):
    """Estimators of one kind, each with its own noise and bearing."""
    name, magnet, bearing = CASES[case]
    if callable(magnet) and not isinstance(magnet, ClosedLaw):
        magnet = magnet()
    made = []
    for i in range(runs):
        one = bearing.replace(rotor__mass=bearing.rotor.mass * (1 + 0.02 * i))
        noise = FilterNoise(disturbance=10.0 ** (i % 5))
        made.append(KINDS[name].make(one, magnet, noise=noise, precision=precision))
    return made


def alone(estimator, y, u, start):
    """One run by the core's own loop."""
    estimator.reset(*start)
    real = np.dtype(estimator.precision)
    out = estimator.core.run(y.astype(real), u.astype(real))
    return {"mean": out["mean"], "innovation": out["innovation"],
            "innovation_variance": out["variance"], "status": out["status"]}  # fmt: skip


def assert_same(batch, run, expected):
    for name in HISTORY:
        got = getattr(batch, name)[run]
        assert got.dtype == expected[name].dtype
        np.testing.assert_array_equal(got, expected[name], err_msg=f"{name} of run {run}")
    assert batch.flags[run] == np.bitwise_or.reduce(expected["status"])


@pytest.mark.parametrize("every", [1, 4])
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("case", CASES)
def test_lanes_are_the_runs_one_by_one_faults_and_all(case, precision, every):
    y, u = faulty(*records())
    y[:, np.arange(N) % every != 0] = np.nan  # no run has a measurement there
    estimators = estimators_of(case, precision)
    start = np.tile(START, (RUNS, 1)), np.array([e.default_std() for e in estimators])
    expected = [alone(e, y[i], u[i], (start[0][i], start[1][i])) for i, e in enumerate(estimators)]
    told = np.bitwise_or.reduce([np.bitwise_or.reduce(one["status"]) for one in expected])
    usual = Status.MISSING | Status.SATURATED | Status.BAD_CONTROL
    usual |= Status.FROZEN if every == 1 else Status.OK
    assert Status(int(told)) & usual == usual
    for instructions in SETS:
        batch = run_many(
            estimators, y, u, start=start, history=HISTORY, instructions=instructions, threads=1
        )
        for i, one in enumerate(expected):
            assert_same(batch, i, one)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_outliers_and_surprises_are_reported_in_lanes(precision):
    y, u = faulty(*records())
    batch = run_many(estimators_of("linear", precision), y, u, history=HISTORY)
    told = Status(int(np.bitwise_or.reduce(batch.flags)))
    assert told & Status.OUTLIER
    assert told & Status.INCONSISTENT
    assert told & Status.HELD


@pytest.mark.parametrize("instructions", SETS)
@pytest.mark.parametrize("precision", PRECISIONS)
@given(
    runs=st.integers(1, 35),
    n=st.integers(1, 40),
    faults=st.lists(
        st.tuples(
            st.integers(0, 34),
            st.integers(0, 39),
            st.sampled_from([np.nan, np.inf, 0.0, 5e-4, 1e-2, 1e30]),
            st.booleans(),
        ),
        max_size=12,
    ),
)
@settings(max_examples=25, deadline=None)
def test_any_number_of_runs_and_samples(instructions, precision, runs, n, faults):
    y, u = (a.copy() for a in records(runs, n))
    for run, k, value, measured in faults:
        (y if measured else u)[run % runs, k % n] = value
    estimator = KalmanFilter(TWO_SIDED, precision=precision)
    batch = run_many(
        estimator, y, u, start=(START, STD), history=HISTORY, instructions=instructions
    )
    for i in range(runs):
        assert_same(batch, i, alone(estimator, y[i], u[i], (START, STD)))


@pytest.mark.parametrize("precision", PRECISIONS)
def test_kinds_may_be_mixed_and_threads_do_not_matter(precision):
    y, u = faulty(*records())
    u[np.isinf(u)] = np.nan  # which a record has not
    # All with the same states: that of a free rotor knows no force.
    kinds = [k for name, k in KINDS.items() if k.magnet and name != "constant-velocity"]
    estimators = [kinds[i % len(kinds)].make(TWO_SIDED, precision=precision) for i in range(RUNS)]
    one = run_many(estimators, y, u, history=HISTORY, threads=1)
    many = run_many(estimators, y, u, history=HISTORY, threads=5)
    for name in (*HISTORY, "flags"):
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
    for i, e in enumerate(estimators):
        record = ambkit.Record(np.arange(N) * TWO_SIDED.sampling_time, {"y": y[i], "u": u[i]})
        np.testing.assert_array_equal(one.mean[i], e.run(record).mean)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("skip", [0, 1, 333])
def test_errors_are_those_of_the_history(precision, skip):
    y, u = records()
    truth = np.random.default_rng(1).normal(scale=[1e-4, 0.1, 1.0], size=(RUNS, N, 3))
    estimators = estimators_of("linear", precision)
    rmse = []
    for instructions in SETS:
        batch = run_many(estimators, y, u, truth=truth, skip=skip, instructions=instructions)
        error = batch.mean[:, skip:, :3] - truth[:, skip:]
        tight = 1e-13 if precision == "float64" else 1e-5
        np.testing.assert_allclose(batch.rmse, np.sqrt((error**2).mean(axis=1)), rtol=tight)
        bare = run_many(
            estimators, y, u, truth=truth, skip=skip, history=(), instructions=instructions
        )
        assert bare.mean is None
        np.testing.assert_array_equal(bare.rmse, batch.rmse)
        rmse.append(batch.rmse)
    assert all((r == rmse[0]).all() for r in rmse)


def test_one_record_serves_all_estimators_and_one_estimator_all_records():
    y, u = records()
    estimators = estimators_of("linear", "float64")
    batch = run_many(estimators, y[3], u[3])
    whole = run_many(estimators, np.tile(y[3], (RUNS, 1)), np.tile(u[3], (RUNS, 1)))
    np.testing.assert_array_equal(batch.mean, whole.mean)
    one = KalmanFilter(TWO_SIDED)
    before = one.mean
    np.testing.assert_array_equal(run_many(one, y, u).mean, run_many([one] * RUNS, y, u).mean)
    np.testing.assert_array_equal(one.mean, before)


def test_arrays_are_written_again():
    y, u = records()
    one = KalmanFilter(TWO_SIDED)
    first = run_many(one, y, u)
    kept = first.mean
    expected = kept.copy()
    kept[:] = 0
    assert run_many(one, y, u, out=first).mean is kept
    np.testing.assert_array_equal(kept, expected)
    assert run_many(one, y[:, :5], u[:, :5], out=first).mean is not kept


def test_what_does_not_fit_is_reported():
    y, u = records(4, 10)
    one = KalmanFilter(TWO_SIDED)
    for wrong, told in (
        (lambda: run_many([], y, u), "one or more"),
        (lambda: run_many([one] * 3, y, u), "estimators must be 1 or 4"),
        (lambda: run_many(one, y, u[:3]), "3 rows for 4 runs"),
        (lambda: run_many(one, y, u[:, :9]), "u has 9 samples, expected 10"),
        (lambda: run_many(one, y, u, truth=np.zeros((4, 10, 4))), r"truth must be \(runs, n, 3\)"),
        (lambda: run_many(one, y, u, skip=10), "skip must be within the 10 samples"),
        (lambda: run_many(one, y, u, history=("colour",)), "history knows mean, .*; got colour"),
        (lambda: run_many(one, y, u, instructions="mmx"), "no instructions called 'mmx'"),
        (lambda: run_many(one, y, u, threads=0), "threads must be 1 or more, got 0"),
        (lambda: run_many(one, y, u, start=(START, 0 * STD)), "std finite and positive"),
        (lambda: run_many([one, KalmanFilter(TWO_SIDED, precision="float32")], y, u), "precision"),
    ):
        with pytest.raises(ValueError, match=told):
            wrong()


def test_scalar_and_baseline_are_everywhere():
    assert SETS[:2] == ["scalar", "baseline"]  # with GCC or clang, as built here
    assert core_module("float32").instruction_sets() == SETS


def test_a_step_returns_an_array_of_its_own():
    kf = KalmanFilter(TWO_SIDED)
    first = kf.step(1e-5, 0.1)
    kept = first.copy()
    second = kf.step(2e-5, 0.1)
    assert (first == kept).all()
    assert (second != first).any()
    assert (kf.core.live_mean == second).all()
    with pytest.raises(ValueError, match="read-only"):
        kf.core.live_mean[0] = 1.0
