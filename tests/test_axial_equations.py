"""The paper's eq. 15-21 as symbols: what is printed, and what the core computes.

That the steps in C are those of textbooks is in test_models_emit and test_sampled_model.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from ambkit import FilterNoise, KalmanFilter, Machine
from ambkit.models.machine_parts import PAPER_CONSTANTS
from models import axial as ax
from models.exponential import coefficients

ROOT = Path(__file__).resolve().parent.parent
MODEL = ax.axial
BEARING = Machine.preset("zittau_axial")


def test_one_changed_sign_is_noticed(tmp_path, monkeypatch, capsys):
    from models import __main__ as writer

    headers = writer.axial_headers()  # all texts are compared by ./test
    monkeypatch.setattr(writer, "texts", lambda: headers)
    for name in headers:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copy(ROOT / ".clang-format", tmp_path)
    header = tmp_path / "core" / "generated" / "axial.h"
    header.write_text(header.read_text().replace("P22 + growth[7]", "P22 - growth[7]"))
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


@pytest.mark.parametrize("printed", [False, True])
def test_the_core_s_matrices_are_those_of_the_equations(printed):
    k_i, k_s = 7.1, 32160.0
    values = {
        ax.T: BEARING.sampling_time, ax.m: BEARING.rotor.mass, ax.K_sen: BEARING.sensor.gain,
        ax.T_sen: BEARING.sensor.lag, ax.k_ui: BEARING.amplifier.gain, ax.k_i: k_i, ax.k_s: k_s,
        ax.var_d: 1.0,
    }  # fmt: skip
    form = as_printed if printed else physical
    A, B, N = (np.array(form(matrix).subs(values), dtype=float)
               for matrix in (MODEL.A, MODEL.B, MODEL.own_noise))  # fmt: skip
    kf = KalmanFilter(BEARING, as_printed=printed, noise=FilterNoise(control=0.0, disturbance=1.0))
    found = kf.linear_model(k_i, k_s)
    np.testing.assert_allclose(found.A, A, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(found.B, B, rtol=1e-12, atol=1e-18)
    size = np.sqrt(np.outer(np.diag(N), np.diag(N)))
    assert (np.abs(found.Q / BEARING.sampling_time - N) <= 1e-4 * size + 1e-60).all()


def test_each_constant_has_its_closed_form():
    known = {str(s) for s in (*MODEL.kept, *MODEL.constants, *MODEL.growth_constants)}
    assert known == set(PAPER_CONSTANTS.values())


@pytest.mark.parametrize(("degree", "bound"), [(6, 2.5e-9), (11, 4.2e-18)])
def test_the_polynomial_is_as_close_to_exp_as_it_says(degree, bound):
    mp = pytest.importorskip("mpmath")
    with mp.workdps(40):
        terms = coefficients(degree)
        half = mp.log(2) / 2
        points = [half * (2 * mp.mpf(k) / 400 - 1) for k in range(401)]
        worst = max(abs(mp.polyval(terms[::-1], r) / mp.exp(r) - 1) for r in points)
    assert bound / 3 < worst <= 1.05 * bound
