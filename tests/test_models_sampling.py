"""Sampled models are exact: against integration, quadrature and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from model_cases import Axis, machine
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ambkit.models import compose
from ambkit.models.machine_parts import printed

QUICK = settings(max_examples=25, deadline=None, phases=set(Phase) - {Phase.shrink, Phase.explain})


def agrees(case, seed):
    """The model's X+, mean current and mean displacement against integration."""
    model, rng = case.model(), np.random.default_rng(seed)
    size = np.array([at.size for at in model.states])
    X = rng.uniform(-1, 1, len(size)) * size
    F, count = float(rng.uniform(-10, 10)), sum(at.role == "past control" for at in model.states)
    u = [float(rng.uniform(-1, 1)), *X[[at.role == "past control" for at in model.states]]]
    assert count == math.ceil(case.delay / case.T - 1e-9)
    by_name = {at.name: float(x) for at, x in zip(model.states, X, strict=True)}
    truth = case.after(by_name, F, u)
    whole = F + model.r[0] @ X
    got = model.L @ X + model.B_u[:, 0] * u[0] + model.b[:, 0] * whole
    moved = np.array([truth[at.name] for at in model.states])
    np.testing.assert_allclose(got / size, moved / size, rtol=1e-9, atol=1e-9)
    assert model.e[0] @ X + model.d[0, 0] * u[0] == pytest.approx(truth["i_mean"], abs=1e-9)
    assert model.h[0] @ X == pytest.approx(truth["s"], abs=1e-12)


@pytest.mark.parametrize("case", [
    Axis(),
    Axis(lag=2e-6),
    Axis(lag=None),
    Axis(bandwidth=2000.0),
    Axis(delay=0.3e-4),
    Axis(coloured=200.0),
    Axis(hum=(50.0, 0.5)),
    Axis(hum=(3000.0, 0.0)),
], ids=repr)  # fmt: skip
def test_each_part_is_sampled_exactly(case):
    for seed in range(3):
        agrees(case, seed)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 1.5, 2.0, 2.7])
@pytest.mark.parametrize("bandwidth", [None, 2000.0])
def test_any_delay_is_sampled_exactly(samples, bandwidth):
    for seed in range(3):
        agrees(Axis(delay=samples * 1e-4, bandwidth=bandwidth), seed)


@QUICK
@given(
    T=st.floats(-5, -2.5), m=st.floats(-1, 2), lag=st.none() | st.floats(-1.5, 2),
    bandwidth=st.none() | st.floats(-2, 1), delay=st.sampled_from([0.0, 0.05, 0.5, 0.99, 1.2, 3.0]),
    coloured=st.none() | st.floats(-3, 0.5), hum=st.none() | st.floats(-3, 0.5),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_all_combinations_are_sampled_exactly(T, m, lag, bandwidth, delay, coloured, hum, seed):
    """Lag, bandwidth and frequencies as powers of ten of the sample's length and rate."""
    T = 10**T
    agrees(Axis(
        T, 10**m, 0.8, None if lag is None else T * 10**lag,
        None if bandwidth is None else 10**bandwidth / T, delay * T,
        None if coloured is None else 10**coloured / T,
        None if hum is None else (10**hum / T, 0.01 * 10**hum / T),
    ), seed)  # fmt: skip


# ---- the paper's axis ----


def test_as_printed_is_the_paper_s_axis_only():
    with pytest.raises(ValueError, match="as printed there are the states x, v, f_d and x_m"):
        printed(Axis(bandwidth=2000.0).model())


# ---- noise ----


def test_the_noise_of_a_random_walk_is_that_of_a_quadrature():
    """With the magnet's place driven by the walk, through rotor and lag."""
    for lag in (1e-7, 1e-5, 2e-4, 1e-1):
        case = Axis(lag=lag)
        T, m, K = case.T, case.m, case.K_sen
        A = np.array([[0, 1, 0, 0], [0, 0, 1 / m, 0], [0] * 4, [K / lag, 0, 0, -1 / lag]])
        at, weights = np.polynomial.legendre.leggauss(120)
        g = np.array([expm(A * T * (1 + s) / 2)[:, 2] for s in at])
        N = np.einsum("k,ki,kj->ij", weights / 2, g, g)
        np.testing.assert_allclose(case.model().N[0], N, rtol=1e-8)


def test_stationary_noise_stays_as_large_as_it_is():
    """1 - exp(-2 decay T) is added to what is left of a variance of 1; also with a slow decay."""
    for scale in (1e-6, 1.0, 30.0):
        case = Axis(coloured=200.0 * scale, hum=(50.0, 0.5 * scale))
        model = case.model()
        n, c, s = (model.index(name) for name in ("n_y", "hum_c", "hum_s"))
        assert [at.name for at in model.noises] == ["f_d", "n_y", "hum"]
        grown = -math.expm1(-2 * 2 * math.pi * 200.0 * scale * case.T)
        assert model.N[1, n, n] == pytest.approx(grown, rel=1e-12)
        grown = -math.expm1(-2 * 2 * math.pi * 0.5 * scale * case.T)
        lines = model.N[2][np.ix_([c, s], [c, s])]
        np.testing.assert_allclose(lines, grown * np.eye(2), rtol=1e-12, atol=1e-13 * grown)
        kept = model.L[np.ix_([n, c, s], [n, c, s])]
        stays = kept @ kept.T + np.diag([model.N[1, n, n], *np.diag(lines)])
        np.testing.assert_allclose(stays, np.eye(3), atol=1e-12)
        np.testing.assert_array_equal(model.c[0, [n, c, s]], [1, 1, 0])


# ---- several coordinates ----


def test_a_rotor_of_two_planes_is_sampled_exactly():
    """Gyroscopics, damping, stiffness, forces on both planes, a disturbance away from magnets."""
    T, model = 1e-4, compose(machine(), 1e-4)
    M, D = np.array([[2.0, 0.1], [0.1, 0.5]]), np.diag([3.0, 0.0])
    G, K = np.array([[0, 0.2], [-0.2, 0]]), np.diag([4e4, 0.0])
    P = np.array([[1.0, 0.3], [0.2, 1.0]])
    rng = np.random.default_rng(5)
    X = rng.uniform(-1, 1, len(model.states)) * [at.size for at in model.states]
    F = np.array([7.0, -4.0])
    names = ["x", "y", "vx", "vy", "xm_0", "xm_1"]
    start = X[[model.index(name) for name in names]]
    held = F + [X[model.index("f_d0")], 0.0] + P[1] * X[model.index("f_d1")]

    def slope(_, z):
        q, v, x_m = z[:2], z[2:4], z[4:]
        pushed = np.linalg.solve(M, held - (D + 900.0 * G) @ v - K @ q)
        return np.concatenate([v, pushed, ([0.9, 1.0] * (P @ q) - x_m) / [1e-4, 2e-4]])

    moved = solve_ivp(slope, (0, T), start, "DOP853", rtol=1e-12, atol=1e-18).y[:, -1]
    got = model.L @ X + model.B_u @ [0.3, -0.2] + model.b @ (F + model.r @ X)
    np.testing.assert_allclose(got[[model.index(name) for name in names]], moved, rtol=1e-10)
    assert (model.L[:, model.index("f_d0")] != 0).sum() == 1  # it rides, the other does not
    assert (model.L[:, model.index("f_d1")] != 0).sum() > 4


def test_its_noise_is_that_of_a_quadrature():
    """Both disturbances, one at a magnet's place, one between them; seen by both sensors."""
    T, model = 1e-4, compose(machine(), 1e-4)
    inverse = np.linalg.inv([[2.0, 0.1], [0.1, 0.5]])
    D, K = np.diag([3.0, 0.0]) + 900.0 * np.array([[0, 0.2], [-0.2, 0]]), np.diag([4e4, 0.0])
    P, lag = np.array([[1.0, 0.3], [0.2, 1.0]]), np.array([[1e-4], [2e-4]])
    zero = np.zeros((2, 2))
    A = np.block(
        [
            [zero, np.eye(2), zero, zero],
            [-inverse @ K, -inverse @ D, inverse @ np.array([[1, 0.2], [0, 1]]), zero],
            [zero, zero, zero, zero],
            [np.array([[0.9], [1.0]]) * P / lag, zero, zero, -np.eye(2) / lag],
        ]
    )
    at, weights = np.polynomial.legendre.leggauss(30)
    left = np.array([expm(A * T * (1 + s) / 2) for s in at])
    names = ["x", "y", "vx", "vy", "f_d0", "f_d1", "xm_0", "xm_1"]
    to = [model.index(name) for name in names]
    for k, column in enumerate((4, 5)):
        g = left[:, :, column]
        N = np.einsum("k,ki,kj->ij", weights / 2, g, g)
        np.testing.assert_allclose(model.N[k][np.ix_(to, to)], N, rtol=1e-10)
        assert np.count_nonzero(model.N[k]) == np.count_nonzero(N)


def test_metres_and_micrometres_give_the_same():
    one, other = compose(machine(), 1e-4), compose(machine(metre=1e6), 1e-4)
    unit = np.array([1e6 if at.unit in ("m", "m/s") else 1.0 for at in one.states])
    np.testing.assert_allclose(other.L, one.L * unit[:, None] / unit, rtol=1e-12)
    np.testing.assert_allclose(other.b, one.b * unit[:, None], rtol=1e-12)
    np.testing.assert_allclose(other.N, one.N * np.outer(unit, unit), rtol=1e-12)
    np.testing.assert_allclose(other.h, one.h * 1e6 / unit, rtol=1e-12)
    np.testing.assert_allclose(other.e, one.e, rtol=1e-12)
    assert one.pattern_key() == other.pattern_key()
