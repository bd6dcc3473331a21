"""The filter on a factor: the same filter, and in single precision the better one."""

from functools import cache

import numpy as np
import oracles
import pytest
from filter_cases import (
    SETTINGS,
    START,
    STD,
    full,
    least_correlation_eigenvalue,
    made,
    moving_record,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import ambkit
from ambkit import ClosedLaw, Machine, Record, Scenario, Status, UDKalmanFilter
from ambkit.estimate.registry import KINDS
from ambkit.machine.magnets import core_module
from benchmarks import long_run

BEARING = Machine.preset("zittau_axial")


def textbook_udu(P):
    """U D U' by the definition, last column first (Bierman 1977)."""
    P, n = P.copy(), len(P)
    U, D = np.eye(n), np.zeros(n)
    for j in range(n - 1, -1, -1):
        D[j] = P[j, j]
        U[:j, j] = P[:j, j] / D[j]
        P[:j, :j] -= D[j] * np.outer(U[:j, j], U[:j, j])
    return U, D


def test_its_factor_is_that_of_the_textbook_s_covariance():
    k_i, k_s = 10.05, 7537.5
    core = core_module()
    kf = made(core, "UD", core.Constant(k_i, k_s), SETTINGS)
    kf.reset(START, STD)
    naive = oracles.Kalman(SETTINGS, START, STD)
    record = moving_record(0.1)
    y, u = record["y"], record["u"]
    for k in range(len(y)):
        if k:
            kf.predict(u[k - 1])
            naive.predict(k_i, k_s, u[k - 1])
        kf.update(y[k])
        naive.update(y[k])
        U, D = kf.factor
        np.testing.assert_allclose((U * D) @ U.T, kf.covariance, rtol=1e-13, atol=0)
        sigma = np.sqrt(np.diag(naive.P))
        assert (np.abs(kf.mean - naive.X) <= 1e-9 * sigma).all()
        assert (np.abs(kf.covariance - naive.P) <= 1e-9 * np.outer(sigma, sigma)).all()
    # By units of the states, or the definition itself loses its digits.
    U_naive, D_naive = textbook_udu(naive.P / np.outer(STD, STD))
    np.testing.assert_allclose(U * STD / STD[:, None], U_naive, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(D / STD**2, D_naive, rtol=1e-6)


def test_in_double_it_is_the_extended_filter():
    scenario = Scenario(
        duration=0.5,
        reference=ambkit.Step(amplitude=5e-4, time=0.1),
        disturbance=ambkit.Step(amplitude=3.0, time=0.3),
    )
    record = ambkit.simulate(BEARING, scenario).record
    plain = KINDS["extended"].make(BEARING).run(record, covariance=True)
    factored = KINDS["ud"].make(BEARING).run(record, covariance=True)
    sigma = np.sqrt(plain.covariance[:, [0, 4, 7, 9]])
    assert (np.abs(factored.mean - plain.mean) <= 1e-9 * sigma).all()
    wide = np.einsum("ki,kj->kij", sigma, sigma)
    assert (np.abs(full(factored.covariance) - full(plain.covariance)) <= 1e-9 * wide).all()
    assert (factored.status == plain.status).all()


# ---- hard on float ----


@cache
def after_an_outage(noise):
    """Half a second without a sensor, which then is sharper than float's digits reach."""
    sharp = BEARING.replace(sensor__noise_variance=noise**2)
    scenario = Scenario(duration=0.8, reference=ambkit.Sine(amplitude=3e-4, frequency=5.0))
    record = ambkit.simulate(sharp, scenario).record
    y = record["y"].copy()
    y[2000:7000] = np.nan
    broken = Record(record.t, {"y": y, "u": record["u"]})
    law = ClosedLaw(sharp)
    return {
        "exact": UDKalmanFilter(sharp, law).run(broken, covariance=True),
        "factored": UDKalmanFilter(sharp, law, precision="float32").run(broken, covariance=True),
        "plain": ambkit.ExtendedKalmanFilter(sharp, law, precision="float32").run(
            broken, covariance=True
        ),
    }


@pytest.mark.parametrize("noise", [1e-6, 1e-7, 1e-8, 1e-9])
def test_after_an_outage_a_sharp_sensor_is_believed_at_once(noise):
    """In standard deviations of the same filter in double, over the first 10 ms."""
    runs = after_an_outage(noise)
    assert runs["exact"].covariance is not None
    sigma = np.sqrt(runs["exact"].covariance[:, [0, 4, 7, 9]])

    def off(name):
        return float((np.abs(runs[name].mean - runs["exact"].mean) / sigma)[7001:7100].max())

    assert off("factored") < 0.02
    assert off("plain") > 20 * off("factored")
    assert not (runs["factored"].status & Status.BAD_VARIANCE).any()
    assert runs["factored"].covariance is not None
    for P in full(runs["factored"].covariance[7000:7100]):
        assert least_correlation_eigenvalue(P) > 0


@settings(max_examples=50)
@given(
    st.floats(-10, -3),
    st.floats(-4, 2),
    st.lists(st.one_of(st.floats(-1e-3, 1e-3), st.just(np.nan)), min_size=1, max_size=200),
)
def test_it_is_positive_definite_whatever_the_noise(log_noise, log_growth, y):
    core = core_module("float32")
    s = oracles.settings_of(BEARING, var_y=10 ** (2 * log_noise), var_d=10**log_growth)
    kf = made(core, "UD", core.Constant(10.05, 7537.5), s)
    kf.reset(START, STD)
    for sample in y:
        kf.step(sample, 0.3)
        _, D = kf.factor
        assert (D > 0).all()
        assert np.isfinite(D).all()
        assert np.isfinite(kf.mean).all()


# ---- long ----


def test_three_million_steps_in_single_precision():
    """The first of the billion of ``python -m benchmarks.long_run``."""
    seen = long_run.run(3_000_000, show=False)
    assert seen.steps == 3_000_000
    assert seen.kept
    assert seen.least_eigenvalue > 0
    assert seen.off < 0.1  # standard deviations, from the same filter in double
