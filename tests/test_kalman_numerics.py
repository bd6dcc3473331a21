"""The filter in other units, in single precision, over ten million steps, for any parameters."""

import numpy as np
import pytest
from filter_cases import (
    BEARING,
    PRECISIONS,
    SETTINGS,
    START,
    STD,
    core_filter,
    full,
    least_correlation_eigenvalue,
    made,
    moving_record,
    off,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from ambkit import ClosedLaw
from ambkit.machine.magnets import core_module

# ---- other units, other precision, very long ----


def in_micrometres(s):
    """The same filter with lengths in um: N = kg m/s^2 makes the mass count in N s^2/um."""
    um = 1e6
    return s | {"m": s["m"] / um, "x_max": s["x_max"] * um, "var_y": s["var_y"] * um**2}


@pytest.mark.parametrize("adaptive", [False, True])
def test_metres_and_micrometres_give_one_answer(adaptive):
    """To 1e-12: nothing in the numerics knows an absolute size."""
    um, r, core = 1e6, moving_record(2.0), core_module()
    k, s0, i0 = 6.7e-6, 2e-3, 1.5
    if adaptive:
        in_m = core.Law("closed", k=k, s0=s0, i0=i0, two_sided=True, ampere=1.0, metre=1e-3)
        in_um = core.Law(
            "closed", k=k * um**2, s0=s0 * um, i0=i0, two_sided=True, ampere=1.0, metre=1e-3 * um
        )
        given_m = given_um = {}
    else:
        in_m, in_um = core.Constant(1, 1), core.Constant(1, 1)
        given_m = {"k_i": r["k_i"], "k_s": r["k_s"]}
        given_um = {"k_i": r["k_i"], "k_s": r["k_s"] / um}
    lengths = np.array([um, um, 1, um])
    small = made(core, "Kalman", in_m, SETTINGS)
    large = made(core, "Kalman", in_um, in_micrometres(SETTINGS))
    small.reset(START, STD)
    large.reset(START * lengths, STD * lengths)
    a = small.run(r["y"], r["u"], **given_m)
    b = large.run(r["y"] * um, r["u"], **given_um)
    assert off(a["mean"] * lengths, b["mean"]).max() < 1e-12
    np.testing.assert_allclose(a["variance"] * um**2, b["variance"], rtol=1e-12)
    assert (a["status"] == b["status"]).all()


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


@settings(max_examples=50)
@given(st.floats(-2, 2), st.floats(-2, 2), st.integers(0, 10**6))
def test_the_estimate_is_linear_in_what_it_is_given(a, b, seed):
    """With stiffnesses given, and no force besides: superposition."""
    s = SETTINGS | {
        "f_0": 0.0,
        "iu_min": -100.0,
        "iu_max": 100.0,
        "frozen_limit": 0,
        "outlier_limit": 0,
    }
    rng = np.random.default_rng(seed)
    n = 300
    k = rng.uniform(8, 12, n), rng.uniform(6e3, 3e4, n)
    y, u = rng.normal(0, 1e-5, (2, n)), rng.normal(0, 0.01, (2, n))

    def mean(y, u):
        kf = made(core_module(), "Kalman", core_module().Constant(1, 1), s)
        kf.reset(np.zeros(4), STD)
        return np.asarray(kf.run(y, u, *k)["mean"])

    parts = [mean(y[j], u[j]) for j in (0, 1)]
    together = mean(a * y[0] + b * y[1], a * u[0] + b * u[1])
    scale = sum(np.abs(p).max(axis=0) for p in parts)
    assert (np.abs(together - a * parts[0] - b * parts[1]) <= 1e-10 * scale).all()


def test_a_measurement_never_makes_the_estimate_less_certain():
    kf = core_filter(SETTINGS)
    rng = np.random.default_rng(0)
    for _ in range(200):
        kf.predict(0.5)
        before = kf.covariance
        kf.update(rng.normal(0, 1e-5))
        d = np.sqrt(np.diag(before))
        gained = (before - kf.covariance) / np.outer(d, d)
        assert np.linalg.eigvalsh(gained)[0] > -1e-12
        assert gained[3, 3] > 0.01
