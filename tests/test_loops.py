"""The build that runs any model by loops: as the built-in axis, as textbooks have it, and in order.

The order of the sums is a contract: whoever writes a model as straight-line code in that order gets
the same bits (core/include/ambkit/model.h).
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parent.parent
CORE = sorted((ROOT / "core" / "src").glob("*.c"))
FLAGS = [
    *("-std=c99", "-O3", "-ffp-contract=off", "-fno-trapping-math"),
    *(f"-I{ROOT / folder}" for folder in ("core/include", "core", "tests/c")),
]
LOOPS = "-DAMB_MODEL_LOOPS"

Array = NDArray[np.float64]

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")


def gcc(*arguments):
    done = subprocess.run(["gcc", *FLAGS, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.long
@pytest.mark.parametrize("precision", ["-DAMB_DOUBLE", "-DAMB_FLOAT"])
def test_the_axis_by_loops_is_the_axis_built_in_to_the_last_bit(precision, tmp_path):
    """18,000 steps of every kind, with faults in between; a record, and the same smoothed."""
    here, axis = ROOT / "tests" / "c", tmp_path / "axis.o"
    gcc(precision, "-c", here / "axis.c", "-o", axis)
    printed = []
    for build in ([precision], [precision, LOOPS]):
        program = tmp_path / f"print{len(build)}"
        words = ["gcc", *FLAGS, *build]
        words += [here / "print_steps.c", *CORE, axis, "-lm", "-o", program]
        subprocess.run(words, check=True)
        done = subprocess.run([program], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout.splitlines())
    built_in, loops = printed
    differing = [pair for pair in zip(built_in, loops, strict=True) if pair[0] != pair[1]]
    assert differing == []
    last = [line.split() for line in built_in if line.startswith(" step 17999 ")]
    assert len(last) == 18  # nine kinds, each twice
    raised = 0
    for words in last:
        raised |= int(words[-1])
    # Missing, frozen, saturated, bad control, held, outlier, restarted: nothing was left out.
    assert raised & 0b1001_0010_1111 == 0b1001_0010_1111
    assert not any("nan" in line or "inf" in line for line in built_in)


# ---- any model ----


class Sparse(ctypes.Structure):
    _fields_ = (
        ("start", ctypes.POINTER(ctypes.c_ushort)),
        ("column", ctypes.POINTER(ctypes.c_ushort)),
        ("value", ctypes.POINTER(ctypes.c_double)),
    )


class CModel(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_int) for name in ("states", "forces", "controls", "sensors", "noises")),
        *((name, Sparse) for name in ("L", "b", "B_u", "h")),
        ("e", ctypes.POINTER(ctypes.c_double)),
        ("r", ctypes.POINTER(ctypes.c_double)),
        *((name, Sparse) for name in ("d", "c", "N", "rest")),
        ("role", ctypes.POINTER(ctypes.c_ubyte)),
    )


@dataclass(frozen=True)
class Matrix:
    """A matrix of numbers, and where they are not structurally zero."""

    value: Array
    there: NDArray[np.bool_]

    def row(self, i):
        """Its entries, columns ascending."""
        return [(int(j), float(self.value[i, j])) for j in np.flatnonzero(self.there[i])]


@dataclass(frozen=True)
class Model:
    """A model of a pattern that no machine has."""

    L: Matrix
    b: Matrix
    B_u: Matrix
    h: Matrix
    e: Matrix
    r: Matrix
    d: Matrix
    c: Matrix
    N: Matrix


@dataclass(frozen=True)
class Point:
    """Where it is stepped from."""

    k_i: Array
    k_s: Array
    k_ui: Array
    var_u: Array
    var_d: Array
    F: Array
    iu: Array
    mean: Array
    cov: Array


def matrix(rng, rows, columns, most):
    """Up to `most` entries in a row; one in six rows is empty."""
    there = np.zeros((rows, columns), bool)
    for i in range(rows):
        count = 0 if rng.random() < 1 / 6 else int(rng.integers(1, most + 1))
        there[i, rng.choice(columns, min(count, columns), replace=False)] = True
    return Matrix(np.where(there, rng.normal(size=there.shape), 0.0), there)


def random_model(rng):
    n, p, m = (int(rng.integers(1, most + 1)) for most in (40, 8, 10))
    controls, noises = (int(rng.integers(1, most + 1)) for most in (6, 8))
    L = matrix(rng, n, n, 6)
    B_u = matrix(rng, n, controls, 1)
    for i in range(1, n):  # a delay: what one state was, the next is, and the first is a control
        if rng.random() < 0.2:
            L.there[i], L.value[i] = False, 0.0
            L.there[i, i - 1], L.value[i, i - 1] = True, 1.0
    h = matrix(rng, p, n, 5)
    parts = [h.there & (rng.random(h.there.shape) < 0.6) for _ in range(3)]
    h, e, r = (Matrix(np.where(at, rng.normal(size=at.shape), 0.0), h.there) for at in parts)
    entries = np.triu_indices(n)
    N = Matrix(np.zeros((noises, len(entries[0]))), np.zeros((noises, len(entries[0])), bool))
    for k in range(noises):
        v = np.where(rng.random(n) < 0.3, rng.normal(size=n), 0.0)
        N.value[k] = np.outer(v, v)[entries]
        N.there[k] = N.value[k] != 0
    return Model(
        L, matrix(rng, n, p, 3), B_u, h, e, r, matrix(rng, p, controls, 2), matrix(rng, m, n, 4), N
    )


def random_point(rng, model):
    n, p = len(model.L.value), len(model.h.value)
    controls = int(model.d.value.shape[1])
    size = 10 ** rng.uniform(-3, 3, n)
    root = rng.normal(size=(n, n)) * size[:, None]
    return Point(
        k_i=rng.normal(size=p),
        k_s=rng.normal(size=p),
        k_ui=rng.normal(size=controls),
        var_u=rng.uniform(0, 1, controls),
        var_d=rng.uniform(0, 1, len(model.N.value)),
        F=rng.normal(size=p),
        iu=rng.normal(size=controls),
        mean=rng.normal(size=n) * size,
        cov=root @ root.T,
    )


class Loops:
    """The C of core/src/loops.c, for one model."""

    def __init__(self, library, model):
        self._library = library
        self._kept: list[Any] = []
        n, p = len(model.L.value), len(model.h.value)
        self.n, self.p = n, p
        sparse = {
            name: self._sparse(getattr(model, name))
            for name in ["L", "b", "B_u", "h", "d", "c", "N"]
        }
        nothing = Matrix(np.zeros((n, n)), np.zeros((n, n), bool))
        self._model = CModel(
            states=n, forces=p, controls=model.d.value.shape[1], sensors=len(model.c.value),
            noises=len(model.N.value), **sparse, rest=self._sparse(nothing),
            e=self._numbers(model.e.value[model.h.there]),
            r=self._numbers(model.r.value[model.h.there]),
        )  # fmt: skip

    def _keep(self, made):
        self._kept.append(made)
        return made

    def _numbers(self, numbers):
        return self._keep((ctypes.c_double * max(1, len(numbers)))(*numbers))

    def _sparse(self, of):
        start = [0, *np.cumsum(of.there.sum(axis=1)).tolist()]
        column = np.nonzero(of.there)[1].tolist()
        return Sparse(
            self._keep((ctypes.c_ushort * len(start))(*start)),
            self._keep((ctypes.c_ushort * max(1, len(column)))(*column)),
            self._numbers(of.value[of.there]),
        )

    def call(self, name, *arguments):
        getattr(self._library, f"amb_model_{name}")(ctypes.byref(self._model), *arguments)

    def predict(self, at):
        """Mean, and covariance as its upper triangle."""
        mean, cov = at.mean.copy(), at.cov[np.triu_indices(self.n)]
        room = self.n * (2 * self.n + 2 * self.p + 2 * len(at.iu))  # AMB_WORK, with these sizes
        growth, work = np.zeros(len(cov)), np.full(room, np.nan)
        k = np.ascontiguousarray(np.stack([at.k_i, at.k_s], axis=1))
        self.call("growth", pointer(at.var_d), pointer(growth))
        self.call("predict_mean", pointer(at.F), pointer(at.iu), pointer(mean))
        given = (k, at.k_ui, at.var_u, growth, cov, work)
        self.call("predict_covariance", *map(pointer, given))
        return mean, cov

    def update(self, r, y, var_y, at):
        """Mean, triangle, innovation and its variance."""
        mean, cov = at.mean.copy(), at.cov[np.triu_indices(self.n)]
        e = ctypes.c_double()
        shown = self._library["amb_model_shown_variance"]
        shown.restype = ctypes.c_double
        S = float(shown(ctypes.byref(self._model), r, pointer(cov))) + var_y
        self.call("update", r, ctypes.c_double(y), ctypes.c_double(S), pointer(mean),
                  pointer(cov), ctypes.byref(e))  # fmt: skip
        return mean, cov, e.value, S


def pointer(numbers):
    assert numbers.flags.c_contiguous
    return numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    made = tmp_path_factory.mktemp("loops") / "loops.so"
    gcc("-DAMB_DOUBLE", LOOPS, "-shared", "-fPIC", ROOT / "core" / "src" / "loops.c", "-o", made)
    return ctypes.CDLL(str(made))


def close(got, expected):
    """A covariance's triangle, each entry beside the variances that it lies between."""
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))[np.triu_indices(len(expected))]
    assert np.all(np.abs(got - expected[np.triu_indices(len(expected))]) <= 1e-9 * size)


SEEDS = range(60)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_prediction_is_that_of_textbooks(seed, library):
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    at = random_point(rng, model)
    mean, cov = Loops(library, model).predict(at)
    L, b = model.L.value, model.b.value
    row = at.k_s[:, None] * model.h.value + at.k_i[:, None] * model.e.value + model.r.value
    A = L + b @ row
    G = (model.B_u.value + b @ (at.k_i[:, None] * model.d.value)) * at.k_ui
    triangle = np.triu_indices(len(L))
    Q = np.zeros_like(L)
    Q[triangle] = at.var_d @ model.N.value
    Q = np.triu(Q) + np.triu(Q, 1).T + G @ np.diag(at.var_u) @ G.T
    terms = np.abs(L) @ np.abs(at.mean) + np.abs(model.B_u.value) @ np.abs(at.iu)
    terms += np.abs(b) @ (np.abs(at.F) + np.abs(model.r.value) @ np.abs(at.mean))
    expected = L @ at.mean + model.B_u.value @ at.iu + b @ (at.F + model.r.value @ at.mean)
    assert np.all(np.abs(mean - expected) <= 1e-12 * terms)
    spread = np.abs(A) @ np.sqrt(np.diag(at.cov)) + np.sqrt(np.diag(Q))  # what may cancel
    got = np.abs(cov - (A @ at.cov @ A.T + Q)[triangle])
    assert np.all(got <= 1e-9 * np.outer(spread, spread)[triangle])


@pytest.mark.parametrize("seed", SEEDS)
def test_an_update_is_that_of_joseph(seed, library):
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    at = random_point(rng, model)
    c = model.c.value
    for r in range(len(c)):
        S_y = float(c[r] @ at.cov @ c[r])
        y, var_y = float(rng.normal()), (S_y or 1.0) * float(10 ** rng.uniform(-2, 2))
        mean, cov, e, S = Loops(library, model).update(r, y, var_y, at)
        K = at.cov @ c[r] / (S_y + var_y)
        left = np.eye(len(K)) - np.outer(K, c[r])
        assert pytest.approx(S_y + var_y, rel=1e-9) == S
        assert e == pytest.approx(y - c[r] @ at.mean, rel=1e-9, abs=1e-9 * np.sqrt(S))
        np.testing.assert_allclose(
            mean, at.mean + K * e, rtol=1e-9, atol=1e-9 * np.abs(K * e).max()
        )
        close(cov, left @ at.cov @ left.T + var_y * np.outer(K, K))


# ---- the order, number by number ----


def total(terms):
    """From the first on; nothing is 0."""
    if not terms:
        return 0.0
    sum_ = terms[0]
    for term in terms[1:]:
        sum_ = sum_ + term
    return sum_


def mean_in_order(model, at):
    X, iu = at.mean.tolist(), at.iu.tolist()
    F = [
        total([f] + [r * X[j] for j, r in model.r.row(at_f)])
        for at_f, f in enumerate(at.F.tolist())
    ]
    return [
        total([value * X[j] for j, value in model.L.row(i)]
              + [value * iu[c] for c, value in model.B_u.row(i)]
              + [value * F[f] for f, value in model.b.row(i)])
        for i in range(len(X))
    ]  # fmt: skip


def covariance_in_order(model, at):
    """The upper triangle one sample on, as core/include/ambkit/model.h orders it."""
    n, forces, controls = len(at.mean), range(len(at.F)), range(len(at.iu))
    P, k_ui, var = at.cov.tolist(), at.k_ui.tolist(), at.var_u.tolist()
    k_i, k_s = at.k_i.tolist(), at.k_s.tolist()
    row, w, g = [], [], []
    for f in forces:
        e, r = dict(model.e.row(f)), dict(model.r.row(f))
        entries = [(j, k_s[f] * h + k_i[f] * e[j] + r[j]) for j, h in model.h.row(f)]
        row.append(entries[::-1])  # from the last to the first
        w.append([total([a * P[x][j] for x, a in row[f]]) for j in range(n)])
        d = dict(model.d.row(f))
        g.append([(k_i[f] * d[c]) * k_ui[c] if c in d else 0.0 for c in controls])
    q = [[total([(g[a][c] * g[b][c]) * var[c] for c in controls]) for b in forces] for a in forces]
    growth = [0.0] * (n * (n + 1) // 2)
    for k, var_k in enumerate(at.var_d.tolist()):
        for entry, value in model.N.row(k):
            growth[entry] += value * var_k
    out = []
    for i in range(n):
        b_i = model.b.row(i)
        B_i = [(c, value * k_ui[c]) for c, value in model.B_u.row(i)]
        M = [
            total([value * P[x][j] for x, value in model.L.row(i)]
                  + [value * w[f][j] for f, value in b_i])
            for j in range(n)
        ]  # fmt: skip
        z = [
            total([value * q[a][f] for a, value in b_i]
                  + [(value * var[c]) * g[f][c] for c, value in B_i]
                  + [M[x] * a for x, a in row[f]])
            for f in forces
        ]  # fmt: skip
        moved = [
            total([value for at_c, value in B_i if at_c == c]
                  + [value * g[f][c] for f, value in b_i]) * var[c]
            for c in controls
        ]  # fmt: skip
        for j in range(i, n):
            out.append(
                total([M[x] * value for x, value in model.L.row(j)]
                      + [growth[len(out)]]
                      + [(value * k_ui[c]) * moved[c] for c, value in model.B_u.row(j)]
                      + [value * z[f] for f, value in model.b.row(j)])
            )  # fmt: skip
    return out


def update_in_order(model, r, y, var_y, at):
    n, X, P, c = len(at.mean), at.mean.tolist(), at.cov.tolist(), model.c.row(r)
    with_y = [total([P[x][j] * value for x, value in c]) for j in range(n)]
    S = total([value * with_y[x] for x, value in c]) + var_y
    e = y - total([value * X[x] for x, value in c])
    inverse = 1.0 / S
    K = [at_i * inverse for at_i in with_y]
    mean = [X[i] + K[i] * e for i in range(n)]
    return mean, [P[i][j] - K[i] * with_y[j] for i in range(n) for j in range(i, n)]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_order_of_the_sums_is_the_contract(seed, library):
    rng = np.random.default_rng(1000 + seed)
    model = random_model(rng)
    at = random_point(rng, model)
    loops = Loops(library, model)
    mean, cov = loops.predict(at)
    assert mean.tolist() == mean_in_order(model, at)
    assert cov.tolist() == covariance_in_order(model, at)
    r = int(rng.integers(len(model.c.value)))
    after, left, _, _ = loops.update(r, 0.3, 0.7, at)
    assert (after.tolist(), left.tolist()) == update_in_order(model, r, 0.3, 0.7, at)
