"""Composed models: sampled exactly, of a pattern that the kind of machine alone decides."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from filter_cases import BEARING, SETTINGS
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from model_oracles import random_model, random_settings
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from ambkit.estimators.model import LinearModel
from ambkit.magnets import core_module
from ambkit.models import NUMBER, ONE, ZERO, Model, axis, axis_model, compose
from ambkit.models.parts import (
    PARTS,
    Amplifier,
    ColouredNoise,
    Delay,
    Disturbance,
    Hum,
    MagnetPlace,
    Rotor,
    Sensor,
)
from ambkit.models.plan import UNIT, Part, Plan

Array = NDArray[np.float64]
QUICK = settings(max_examples=25, deadline=None, phases=set(Phase) - {Phase.shrink, Phase.explain})


# ---- an axis by hand ----


@dataclass(frozen=True)
class Axis:
    """An axis with every part; None for what it does not have."""

    T: float = 1e-4
    m: float = 0.518
    K_sen: float = 0.8
    lag: float | None = 2e-4
    bandwidth: float | None = None
    delay: float = 0.0
    coloured: float | None = None
    hum: tuple[float, float] | None = None

    def parts(self) -> list[Part]:
        """Its parts, as a user writes them."""
        parts: list[Part] = [
            Rotor(self.m, 1e-3, 0.1),
            MagnetPlace(10.0),
            Disturbance(10.0, 0.01),
            Sensor(self.K_sen, self.lag, 1e-3),
            Amplifier(1.0, self.bandwidth),
        ]
        if self.delay:
            parts.append(Delay(self.delay, 1.0))
        if self.coloured:
            parts.append(ColouredNoise(1e-12, self.coloured))
        if self.hum:
            parts.append(Hum(self.hum[0], 5e-6, self.hum[1]))
        return parts

    def model(self) -> Model:
        return compose(self.parts(), self.T, name="axis")

    def acting(self, t: float, u: list[float]) -> float:
        """What acts at a time within sample 0: the newest that was issued a delay before.

        u: demanded currents of sample 0, -1, -2 ...
        """
        return u[-math.floor((t - self.delay) / self.T + 1e-9)] if self.delay else u[0]

    def after(self, X: dict[str, float], F: float, u: list[float]) -> dict[str, float]:
        """One sample on, by stiff integration; s and i_mean are means over the sample."""
        T, names = self.T, ["x", "v", "x_m", "i", "n_y", "hum_c", "hum_s", "free", "s", "i_mean"]
        corner = 2 * math.pi * (self.bandwidth or 0.0)
        colour = 2 * math.pi * (self.coloured or 0.0)
        turn, decay = (2 * math.pi * at for at in self.hum or (0.0, 0.0))
        force = F + X["f_d"]
        z = np.array([X.get(name, 0.0) for name in names])
        z[7:] = [X["x"], 0.0, 0.0]  # the rotor that no force pushes

        def slope(t: float, z: Array, u_now: float) -> list[float]:
            x, v, x_m, i, n, c, s, free, _, _ = z
            i_now = i if self.bandwidth else u_now
            return [
                v, force / self.m, (self.K_sen * x - x_m) / self.lag if self.lag else 0.0,
                corner * (u_now - i), -colour * n, -decay * c - turn * s, turn * c - decay * s,
                X["v"], free / T, i_now / T,
            ]  # fmt: skip

        break_at = math.fmod(self.delay, T)
        ends = sorted({0.0, break_at, T}) if 1e-9 * T < break_at < T * (1 - 1e-9) else [0.0, T]
        scale = np.array([1e-3, 0.1, 1e-3, 1, 1e-6, 1e-6, 1e-6, 1e-3, 1e-3, 1])
        for start, end in pairwise(ends):
            u_now = self.acting((start + end) / 2, u)
            z = solve_ivp(
                slope, (start, end), z, "LSODA", args=(u_now,), rtol=1e-12, atol=1e-13 * scale
            ).y[:, -1]
        found = dict(zip(names, z.tolist(), strict=True)) | {"f_d": X["f_d"]}
        return found | {f"u_{k + 1}": at for k, at in enumerate(u)}


def agrees(case: Axis, seed: int) -> None:
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
def test_each_part_is_sampled_exactly(case: Axis) -> None:
    for seed in range(3):
        agrees(case, seed)


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 1.5, 2.0, 2.7])
@pytest.mark.parametrize("bandwidth", [None, 2000.0])
def test_any_delay_is_sampled_exactly(samples: float, bandwidth: float | None) -> None:
    for seed in range(3):
        agrees(Axis(delay=samples * 1e-4, bandwidth=bandwidth), seed)


@QUICK
@given(
    T=st.floats(-5, -2.5), m=st.floats(-1, 2), lag=st.none() | st.floats(-1.5, 2),
    bandwidth=st.none() | st.floats(-2, 1), delay=st.sampled_from([0.0, 0.05, 0.5, 0.99, 1.2, 3.0]),
    coloured=st.none() | st.floats(-3, 0.5), hum=st.none() | st.floats(-3, 0.5),
    seed=st.integers(0, 99),
)  # fmt: skip
def test_all_combinations_are_sampled_exactly(
    T: float, m: float, lag: float | None, bandwidth: float | None, delay: float,
    coloured: float | None, hum: float | None, seed: int,
) -> None:  # fmt: skip
    """Lag, bandwidth and frequencies as powers of ten of the sample's length and rate."""
    T = 10**T
    agrees(Axis(
        T, 10**m, 0.8, None if lag is None else T * 10**lag,
        None if bandwidth is None else 10**bandwidth / T, delay * T,
        None if coloured is None else 10**coloured / T,
        None if hum is None else (10**hum / T, 0.01 * 10**hum / T),
    ), seed)  # fmt: skip


def test_the_amplifier_s_mean_current_is_its_closed_form() -> None:
    """2 kHz within 0.1 ms: over two thirds of the way, 43 % in the mean."""
    model = Axis(bandwidth=2000.0).model()
    z = 2 * math.pi * 2000.0 * 1e-4
    left = -math.expm1(-z) / z
    assert model.e[0, model.index("i")] == pytest.approx(left, rel=1e-13)
    assert model.d[0, 0] == pytest.approx(1 - left, rel=1e-13)
    assert model.L[4, 4] == pytest.approx(math.exp(-z), rel=1e-13)


def test_a_delay_shares_the_sample_between_the_controls() -> None:
    model = Axis(delay=1.3e-4).model()
    assert [at.name for at in model.states][4:] == ["u_1", "u_2"]
    np.testing.assert_allclose(model.e[0, 4:], [0.7, 0.3], rtol=1e-12)
    assert model.d[0, 0] == 0
    np.testing.assert_array_equal(model.B_u[:, 0], [0, 0, 0, 0, 1, 0])
    np.testing.assert_array_equal(model.L[4:, 4:], [[0, 0], [1, 0]])


# ---- the paper's axis ----


@QUICK
@given(
    T=st.floats(-5, -2), m=st.floats(-2, 2), lag=st.floats(-3, 3), gain=st.floats(-2, 2),
)  # fmt: skip
def test_the_paper_s_axis_has_the_core_s_numbers(
    T: float, m: float, lag: float, gain: float
) -> None:
    """T_sen/T from 1/1000 to 1000: to 1e-12, what the sensor makes of noise to 1e-3."""
    s = {"T": 10**T, "m": 10**m, "T_sen": 10**T * 10**lag, "K_sen": 10**gain}
    core = core_module()
    known = core.Kalman(core.Constant(1.0, 1.0), **(SETTINGS | s)).parameters["model"]
    parts = [
        Rotor(s["m"], 1e-3, 0.1), MagnetPlace(10.0), Disturbance(10.0, 0.01),
        Sensor(s["K_sen"], s["T_sen"], 1e-3), Amplifier(1.0),
    ]  # fmt: skip
    model = compose(parts, s["T"])
    for (matrix, i, j), name in axis.PAPER_CONSTANTS.items():
        N = matrix == "N0"
        value = model.N[0, i, j] if N else getattr(model, matrix)[i, j]
        # The core's exponential ends at 1e-307, and its noise of the sensor is by four points.
        room = 1e-3 if N and j == 3 else 1e-12
        assert value == pytest.approx(known[name], rel=room, abs=1e-300), name
    assert set(known) == set(axis.PAPER_CONSTANTS.values())


@pytest.mark.parametrize("as_printed", [False, True])
def test_its_matrices_are_those_of_the_estimators(as_printed: bool) -> None:
    core = core_module()
    kf = core.Kalman(core.Constant(10.05, 7537.5), **SETTINGS | {"as_printed": as_printed})
    known = LinearModel.of(kf.parameters, 10.05, 7537.5)
    model = axis_model(BEARING, as_printed=as_printed)
    np.testing.assert_allclose(model.jacobian(10.05, 7537.5), known.A, rtol=1e-12)
    np.testing.assert_allclose(model.input_matrix(10.05) * SETTINGS["k_ui"], known.B, rtol=1e-12)
    var_u = SETTINGS["var_u"] * SETTINGS["k_ui"] ** 2
    Q = model.process_noise(10.05, var_u, SETTINGS["var_d"])
    np.testing.assert_allclose(Q, known.Q, rtol=1e-3)
    np.testing.assert_array_equal(model.c, known.H)


def test_as_printed_is_the_paper_s_axis_only() -> None:
    with pytest.raises(ValueError, match="as printed there are the states x, v, f_d and x_m"):
        axis.printed(Axis(bandwidth=2000.0).model())


# ---- noise ----


def test_the_noise_of_a_random_walk_is_that_of_a_quadrature() -> None:
    """With the magnet's place driven by the walk, through rotor and lag."""
    for lag in (1e-7, 1e-5, 2e-4, 1e-1):
        case = Axis(lag=lag)
        T, m, K = case.T, case.m, case.K_sen
        A = np.array([[0, 1, 0, 0], [0, 0, 1 / m, 0], [0] * 4, [K / lag, 0, 0, -1 / lag]])
        at, weights = np.polynomial.legendre.leggauss(120)
        g = np.array([expm(A * T * (1 + s) / 2)[:, 2] for s in at])
        N = np.einsum("k,ki,kj->ij", weights / 2, g, g)
        np.testing.assert_allclose(case.model().N[0], N, rtol=1e-8)


def test_stationary_noise_stays_as_large_as_it_is() -> None:
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


def machine(
    order: tuple[int, ...] = (0, 1), *, metre: float = 1.0, speed: float = 900.0
) -> list[Part]:
    """A rotor of two planes with gyroscopics, two magnets, two sensors; lengths in `metre`."""
    M = {(0, 0): 2.0 / metre, (1, 1): 0.5 / metre, (0, 1): 0.1 / metre, (1, 0): 0.1 / metre}
    rotor = Rotor(
        M, 1e-3 * metre, 0.1 * metre, ("x", "y"), ("vx", "vy"),
        damping={(0, 0): 3.0 / metre},
        gyroscopic={(0, 1): 0.2 / metre, (1, 0): -0.2 / metre},
        stiffness={(0, 0): 4e4 / metre}, speed=speed,
    )  # fmt: skip
    places = [{"x": 1.0, "y": 0.3}, {"x": 0.2, "y": 1.0}]
    sensors: list[Part] = [
        Sensor(0.9 + 0.1 * k, 1e-4 * (1 + k), 1e-3 * metre, f"y_{k}", f"xm_{k}", places[k])
        for k in range(2)
    ]
    parts: list[Part] = [rotor]
    for k in range(2):
        parts += [
            MagnetPlace(20.0, f"f_{k}", "xy"[k]),
            Amplifier(1.0, 1500.0 * (k + 1), f"u{k}", f"i{k}", f"f_{k}"),
            Delay(1e-4 * (0.4 + 0.8 * k), 1.0, f"u{k}"),
        ]
    parts += [Disturbance(5.0, 0.1, "f_d0", "f_0"), Disturbance(5.0, 0.1, "f_d1", None, places[1])]
    return [*parts, *(sensors[k] for k in order)]


def test_a_rotor_of_two_planes_is_sampled_exactly() -> None:
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

    def slope(_: float, z: Array) -> Array:
        q, v, x_m = z[:2], z[2:4], z[4:]
        pushed = np.linalg.solve(M, held - (D + 900.0 * G) @ v - K @ q)
        return np.concatenate([v, pushed, ([0.9, 1.0] * (P @ q) - x_m) / [1e-4, 2e-4]])

    moved = solve_ivp(slope, (0, T), start, "DOP853", rtol=1e-12, atol=1e-18).y[:, -1]
    got = model.L @ X + model.B_u @ [0.3, -0.2] + model.b @ (F + model.r @ X)
    np.testing.assert_allclose(got[[model.index(name) for name in names]], moved, rtol=1e-10)
    assert (model.L[:, model.index("f_d0")] != 0).sum() == 1  # it rides, the other does not
    assert (model.L[:, model.index("f_d1")] != 0).sum() > 4


def test_the_mean_displacement_is_the_free_rotor_s() -> None:
    T, model = 1e-4, compose(machine(), 1e-4)
    M, D = np.array([[2.0, 0.1], [0.1, 0.5]]), np.diag([3.0, 0.0])
    G, K = np.array([[0, 0.2], [-0.2, 0]]), np.diag([4e4, 0.0])
    inverse = np.linalg.inv(M)
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-inverse @ K, -inverse @ (D + 900.0 * G)]])
    at, weights = np.polynomial.legendre.leggauss(20)
    mean = sum(w / 2 * expm(A * T * (1 + s) / 2) for s, w in zip(at, weights, strict=True))
    rotor = [model.index(name) for name in ("x", "y", "vx", "vy")]
    np.testing.assert_allclose(model.h[:, rotor], mean[:2], rtol=1e-11, atol=1e-18)
    others = np.setdiff1d(np.arange(len(model.states)), rotor)
    assert (model.pattern["h"][:, others] == ZERO).all()


def test_permuted_sensors_permute_the_model() -> None:
    one, other = compose(machine(), 1e-4), compose(machine((1, 0)), 1e-4)
    to = [other.index(at.name) for at in one.states]
    assert [at.name for at in other.measurements] == ["y_1", "y_0"]
    for name in ("L", "rest"):
        value = getattr(other, name)[np.ix_(to, to)]
        np.testing.assert_allclose(value, getattr(one, name), rtol=1e-12, atol=0)
    np.testing.assert_allclose(other.b[to], one.b, rtol=1e-12)
    np.testing.assert_allclose(other.c[::-1][:, to], one.c, rtol=1e-12)
    np.testing.assert_allclose(other.N[:, to][:, :, to], one.N, rtol=1e-11)
    for name in ("h", "e", "r"):
        np.testing.assert_allclose(getattr(other, name)[:, to], getattr(one, name), rtol=1e-12)


def test_metres_and_micrometres_give_the_same() -> None:
    one, other = compose(machine(), 1e-4), compose(machine(metre=1e6), 1e-4)
    unit = np.array([1e6 if at.unit in ("m", "m/s") else 1.0 for at in one.states])
    np.testing.assert_allclose(other.L, one.L * unit[:, None] / unit, rtol=1e-12)
    np.testing.assert_allclose(other.b, one.b * unit[:, None], rtol=1e-12)
    np.testing.assert_allclose(other.N, one.N * np.outer(unit, unit), rtol=1e-12)
    np.testing.assert_allclose(other.h, one.h * 1e6 / unit, rtol=1e-12)
    np.testing.assert_allclose(other.e, one.e, rtol=1e-12)
    assert one.pattern_key() == other.pattern_key()


# ---- patterns ----


def test_the_pattern_is_of_the_kind_not_of_the_numbers() -> None:
    keys = {Axis(m=m, K_sen=K, lag=lag).model().pattern_key()
            for m, K, lag in ((0.5, 1.0, 1e-4), (30.0, -2.0, 1e-9), (1.0, 1.0, 1e3))}  # fmt: skip
    assert len(keys) == 1
    still, turning = compose(machine(speed=0.0), 1e-4), compose(machine(), 1e-4)
    assert still.pattern_key() == turning.pattern_key()
    one, whole = Axis(delay=0.3e-4).model(), Axis(delay=1e-4).model()
    assert one.pattern_key() == whole.pattern_key()
    assert (whole.d[0, 0], whole.pattern["d"][0, 0]) == (pytest.approx(0, abs=1e-15), NUMBER)
    kinds = [Axis(), Axis(lag=None), Axis(bandwidth=1e3), Axis(delay=1e-4), Axis(delay=1.1e-4)]
    assert len({case.model().pattern_key() for case in kinds}) == len(kinds)


def test_the_paper_s_axis_has_the_paper_s_pattern() -> None:
    pattern = axis_model(BEARING).pattern
    known = {
        "L": [[1, 2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [2, 2, 0, 2]],
        "b": [[2], [2], [0], [2]], "B_u": [[0]] * 4, "h": [[1, 2, 0, 0]], "e": [[0] * 4],
        "d": [[1]], "r": [[0, 0, 1, 0]], "c": [[0, 0, 0, 1]],
        "rest": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [2, 0, 0, 0]],
    }  # fmt: skip
    assert (ZERO, ONE, NUMBER) == (0, 1, 2)
    for name, kinds in known.items():
        np.testing.assert_array_equal(pattern[name], kinds, name)


def test_compressed_rows_hold_the_whole_pattern() -> None:
    for model in (axis_model(BEARING), random_model(3, 12, 2, 3)):
        for name in ("L", "b", "h", "c", "d"):
            start, column, value = model.sparse(name)
            assert (start.dtype, column.dtype, value.dtype) == (np.uint16, np.uint16, np.float64)
            dense, kinds = np.zeros_like(getattr(model, name)), np.zeros(getattr(model, name).shape)
            for i in range(len(dense)):
                at = slice(start[i], start[i + 1])
                assert (np.diff(column[at].astype(int)) > 0).all()
                dense[i, column[at]], kinds[i, column[at]] = value[at], 1
            np.testing.assert_array_equal(dense, getattr(model, name))
            np.testing.assert_array_equal(kinds, model.pattern[name] != ZERO)


def test_a_number_that_happens_to_be_zero_is_listed() -> None:
    _, column, value = Axis(delay=1e-4, bandwidth=None).model().sparse("d")
    assert (column.tolist(), value.tolist()) == ([0], [pytest.approx(0, abs=1e-15)])


def test_what_a_pattern_says_the_numbers_hold_to() -> None:
    model = axis_model(BEARING)
    with pytest.raises(ValueError, match="r has other numbers where its pattern says 0 or 1"):
        replace(model, r=2 * model.r)
    with pytest.raises(ValueError, match=r"b must be of shape \(4, 1\), is of \(3, 1\)"):
        replace(model, b=model.b[:3])
    with pytest.raises(ValueError, match="L must be finite"):
        replace(model, L=model.L * np.where(model.pattern["L"] == NUMBER, np.nan, 1))
    with pytest.raises(ValueError, match="read-only"):
        model.L[0, 0] = 2.0
    with pytest.raises(KeyError, match="no state q; there are x, v, f_d, x_m"):
        model.index("q")


# ---- rest ----


@pytest.mark.parametrize("case", [
    Axis(), Axis(bandwidth=2000.0), Axis(delay=2.7e-4), Axis(delay=1.5e-4, bandwidth=500.0),
], ids=repr)  # fmt: skip
def test_at_rest_nothing_moves(case: Axis) -> None:
    """The same current demanded for long, forces in balance, the rotor somewhere."""
    model = case.model()
    free = {"x": 3e-4, "f_d": 2.0} | {"u_1": 0.7} | ({"i": 0.7} if not case.delay else {})
    X = model.rest @ [free.get(at.name, 0.0) for at in model.states]
    assert X[model.index("x_m")] == pytest.approx(0.8 * 3e-4)
    got = model.L @ X + model.B_u[:, 0] * 0.7  # forces: the magnet's is -2 N
    size = [at.size for at in model.states]
    np.testing.assert_allclose(got / size, X / size, rtol=0, atol=1e-14)
    assert model.e[0] @ X + model.d[0, 0] * 0.7 == pytest.approx(0.7)
    np.testing.assert_array_equal(model.rest @ model.rest, model.rest)


# ---- from a bearing ----


def bearing(**keys: Any) -> Any:
    """The preset with keys that it may have one day."""
    sensor = SimpleNamespace(gain=1.0, lag=2e-4, **keys.pop("sensor", {}))
    amplifier = SimpleNamespace(**keys.pop("amplifier", {}))
    return SimpleNamespace(
        magnet=BEARING.magnet, rotor=BEARING.rotor, sampling_time=BEARING.sampling_time,
        sensor=sensor, amplifier=amplifier, **keys,
    )  # fmt: skip


def test_a_bearing_s_keys_bring_their_parts() -> None:
    lines = [SimpleNamespace(frequency=at, amplitude=5e-6, bandwidth=0.5) for at in (50.0, 150.0)]
    noise = SimpleNamespace(variance=1e-12, bandwidth=200.0)
    model = axis_model(bearing(
        delay=1.5e-4, amplifier={"bandwidth": 2000.0},
        sensor={"coloured_noise": noise, "hum": lines},
    ))  # fmt: skip
    assert [at.name for at in model.states] == [
        "x", "v", "f_d", "x_m", "i", "u_1", "u_2", "n_y", "hum_c", "hum_s", "hum2_c", "hum2_s",
    ]  # fmt: skip
    known = Axis(K_sen=1.0, bandwidth=2000.0, delay=1.5e-4, coloured=200.0, hum=(50.0, 0.5)).model()
    np.testing.assert_allclose(model.L[:10, :10], known.L, rtol=1e-9, atol=1e-25)
    assert [at.size for at in model.noises][1:] == pytest.approx([1e-6, *[5e-6 / 2**0.5] * 2])
    plain = axis_model(bearing())
    assert plain.pattern_key() == axis_model(BEARING).pattern_key()


@dataclass(frozen=True)
class Mount:
    """A part that ambkit does not have: the sensor's holder creeps."""

    rate: float

    @classmethod
    def of_axis(cls, bearing: Any, typical: Any) -> list[Mount]:
        return [cls(bearing.creep)]

    def declare(self, plan: Plan) -> None:
        plan.state("creep", "m", 1e-6, "noise")
        plan.rate("creep", "creep", -self.rate)
        plan.add_to_reading("y", {"creep": UNIT})


def test_a_new_part_is_one_class_and_its_registration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(axis, "PARTS", (*PARTS, Mount))
    model = axis_model(bearing(creep=3.0))
    assert [at.name for at in model.states] == ["x", "v", "f_d", "x_m", "creep"]
    assert model.L[4, 4] == pytest.approx(math.exp(-3.0 * model.T))
    np.testing.assert_array_equal(model.c, [[0, 0, 0, 1, 1]])


@pytest.mark.parametrize(("parts", "message"), [
    ([Rotor(1.0, 1.0, 1.0), Rotor(1.0, 1.0, 1.0)], "two of the name x"),
    ([MagnetPlace(1.0)], "f pushes at x, which is no position"),
    ([Rotor(1.0, 1.0, 1.0), MagnetPlace(1.0, place="v")], "f pushes at v, which is no position"),
    ([Rotor(1.0, 1.0, 1.0), Disturbance(1.0, 1.0)], "f_d rides on f, which is no magnet's force"),
    ([ColouredNoise(1.0, 1.0)], "no measurement y"),
    ([Sensor(1.0, 1.0, 1.0)], "no part declares x; there are x_m"),
    ([Rotor(1.0, 1.0, 1.0), Delay(1.0, 1.0)], "no amplifier has the demanded current u"),
    ([Rotor({(0, 0): 0.0}, 1.0, 1.0)], "mass must be symmetric and positive definite"),
])  # fmt: skip
def test_parts_that_do_not_fit_are_refused(parts: list[Part], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compose(parts, 1e-3)


# ---- random models ----


@pytest.mark.parametrize(("n", "p", "m"), [(2, 1, 1), (5, 1, 2), (16, 4, 4), (40, 8, 10)])
def test_random_models_are_stable_and_of_all_kinds(n: int, p: int, m: int) -> None:
    seen: dict[str, set[int]] = {}
    for seed in range(20):
        model = random_model(seed, n, p, m)
        s = random_settings(model, seed)
        assert np.abs(np.linalg.eigvals(model.jacobian(s.k_i, s.k_s))).max() < 1
        assert np.linalg.eigvalsh(model.N).min() > -1e-12
        for name, kinds in model.pattern.items():
            seen.setdefault(name, set()).update(np.unique(kinds).tolist())
        assert random_model(seed, n, p, m).pattern_key() == model.pattern_key()
    assert seen["L"] >= {ZERO, NUMBER}
    assert seen["B_u"] >= {ZERO, ONE}
    for name in "hcdr"[: 2 if n < 5 else 4]:
        assert seen[name] == {ZERO, ONE, NUMBER}, name
