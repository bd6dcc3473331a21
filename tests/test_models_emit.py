"""C of a model, as straight lines and by loops: the bits of naive loops, the paper's axis's text.

The order of the sums is a contract: both ways of building a model keep it, and whoever writes one
as code in that order gets the same bits (core/include/ambkit/model.h).
"""

import ctypes
import re
import shutil
import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from filter_cases import BEARING
from model_oracles import Loops, Settings, added, random_model, random_settings, random_state

from ambkit.export.c import c_literals
from ambkit.export.c.model import loop_model
from ambkit.models import compose, emit, machine_model
from ambkit.models.emit import steps
from ambkit.models.emit.header import predict_covariance
from ambkit.models.machine_parts import PAPER_CONSTANTS
from ambkit.models.model import ENUMERATORS, ROLES
from ambkit.models.parts import (
    Amplifier,
    ColouredNoise,
    Delay,
    Disturbance,
    Hum,
    MagnetForce,
    Rotor,
    Sensor,
)

ROOT = Path(__file__).resolve().parent.parent
COMPILER = shutil.which("gcc") or shutil.which("clang") or shutil.which("cc")
compiled = pytest.mark.skipif(COMPILER is None, reason="no C compiler (gcc, clang or cc) here")

double = ctypes.c_double


class Compiled:
    """The functions of a model, on arrays: of its header, or of the core's loops."""

    def __init__(self, model, folder, naming=None, loops=False):
        names = emit.Names(model, naming)
        self.names, self.n, self.size = names, names.n, len(names.pairs)
        (folder / "generated").mkdir()
        header = emit.header(names, "A model of a test")
        assert max(map(len, header.splitlines())) <= 100
        (folder / "generated" / "model.h").write_text(header)
        filled = f"static const amb_model model = {emit.initialiser(self.names, model)};\n"
        sources, options = [folder / "model.c"], ["-DAMB_DOUBLE"]
        if loops:
            filled, options = by_loops(model)
            folder_of_core = ROOT / "core" / "src"
            sources += [folder_of_core / "loops.c", folder_of_core / "covariance_loops.c"]
        sources[0].write_text(self.source(filled))
        library = folder / "model.so"
        optimised = "-O1" if self.n < 6 and not loops else "-O0"  # at 40 states it takes a minute
        optimised = "-O3" if loops and self.n > 10 else optimised  # by blocks of columns
        command = [
            str(COMPILER), "-std=c99", optimised, "-ffp-contract=off", "-shared", "-fPIC", "-Wall",
            "-Wextra", "-Wconversion", "-Werror", *options, f"-I{folder}",
            f"-I{ROOT / 'core' / 'include'}", f"-I{ROOT / 'core'}", "-o", str(library),
            *map(str, sources),
        ]  # fmt: skip
        subprocess.run(command, check=True, cwd=folder)
        self.library = ctypes.CDLL(str(library))

    def source(self, filled):
        """Functions with a symbol of their own, and those of one force for all of them."""
        p, m = self.names.p, self.names.m
        call = {
            "growth(const double *var, double *growth)": "amb_model_growth(&model, var, growth)",
            "mean(const double *F, const double *iu, double *mean)":
                "amb_model_predict_mean(&model, F, iu, mean)",
            "covariance(const double *k_i, const double *k_s, const double *k_ui, "
            "const double *var_u, const double *growth, double *cov)":
                f"amb_stiffness k[{p}]; double work[AMB_WORK];"
                f"for (int f = 0; f < {p}; f++) {{ k[f].k_i = k_i[f]; k[f].k_s = k_s[f]; }}"
                "amb_model_predict_covariance(&model, k, k_ui, var_u, growth, cov, work)",
            "displacement(const double *mean, double *s)":
                f"for (int f = 0; f < {p}; f++) s[f] = amb_model_displacement(&model, f, mean)",
            "current(const double *mean, const double *iu, double *i)":
                f"for (int f = 0; f < {p}; f++) i[f] = amb_model_current(&model, f, mean, iu)",
            "pushed(double *moved)":
                f"for (int f = 0; f < {p}; f++) "
                "amb_model_pushed(&model, f, &moved[f * AMB_STATES])",
            "shown(const double *mean, double *shown)":
                f"for (int r = 0; r < {m}; r++) shown[r] = amb_model_shown(&model, r, mean)",
            "shown_variance(const double *cov, double *shown)":
                f"for (int r = 0; r < {m}; r++) "
                "shown[r] = amb_model_shown_variance(&model, r, cov)",
            "measurement_update(const double *cov, double *with)":
                f"for (int r = 0; r < {m}; r++) "
                "amb_model_shown_with(&model, r, cov, &with[r * AMB_STATES])",
            "at_rest(double *mean)": "amb_model_equilibrium(&model, mean)",
            "roles(double *role)":
                "for (int i = 0; i < amb_states(&model); i++) role[i] = amb_model_role(&model, i)",
        }  # fmt: skip
        for r in range(m):
            call[f"update_{r}(double y, double var_y, double *mean, double *cov, double *out)"] = (
                f"out[1] = amb_model_shown_variance(&model, {r}, cov) + var_y; "
                f"amb_model_update(&model, {r}, y, out[1], mean, cov, &out[0])"
            )
        functions = "".join(f"void {head};\nvoid {head}\n{{ {body}; }}\n"
                            for head, body in call.items())  # fmt: skip
        return f'#include "ambkit/model.h"\n{filled}{functions}'

    def call(self, function, *arguments):
        """Arrays are given as they are, and changed in place."""
        given = [
            double(at) if isinstance(at, float) else at.ctypes.data_as(ctypes.POINTER(double))
            for at in arguments
        ]
        self.library[function](*given)

    def triangle(self, P):
        return np.ascontiguousarray(P[np.triu_indices(self.n)])

    def square(self, cov):
        P = np.zeros((self.n, self.n))
        P[np.triu_indices(self.n)] = cov
        return np.triu(P) + np.triu(P, 1).T


def by_loops(model):
    """The model as arrays, and what makes the core's loops have room for it."""
    made = loop_model(model)
    listed = "".join(
        f"static const {one['type']} {one['name']}[] = {{{one['text']}}};\n"
        for one in c_literals.declared(made.arrays, "double")
    )
    filled = f"static const amb_model model = {c_literals.struct(made.numbers, 'double')};\n"
    room = [f"-DAMB_{name}={count}" for name, count in made.room.items()]
    return listed + filled, ["-DAMB_DOUBLE", "-DAMB_MODEL_LOOPS", *room]


def same_bits(model, s, folder, naming=None, loops=False):
    """A few whole samples: displacement, current, prediction, all updates."""
    code, rng = Compiled(model, folder, naming, loops), np.random.default_rng(1)
    loops = Loops(model)
    X, P = random_state(model, 2)
    size = np.array([at.size for at in model.states])
    X, P = X * size, P * np.outer(size, size)
    mean, cov, growth = X.copy(), code.triangle(P), np.zeros(code.size)
    code.call("growth", s.var_noise, growth)
    G = loops.growth(s.var_noise)
    np.testing.assert_array_equal(code.square(growth), G)
    for _ in range(5):
        u, F = rng.uniform(-1, 1, len(model.controls)), rng.uniform(-1, 1, len(model.forces))
        found = np.zeros(len(model.forces))
        code.call("displacement", mean, found)
        np.testing.assert_array_equal(found, loops.displacement(X))
        code.call("current", mean, u, found)
        np.testing.assert_array_equal(found, loops.current(X, u))
        code.call("mean", F, u, mean)
        X = loops.predict_mean(X, F, u)
        np.testing.assert_array_equal(mean, X)
        code.call("covariance", s.k_i, s.k_s, s.k_ui, s.var_u, growth, cov)
        P = loops.predict_covariance(P, s, G)
        np.testing.assert_array_equal(code.square(cov), P)
        _same_shown(code, loops, X, P)
        for r, var in enumerate(s.var_y.tolist()):
            y, out = float(rng.uniform(-1, 1)) * model.measurements[r].size, np.zeros(2)
            code.call(f"update_{r}", y, var, mean, cov, out)
            X, P, e, S = loops.update(r, y, var, X, P)
            np.testing.assert_array_equal(mean, X)
            np.testing.assert_array_equal(code.square(cov), P)
            np.testing.assert_array_equal(out, [e, S])
    _same_structure(code, model, X)
    assert (X != 0).any()
    assert np.linalg.eigvalsh(P / np.outer(size, size)).min() > 0


def _same_shown(code, loops, X, P):
    """What all sensors show of a state, its variance, and its covariance with the states."""
    m = len(loops.rows["c"])
    shown, variance, with_y = np.zeros(m), np.zeros(m), np.zeros((m, code.n))
    code.call("shown", X, shown)
    code.call("shown_variance", code.triangle(P), variance)
    code.call("measurement_update", code.triangle(P), with_y)
    for r, row in enumerate(loops.rows["c"]):
        PH = [added(c * float(P[i, j]) for j, c in row) for i in range(code.n)]
        np.testing.assert_array_equal(with_y[r], PH)
        assert variance[r] == added(c * PH[j] for j, c in row)
        assert shown[r] == added(c * float(X[j]) for j, c in row)


def _same_structure(code, model, X):
    """What forces move, what each state is, and what sensors show at rest."""
    moved, roles, rest = np.zeros((len(model.forces), code.n)), np.zeros(code.n), X.copy()
    code.call("pushed", moved)
    np.testing.assert_array_equal(moved, model.b.T)
    code.call("roles", roles)
    assert [ROLES[at.role] for at in model.states] == [ENUMERATORS[int(at)] for at in roles]
    code.call("at_rest", rest)
    shows = np.array([at.role == "sensor" for at in model.states])
    np.testing.assert_allclose(rest[shows], (model.rest @ X)[shows], rtol=1e-15)
    np.testing.assert_array_equal(rest[~shows], X[~shows])


@compiled
def test_the_axis_s_code_has_the_bits_of_the_loops(tmp_path):
    model = machine_model(BEARING)
    s = Settings(*(np.array([at]) for at in (10.05, 7537.5, 1.0, 8e-5, 1e-3, 8.3e-11)))
    same_bits(model, s, tmp_path, PAPER_CONSTANTS)


@compiled
def test_an_axis_of_all_parts_has_the_bits_of_the_loops(tmp_path):
    """Names of states beside names of arguments: the amplifier's current is i."""
    model = compose([
        Rotor(0.5, 1e-3, 0.1), MagnetForce(10.0), Disturbance(10.0, 0.01), Sensor(0.8, None, 1e-3),
        Amplifier(1.0, 2000.0), Delay(1.5e-4, 1.0), ColouredNoise(1e-12, 200.0),
        Hum(50.0, 5e-6, 0.5),
    ], 1e-4, name="axis")  # fmt: skip
    one = (10.05, 7537.5, 0.7, 8e-5)
    s = Settings(*(np.array([at]) for at in one), np.array([1e-3, 1e-12, 1e-11]), np.array([8e-11]))
    same_bits(model, s, tmp_path)


SMALL = [(2, 1, 1, 4), (3, 4, 6, 2), (5, 1, 2, 4), (8, 2, 2, 3), (11, 3, 1, 2), (16, 4, 4, 2)]


@compiled
@pytest.mark.parametrize(("n", "p", "m", "seeds", "controlled", "loops"), [
    *((*size, *ways) for size in SMALL for ways in product((False, True), repeat=2)),
    (40, 8, 10, 2, True, True),
    pytest.param(40, 8, 10, 1, True, False, marks=pytest.mark.long),
])  # fmt: skip
def test_random_patterns_have_the_bits_of_the_loops(n, p, m, seeds, controlled, loops, tmp_path):
    for seed in range(seeds):
        folder = tmp_path / str(seed)
        folder.mkdir()
        model = random_model(seed, n, p, m, controlled=controlled)
        same_bits(model, random_settings(model, seed), folder, loops=loops)


@pytest.mark.parametrize(("n", "p", "m"), [(4, 1, 1), (9, 3, 4)])
def test_the_loops_are_the_textbook_s_filter(n, p, m):
    """A P A' + Q and P - K S K', in full matrices."""
    for seed in range(10):
        model = random_model(seed, n, p, m)
        s, loops = random_settings(model, seed), Loops(model)
        X, P = random_state(model, seed)
        A = model.jacobian(s.k_i, s.k_s)
        Q = model.process_noise(s.k_i, s.var_u * s.k_ui**2, s.var_noise)
        got = loops.predict_covariance(P, s, loops.growth(s.var_noise))
        np.testing.assert_allclose(got, A @ P @ A.T + Q, rtol=1e-11, atol=1e-13)
        for r, (c, var) in enumerate(zip(model.c, s.var_y.tolist(), strict=True)):
            mean, new, e, S = loops.update(r, 0.3, var, X, P)
            K = P @ c / (c @ P @ c + var)
            assert (e, S) == pytest.approx((0.3 - c @ X, c @ P @ c + var), abs=1e-13)
            np.testing.assert_allclose(mean, X + K * (0.3 - c @ X), atol=1e-12)
            np.testing.assert_allclose(new, P - S * np.outer(K, K), atol=1e-12)


FUNCTIONS = [
    steps.displacement, steps.predict_mean, predict_covariance, steps.update,
]  # fmt: skip


@pytest.mark.parametrize("function", FUNCTIONS)
def test_the_paper_s_axis_has_the_text_that_flies(function):
    """Each statement of the header in core/generated."""

    def code(text):
        return re.sub(r"\s+", " ", re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL))

    flies = code((ROOT / "core" / "generated" / "axial.h").read_text())
    text = code(function(emit.Names(machine_model(BEARING), PAPER_CONSTANTS))).strip()
    assert text.count(";") >= 1
    assert text in flies


def test_a_one_by_structure_costs_no_product():
    names = emit.Names(machine_model(BEARING), PAPER_CONSTANTS)
    assert list(names.constants.values())[:4] == ["T", "T_2", "T_m", "T2_2m"]
    assert "AMB_C(1.0) *" not in emit.header(names, "x")
    assert "mean[2] =" not in steps.predict_mean(names)  # f_d stays what it is


def test_numbers_are_those_of_a_model_of_the_pattern():
    names = emit.Names(machine_model(BEARING), PAPER_CONSTANTS)
    lighter = machine_model(BEARING.replace(rotor__mass="0.5 kg"))
    found = emit.constants(names, lighter)
    assert list(found) == list(PAPER_CONSTANTS.values())
    assert found["T_m"] == lighter.b[1, 0]
    with pytest.raises(ValueError, match="of another pattern than the struct"):
        emit.constants(names, random_model(0, 4, 1, 1))
    with pytest.raises(ValueError, match=r"the pattern has no number at \[\('L', 0, 0\)\]"):
        emit.Names(lighter, {("L", 0, 0): "one"})
