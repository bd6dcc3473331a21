"""The sampled model: exact with the force held, for any sensor, in both precisions."""

import mpmath as mp
import numpy as np
import oracles
import pytest
from filter_cases import BEARING, PRECISIONS, SETTINGS, STD, made, step_matrices
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import ambkit
from ambkit import ClosedLaw, FilterNoise
from ambkit.machine.magnets import core_module

# ---- the functions phi ----

PHI = 6.0
"""Machine epsilons by which a value may be wrong: what is lost from z = 1 on, in three steps."""


def exact_phi(k, z):
    """By its integral over the exponential, in as many digits as the cancellation takes."""
    with mp.workdps(60):
        value = mp.exp(-mp.mpf(z))
        for j in range(k):
            value = (1 / mp.factorial(j) - value) / mp.mpf(z)
        return value


@pytest.mark.parametrize("precision", PRECISIONS)
def test_the_functions_phi_keep_their_digits(precision):
    """From where the series serves to where nothing is left of the exponential."""
    near_one = 1 + np.linspace(-0.01, 0.01, 21)
    z = np.concatenate([np.logspace(-6, 4, 401), near_one]).astype(precision)
    got = core_module(precision).phi(z)
    assert got.dtype == precision
    exact = np.array([[float(exact_phi(k, float(at))) for k in (1, 2, 3)] for at in z])
    off = np.abs(got / exact - 1).max() / np.finfo(precision).eps
    assert off < PHI
    np.testing.assert_allclose(
        core_module(precision).phi(np.zeros(1, precision)), [[1, 0.5, 1 / 6]]
    )


# ---- the model's constants ----


def constants(precision, s):
    """What the core made of the settings, and the settings as it holds them."""
    core = core_module(precision)
    held = made(core, "Kalman", core.Constant(1.0, 1.0), s).parameters
    own = held["set"]
    return held["model"], s | {
        "T": own["T"], "K_sen": float(own["K_sen"][0]), "T_sen": float(own["lag"][0]),
        "m": float(np.dtype(precision).type(s["m"])),
    }  # fmt: skip


def symmetric(c):
    """Covariance of a growth of 1 (4, 4), from the constants."""
    N = np.ones((4, 4))
    for i in range(4):
        for j in range(i, 4):
            N[i, j] = N[j, i] = c.get(f"N{i}{j}", 1.0)
    return N


@settings(max_examples=100, phases=set(Phase) - {Phase.shrink, Phase.explain})
@given(
    T=st.floats(-4.7, -2), m=st.floats(-2, 2), lag=st.floats(-3, 3), gain=st.floats(-2, 2),
    turned=st.booleans(), precision=st.sampled_from(PRECISIONS),
)  # fmt: skip
@example(T=-4.0, m=-0.3, lag=1.0, gain=0.0, turned=False, precision="float32")
@example(T=-4.0, m=-0.3, lag=2.0, gain=0.0, turned=True, precision="float32")
@example(T=-4.0, m=-0.3, lag=3.0, gain=2.0, turned=False, precision="float32")
@example(T=-6.0, m=2.0, lag=0.0, gain=-2.0, turned=False, precision="float32")
def test_its_constants_are_those_of_the_matrix_exponential(T, m, lag, gain, turned, precision):
    """T_sen/T from 1/1000 to 1000, gains of either sign: as printed they cancel in float."""
    c, s = constants(precision, SETTINGS | {
        "T": 10**T, "m": 10**m, "T_sen": 10**T * 10**lag, "K_sen": 10**gain * (-1) ** turned,
    })  # fmt: skip
    L, b, N = oracles.held_force(s)
    eps = float(np.finfo(precision).eps)
    room = max(30 * eps, 1e-12)  # the matrix exponential has its own rounding
    for name, value in {
        "T": L[0, 1], "T_2": s["T"] / 2, "T_m": b[1], "T2_2m": b[0],
        "b_sen": L[3, 0], "c_sen": L[3, 1], "d_sen": b[3],
    }.items():  # fmt: skip
        assert c[name] == pytest.approx(value, rel=room), name
    # A rounding of T/T_sen is an absolute error of the exponent.
    assert c["a_sen"] == pytest.approx(L[3, 3], rel=room * (1 + s["T"] / s["T_sen"]), abs=1e-30)
    ours, scale = symmetric(c), np.sqrt(np.outer(np.diag(N), np.diag(N)))
    assert (np.abs(ours - N) <= room * scale)[:3, :3].all()
    # Of the exponential the four points of the quadrature see no more.
    assert (np.abs(ours - N) <= 1e-4 * scale).all()
    d = np.sqrt(np.diag(ours))
    assert np.linalg.eigvalsh(ours / np.outer(d, d)).min() > -30 * eps


@pytest.mark.parametrize("precision", PRECISIONS)
def test_as_printed_it_has_what_the_paper_s_has_and_no_more(precision):
    c, s = constants(precision, SETTINGS | {"as_printed": True})
    L, b, N = oracles.held_force(s)
    assert c["b_sen"] == pytest.approx(L[3, 0], rel=1e-6)
    assert (c["T2_2m"], c["T_m"]) == pytest.approx((b[0], b[1]), rel=1e-6)
    assert [c[name] for name in ("T_2", "c_sen", "d_sen")] == [0.0, 0.0, 0.0]
    assert (symmetric(c) == N).all()


# ---- against the motion itself ----


def after_a_sample(s, iu, start, law):
    """The rotor between the magnets, a sample on, to 1e-12; the control current is held."""

    def slope(_, z):
        f = float(law.force(np.array([iu]), z[:1])[0]) + law.bias_force + s["f_0"] + z[2]
        return [z[1], f / s["m"], 0.0, (s["K_sen"] * z[0] - z[3]) / s["T_sen"]]

    motion = solve_ivp(slope, (0, s["T"]), start, "DOP853", rtol=1e-12, atol=1e-18)
    return np.asarray(motion.y[:, -1])


def orders(lag, as_printed, filter_of):
    """By which power of T the prediction of x, v and x_m is off after one sample."""
    law = ClosedLaw(BEARING)
    start, iu = np.array([2e-4, 0.05, 1.0, 1.5e-4]), 0.7
    off = []
    for T in 4e-4 / 2.0 ** np.arange(4):
        s = SETTINGS | {"T": T, "T_sen": lag, "as_printed": as_printed, "K_sen": 0.8}
        kf = filter_of(law.in_core(core_module()), s)
        kf.reset(start, np.array([1e-9, 1e-9, 1e-9, 1e-9]))
        kf.predict(iu / s["k_ui"])
        off.append(np.abs(kf.mean - after_a_sample(s, iu, start, law))[[0, 1, 3]])
    return np.asarray(np.log2(np.array(off)[:-1] / np.array(off)[1:])[-1])


def extended(magnet, s):
    return made(core_module(), "Extended", magnet, s)


def unscented(magnet, s):
    return made(core_module(), "Unscented", magnet, s, reach=3**0.5, curvature=2.0)


def adaptive(magnet, s):
    return made(core_module(), "Kalman", magnet, s)


@pytest.mark.parametrize("filter_of", [adaptive, extended, unscented])
@pytest.mark.parametrize("lag", [2e-3, 2e-2])
def test_one_sample_is_right_to_the_third_power_of_its_length(lag, filter_of):
    """x and v to T^3, one power less over a whole run; x_m, an integral of x, to T^4.

    As printed v is off by T^2 already, as the magnet is asked where the sample begins, and so is
    x_m.
    """
    x, v, x_m = orders(lag, False, filter_of)
    assert (x, v) == pytest.approx((3, 3), abs=0.15)
    assert x_m == pytest.approx(4, abs=0.2)
    x, v, x_m = orders(lag, True, filter_of)
    assert (x, v, x_m) == pytest.approx((3, 2, 2), abs=0.15)


def test_the_matrices_are_those_of_the_core_s_step():
    """What Riccati equations, the bound and the MAT-file are made of."""
    for as_printed in (False, True):
        s = SETTINGS | {"as_printed": as_printed, "f_0": 0.0}
        core = core_module()
        kf = made(core, "Kalman", core.Constant(10.05, 7537.5), s)
        model = ambkit.KalmanFilter(BEARING, as_printed=as_printed).linear_model(10.05, 7537.5)
        A, B, H = oracles.system_matrices(s, 10.05, 7537.5)
        _, b, N = oracles.held_force(s)
        Q = s["var_u"] * np.outer(B, B) + s["var_d"] * N
        stepped = step_matrices(kf, s)
        np.testing.assert_allclose(model.A, stepped[0], rtol=1e-13)
        np.testing.assert_allclose(model.B[:, 0], stepped[1], rtol=1e-13)
        np.testing.assert_allclose(model.A, A, rtol=1e-13)
        np.testing.assert_allclose(model.B[:, 0], B, rtol=1e-13)
        np.testing.assert_allclose(model.E[:, 0], b, rtol=1e-13)
        np.testing.assert_allclose(model.H[0], H)
        scale = np.sqrt(np.outer(np.diag(Q), np.diag(Q)))
        assert (np.abs(model.Q - Q) <= 1e-5 * scale).all()
        rounding = 1e-30 * np.outer(STD, STD)
        assert (np.abs(stepped[2] - Q) <= 1e-5 * scale + rounding).all()


# ---- against truth, over a run ----


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("lag", [1e-6, 2e-5, 2e-4, 1e-3])
def test_at_constant_speed_the_printed_model_is_ahead_and_the_exact_one_is_not(lag, precision):
    """By v (T/(1-exp(-T/T_sen)) - T_sen): the sensor's reading of a ramp is v T_sen late."""
    T, speed, n = SETTINGS["T"], 1e-3, 4000
    x = speed * T * (np.arange(n) - n / 2)
    y = SETTINGS["K_sen"] * (x - speed * lag)
    ahead = {}
    for as_printed in (False, True):
        s = SETTINGS | {"T_sen": lag, "as_printed": as_printed, "f_0": 0.0}
        core = core_module(precision)
        kf = made(core, "Kalman", core.Constant(0.0, 0.0), s)
        kf.reset(np.array([x[0], speed, 0.0, y[0]]), np.array([1e-5, 1e-3, 1.0, 1e-5]))
        mean = kf.run(y, np.zeros(n))["mean"]
        ahead[as_printed] = (mean[-1, 0] - x[-1]) / speed
        assert mean[-1, 1] == pytest.approx(speed, rel=1e-3)
    rounding = 1e-6 if precision == "float64" else 1e-2
    assert ahead[True] == pytest.approx(T / -np.expm1(-T / lag) - lag, abs=rounding * T)
    assert ahead[False] == pytest.approx(0.0, abs=rounding * T)


def test_with_a_fast_sensor_the_filter_is_better_than_the_sensor():
    """20 us and 0.5 um, an eddy-current probe, over a step of 0.5 mm; as printed it is not."""
    bearing = BEARING.replace(sensor__lag=2e-5, sensor__noise_variance=0.5e-6**2)
    square = {"raw": [], "exact": [], "printed": []}
    for seed in range(20):
        scenario = ambkit.Scenario(
            duration=0.2, seed=seed, reference=ambkit.Step(amplitude=5e-4, time=0.05)
        )
        record = ambkit.simulate(bearing, scenario).record
        x, during = record["x"], slice(500, 1000)
        noise = FilterNoise(disturbance=100.0)
        estimates = {"raw": record["y"] / bearing.sensor.gain} | {
            name: ambkit.ExtendedKalmanFilter(bearing, noise=noise, as_printed=printed)
            .run(record)
            .x
            for name, printed in (("exact", False), ("printed", True))
        }
        for name, estimate in estimates.items():
            square[name].append(float(np.mean((estimate - x)[during] ** 2)))
    raw, exact, printed = (float(np.sqrt(np.mean(v))) for v in square.values())
    assert exact < 0.4 * raw
    assert printed > 2 * raw
