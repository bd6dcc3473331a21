"""The filter in other units, in single precision, over ten million steps, for any parameters."""

import numpy as np
import pytest
from filter_cases import (
    BEARING,
    PRECISIONS,
    SETTINGS,
    core_filter,
    full,
    least_correlation_eigenvalue,
    made,
    moving_record,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from ambkit import ClosedLaw
from ambkit.machine.magnets import core_module

# ---- other units, other precision, very long ----


@pytest.mark.parametrize("adaptive", [False, True])
def test_single_precision_stays_within_a_thousandth_of_the_standard_deviation(adaptive):
    r = moving_record(5.0)
    given_k = {} if adaptive else {"k_i": r["k_i"], "k_s": r["k_s"]}
    runs = {}
    for precision in PRECISIONS:
        magnet = ClosedLaw(BEARING).in_core(core_module(precision))
        kf = core_filter(SETTINGS, precision, magnet)
        runs[precision] = kf.run(r["y"], r["u"], **given_k, covariance=True)
    assert runs["float32"]["mean"].dtype == np.float32
    std = np.sqrt(np.einsum("kii->ki", full(runs["float64"]["covariance"])))
    difference = np.abs(runs["float32"]["mean"] - runs["float64"]["mean"]) / std
    assert difference.max(axis=0).max() < 1e-3
    np.testing.assert_allclose(runs["float32"]["variance"], runs["float64"]["variance"], rtol=1e-5)


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_covariance_is_positive_definite_after_ten_million_steps(precision):
    r = moving_record(10.0)
    n = 100_000
    part = {name: values[:n].astype(precision) for name, values in r.items()}
    kf = core_filter(SETTINGS | {"outlier_limit": 0}, precision)  # the records do not join
    settled = []
    for _ in range(100):
        status = kf.run(**part)["status"]
        assert not (status & core_module().BAD_VARIANCE).any()
        settled.append(kf.covariance)
        assert least_correlation_eigenvalue(settled[-1]) > 2e-6
    # It has not crept: the same record leaves the same covariance each time.
    np.testing.assert_allclose(
        settled[-1], settled[1], rtol=1e-9 if precision == "float64" else 1e-3
    )


# ---- for any sane parameters ----


@st.composite
def sane_settings(draw):
    """Magnitudes from micro-bearings to large ones; noise from none to coarse."""
    power = lambda low, high: 10 ** draw(st.floats(low, high))  # noqa: E731
    T, m = power(-5, -3), power(-3, 2)
    x_max = power(-4, -2)
    return SETTINGS | {
        "T": T, "m": m, "x_max": x_max, "K_sen": power(-1, 1), "T_sen": T * power(-2, 2),
        "k_ui": power(-1, 1), "f_0": draw(st.floats(-20, 20)) * m,
        "var_u": draw(st.sampled_from([0.0, 1e-8, 1e-4])), "var_d": (m * power(-3, 2)) ** 2 * T,
        "var_y": (x_max * power(-5, -2)) ** 2, "iu_min": -1e3, "iu_max": 1e3, "frozen_limit": 0,
        "gate": 8.0, "outlier_limit": 0,
    }  # fmt: skip


@settings(max_examples=150)
@given(sane_settings(), st.floats(0.001, 0.3), st.integers(0, 10**6))
def test_the_covariance_stays_positive_definite(s, stiffness, seed):
    """k_s up to where the plant runs away by a third in a sample; y anywhere in the travel."""
    rng = np.random.default_rng(seed)
    n = 500
    k_s = s["m"] * (stiffness / s["T"]) ** 2 * rng.uniform(0.3, 1, n)
    k_i = k_s * s["x_max"]
    y = s["K_sen"] * s["x_max"] * rng.uniform(-0.1, 0.1, n)
    kf = made(core_module(), "Kalman", core_module().Constant(1, 1), s)
    speed = s["x_max"] * stiffness / s["T"]
    std = [0.1 * s["x_max"], speed, 10 * s["m"], 0.1 * s["x_max"] * s["K_sen"]]
    kf.reset(np.zeros(4), np.array(std))
    out = kf.run(y, rng.uniform(-1, 1, n), k_i, k_s, covariance=True)
    assert np.isfinite(out["mean"]).all()
    assert not (out["status"] & core_module().BAD_VARIANCE).any()
    P = full(out["covariance"])
    d = np.sqrt(np.einsum("kii->ki", P))
    assert np.isfinite(d).all()
    # A sharp sensor makes it nearly singular: of its 16 digits at least seven are kept.
    least = np.linalg.eigvalsh(P / np.einsum("ki,kj->kij", d, d)).min()
    assert least > -1e-7
    assert (kf.covariance == kf.covariance.T).all()
