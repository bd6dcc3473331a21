"""The generated C is what the models say, and its constants and sums are the paper's eq. 15-21."""

import random
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from quick import quick

from ambkit.models.machine_parts import PAPER_CONSTANTS
from models import axial as ax
from models.exponential import coefficients

ROOT = Path(__file__).resolve().parent.parent
MODEL = ax.axial
HEADER = (ROOT / "core" / "generated" / "axial.h").read_text(encoding="utf-8")


def test_one_changed_sign_is_noticed(tmp_path, monkeypatch, capsys):
    from models import __main__ as writer

    headers = writer.axial_headers()  # all texts are compared by ./test
    monkeypatch.setattr(writer, "texts", lambda: headers)
    for name in headers:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / ".clang-format", tmp_path)
    header = tmp_path / "core" / "generated" / "axial.h"
    header.write_text(header.read_text().replace("cov[7] = P22 + G22", "cov[7] = P22 - G22"))
    monkeypatch.setattr(writer, "ROOT", tmp_path)
    monkeypatch.setattr(sys, "argv", ["models", "--check"])
    assert writer.main() == 1
    told = capsys.readouterr().err.splitlines()
    assert told == ["core/generated/axial.h is not what the models say"]


def physical(matrix):
    """Put the physical parameters in for the constants that are computed once."""
    z, t = sp.symbols("z t")
    phi = [sp.exp(-z)]
    for k in range(3):
        phi.append((sp.Rational(1, sp.factorial(k)) - phi[k]) / z)
    told = matrix.subs(MODEL.growth_constants).subs(MODEL.constants).subs(MODEL.factors)
    for k, function in enumerate((ax.phi1, ax.phi2, ax.phi3), start=1):
        told = told.replace(function, sp.Lambda(t, phi[k].subs(z, t)))
    return told


def as_printed(matrix):
    """What is left of it for the paper's equations."""
    return physical(matrix.subs(dict.fromkeys((*MODEL.printed, *MODEL.growth_constants), 0)))


def same(a, b):
    return sp.simplify(a - b) == sp.zeros(*a.shape)


def moved(t, f):
    """State of the continuous model the time t after `MODEL.state`, all force f constant since."""
    tau = sp.Symbol("tau", positive=True)
    x, v, f_d, x_m = MODEL.state
    path = x + v * tau + f / ax.m * tau**2 / 2
    lagged = sp.integrate(sp.expand(path * sp.exp(tau / ax.T_sen)), (tau, 0, t)) / ax.T_sen
    decay = sp.exp(-t / ax.T_sen)
    return sp.Matrix([
        path.subs(tau, t), v + f / ax.m * t, f_d, decay * (x_m + ax.K_sen * lagged)
    ])  # fmt: skip


def test_the_sampled_model_is_the_continuous_one_with_the_force_held():
    F = sp.Symbol("F")
    L, b = MODEL.held
    assert same(physical(L * sp.Matrix(MODEL.state) + b * F), moved(ax.T, F))


def test_the_magnet_is_asked_at_the_mean_of_the_sample():
    t = sp.Symbol("t")
    mean = sp.integrate(ax.x + ax.v * t, (t, 0, ax.T)) / ax.T
    assert sp.simplify(MODEL.displacement.subs(MODEL.constants) - mean) == 0


@pytest.mark.parametrize("lag", quick([1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0, 100.0], [1e-2, 0.3, 100.0]))
def test_the_growth_of_the_load_is_its_integral(lag):
    """A growth of the load at any time within the sample, each as likely: the mean of its traces.

    The four points do not see all of the sensor's exponential; of what it makes they see four
    digits at the worst, with a lag of a few hundredths of a sample, else six and more.
    """
    values = {ax.T: 1, ax.m: 1, ax.K_sen: 1, ax.T_sen: sp.Rational(str(lag))}
    t = sp.Symbol("t", positive=True)
    still = dict.fromkeys(MODEL.state, 0)
    trace = (moved(t, sp.Integer(1)).subs(still) + sp.Matrix([0, 0, 1, 0])).subs(values)
    exact = (trace * trace.T).applyfunc(lambda e: sp.integrate(sp.expand(e), (t, 0, 1)).evalf(40))
    ours = physical(MODEL.own_noise).subs(values).subs(MODEL.growth_variance, 1).evalf(40)
    error = (ours - exact).applyfunc(abs)
    d = [sp.sqrt(exact[i, i]) for i in range(4)]
    assert max(error[i, j] / (d[i] * d[j]) for i in range(4) for j in range(4)) < 1e-4
    assert max(error[:3, :3]) < 1e-15


def test_as_printed_the_system_is_eq_20_and_21():
    T, m, K_sen, T_sen = ax.T, ax.m, ax.K_sen, ax.T_sen
    k_i, k_s, k_ui = ax.k_i, ax.k_s, ax.k_ui
    A = sp.Matrix([
        [1 + T**2 / (2 * m) * k_s, T, T**2 / (2 * m), 0],
        [T / m * k_s, 1, T / m, 0],
        [0, 0, 1, 0],
        [K_sen * (1 - sp.exp(-T / T_sen)), 0, 0, sp.exp(-T / T_sen)],
    ])  # fmt: skip
    B = sp.Matrix([T**2 / (2 * m) * k_i * k_ui, T / m * k_i * k_ui, 0, 0])
    assert same(as_printed(MODEL.A), A)
    assert same(as_printed(MODEL.B), B)
    assert same(as_printed(MODEL.H), sp.Matrix([[0, 0, 0, 1]]))
    Q = B * B.T * ax.var_u + sp.diag(0, 0, ax.var_d, 0)
    assert same(as_printed(MODEL.Q), Q)


def test_the_covariance_step_is_eq_10():
    P = MODEL.covariance()
    assert P == P.T
    written_out = MODEL.A * P * MODEL.A.T + MODEL.Q
    assert same(MODEL.predicted_covariance(), written_out)
    assert same(MODEL.predicted_covariance(), MODEL.predicted_covariance().T)


def computed(function, given):
    """Run a function of the header on symbols; return the entries that it stores.

    given: what stands in its arguments, by the text that reads it.
    """
    body = re.search(rf"amb_model_{function}\(.*?\n{{\n(.*?)\n}}\n", HEADER, re.DOTALL)
    known, stored = dict(given), {}
    place = re.compile(r"\w+(?:->\w+|\[\d\](?:\.\w+)?)?")
    for statement in re.sub(r"\s+", " ", body[1]).split(";")[:-1]:
        target, _, expression = statement.strip().partition(" = ")
        if not expression:
            continue  # (void)work
        read = place.sub(lambda match: f"known[{match[0]!r}]", expression)
        found = sp.expand(eval(read, {"known": known}))
        if target.startswith("const amb_real "):
            known[target.removeprefix("const amb_real ")] = found
        else:
            stored[target] = found
    return stored


CONSTANTS = {f"model->{name}": sp.Symbol(name) for name in PAPER_CONSTANTS.values()} | {
    f"model->{p}": p for p in MODEL.parameters
}


def test_the_covariance_step_of_the_header_is_eq_10():
    given = CONSTANTS | {
        "k[0].k_i": ax.k_i, "k[0].k_s": ax.k_s, "k_ui[0]": ax.k_ui, "var_u[0]": ax.var_u,
    }  # fmt: skip
    P = MODEL.covariance()
    for at, (i, j) in enumerate(MODEL.triangle()):
        given |= {f"cov[{at}]": P[i, j], f"growth[{at}]": sp.Symbol(f"G{i}{j}")}
    stored = computed("predict_covariance", given)
    expected = MODEL.predicted_covariance()
    assert len(stored) == 10
    for at, (i, j) in enumerate(MODEL.triangle()):
        entry = stored[f"cov[{at}]"].subs(MODEL.growth_in_sample)
        assert sp.expand(entry - expected[i, j]) == 0


def test_the_mean_step_of_the_header_is_eq_9():
    given = CONSTANTS | {f"mean[{i}]": state for i, state in enumerate(MODEL.state)}
    stored = computed("predict_mean", given | {"F[0]": ax.f})
    for i, after in enumerate(MODEL.forced):
        assert sp.expand(stored.get(f"mean[{i}]", MODEL.state[i]) - after) == 0


def test_each_constant_has_its_closed_form():
    known = {str(s) for s in (*MODEL.kept, *MODEL.constants, *MODEL.growth_constants)}
    assert known == set(PAPER_CONSTANTS.values())


@pytest.mark.parametrize("seed", range(5))
def test_the_jacobian_agrees_with_central_differences_of_the_transition(seed):
    draw = random.Random(seed)
    values = {
        ax.T: 1e-4, ax.m: 0.5, ax.K_sen: draw.uniform(0.5, 2), ax.T_sen: 2e-4, ax.k_ui: 0.8,
        ax.k_i: draw.uniform(5, 15), ax.k_s: draw.uniform(5e3, 3e4),
    }  # fmt: skip
    transition = sp.lambdify([MODEL.state], physical(MODEL.linear).subs(values).subs(ax.u, 0.3))
    A = np.array(physical(MODEL.A).subs(values), dtype=float)
    at = np.array([draw.uniform(-5e-4, 5e-4), draw.uniform(-0.1, 0.1), draw.uniform(-5, 5), 1e-4])
    scale = np.array([1e-4, 1e-1, 1.0, 1e-4])
    for j in range(4):
        step = np.zeros(4)
        step[j] = scale[j]
        difference = (transition(at + step) - transition(at - step)).ravel() / (2 * scale[j])
        np.testing.assert_allclose(difference, A[:, j], rtol=1e-9, atol=1e-10 * np.abs(A).max())


@pytest.mark.parametrize(("degree", "bound"), [(6, 2.5e-9), (11, 4.2e-18)])
def test_the_polynomial_is_as_close_to_exp_as_it_says(degree, bound):
    mp = pytest.importorskip("mpmath")
    with mp.workdps(40):
        terms = coefficients(degree)
        half = mp.log(2) / 2
        points = [half * (2 * mp.mpf(k) / 400 - 1) for k in range(401)]
        worst = max(abs(mp.polyval(terms[::-1], r) / mp.exp(r) - 1) for r in points)
    assert bound / 3 < worst <= 1.05 * bound
