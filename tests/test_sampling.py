"""The core's exponential and what noise leaves over a time, against 50 digits."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import ambkit
from ambkit.machine.magnets import core_module
from ambkit.models.declaration import Plan
from ambkit.models.machine_parts import machine_parts
from ambkit.models.sampling import Sampling

CORE = core_module()
EPS = np.finfo(float).eps
QUICK = settings(max_examples=20, deadline=None, phases=set(Phase) - {Phase.shrink, Phase.explain})
PRESETS = ["zittau_axial", "inteco_ml", "tum_mlps"]


HALVINGS = 34


def exact(A, time):
    """The exponential by its series over a share of the time, in 60 digits."""
    with mp.workdps(60):
        share = mp.matrix(A.tolist()) * mp.mpf(float(time)) / mp.mpf(2) ** HALVINGS
        Phi, term = mp.eye(len(A)), mp.eye(len(A))
        for k in range(1, 10 + len(A) // 3):
            term = term * share / k
            Phi += term
        for _ in range(HALVINGS):
            Phi = Phi * Phi
        return Phi


def exact_noise(A, intensity, time):
    """Van Loan's blocks in 60 digits: they cancel, but not all of these."""
    n = len(A)
    blocks = np.block([[-A, np.diag(intensity)], [np.zeros((n, n)), A.T]])
    with mp.workdps(60):
        whole = exact(blocks, time)
        return whole[n:, n:].T * whole[:n, n:]


def off(got, right, of=None):
    """Greatest error in machine epsilons of the entries, or of what they are sums of."""
    right = np.array(right.tolist(), object)
    size = np.abs(right if of is None else of)
    there = size > 1e-280
    assert (got[~there] == 0).all()
    error = [abs(mp.mpf(float(g)) - r) / s for g, r, s in zip(
        got[there], right[there], size[there], strict=True)]  # fmt: skip
    return float(max(error)) / EPS


def system(lag, bandwidth, damping, k_s, T):
    """Current, mass of 2 kg on a spring that may push, lagged sensor; a force held."""
    A = np.zeros((5, 5))  # x, v, i, x_m, f
    A[0, 1], A[1, 0], A[1, 1], A[1, 2], A[1, 4] = 1, k_s / 2, -damping / 2, 10 / 2, 1 / 2
    A[2, 2], A[3, 0], A[3, 3] = -2 * math.pi * bandwidth / T, 1 / (lag * T), -1 / (lag * T)
    return A


systems = st.builds(
    lambda lag, bandwidth, damping, k_s, T: (system(10**lag, 10**bandwidth, damping, k_s, T), T),
    st.floats(-4, 3), st.floats(-3, 2), st.sampled_from([0.0, 3.0, 300.0]),
    st.sampled_from([0.0, 8e3, 5e4]), st.sampled_from([2e-5, 1e-4, 1e-3]),
)  # fmt: skip
"""Lags from a ten-thousandth of a sample to a thousand of them."""


@QUICK
@given(systems)
def test_an_axis_has_its_digits(case):
    """Of the sums of magnitudes that they are, but for what decays by itself."""
    A, T = case
    magnitudes = np.array(exact(np.abs(np.where(np.eye(5, dtype=bool), 0, A)), T).tolist(), float)
    assert off(CORE.transition(A, T), exact(A, T), of=np.maximum(magnitudes, 1e-300)) < 8


@pytest.mark.parametrize("preset", PRESETS)
def test_a_machine_has_them_as_well_as_a_library(preset):
    """Beside SciPy's Padé approximant; of four axes what the levers cancel is lost to both."""
    machine = ambkit.preset(preset)
    plan = Plan(machine.sampling_time)
    for part in machine_parts(machine):
        plan.add(part)
    A, T = Sampling(plan).generator(0.0), plan.T
    right = exact(A, T)
    ours, library = off(CORE.transition(A, T), right), off(expm(A * T), right)
    assert ours < (3 if machine.single else 3e3)
    assert ours <= 1.1 * library


@QUICK
@given(systems, st.lists(st.sampled_from([0.0, 1.0, 1e-6, 1e3]), min_size=5, max_size=5))
def test_noise_is_that_of_van_loan_s_blocks(case, intensity):
    A, T = case
    T = min(T, 30 / np.abs(A).max())  # beyond, what the blocks hold of exp(-A T) has no digits left
    got = CORE.process_noise(A, np.array([intensity]), T)[0]
    right = np.array(exact_noise(A, intensity, T).tolist(), float)
    size = np.sqrt(np.diag(right))
    np.testing.assert_allclose(got, right, rtol=1e-13, atol=1e-14 * np.outer(size, size).max())
    assert (got == got.T).all()


@given(systems, st.lists(st.integers(-6, 6), min_size=5, max_size=5))
def test_any_units_give_the_same(case, powers):
    A, T = case
    unit = 10.0 ** np.array(powers)
    scale, intensity = unit[:, None] / unit, np.array([[0, 1, 0.5, 0, 2.0]])
    Phi, N = CORE.transition(A, T), CORE.process_noise(A, intensity, T)
    np.testing.assert_allclose(CORE.transition(A * scale, T), Phi * scale, rtol=1e-12)
    in_units = CORE.process_noise(A * scale, intensity * unit**2, T)
    np.testing.assert_allclose(in_units, N * np.outer(unit, unit), rtol=1e-12)


@given(systems)
def test_a_sample_is_two_of_half_the_time(case):
    A, T = case
    intensity = np.array([[0, 1, 0.5, 0, 2.0]])
    Phi, half = CORE.transition(A, T), CORE.transition(A, T / 2)
    size = np.abs(half) @ np.abs(half)
    assert (np.abs(half @ half - Phi) <= 1e-14 * size + 1e-300).all()
    N, at_half = CORE.process_noise(A, intensity, T)[0], CORE.process_noise(A, intensity, T / 2)[0]
    both = at_half + half @ at_half @ half.T
    size = np.sqrt(np.outer(np.diag(N), np.diag(N)))
    there = size > 0
    np.testing.assert_allclose(both[there] / size[there], N[there] / size[there], atol=1e-13)


def test_many_matrices_at_once_are_those_of_one_after_the_other():
    A = np.stack([system(0.5, 0.1, 3.0, k, 1e-4) for k in (0.0, 8e3, 5e4)])
    together = CORE.transition(A, 1e-4)
    assert all((together[k] == CORE.transition(A[k], 1e-4)).all() for k in range(3))
    assert CORE.transition(np.zeros((0, 2, 2)), 1.0).shape == (0, 2, 2)


def test_what_cannot_be_is_refused():
    for bad in (math.nan, math.inf):
        with pytest.raises(ValueError, match="a continuous model must be finite"):
            CORE.transition(np.full((2, 2), bad), 1.0)
    with pytest.raises(ValueError, match="must be square"):
        CORE.transition(np.zeros((2, 3)), 1.0)
    with pytest.raises(ValueError, match="intensity, in states"):
        CORE.process_noise(np.zeros((2, 2)), np.zeros((1, 3)), 1.0)
