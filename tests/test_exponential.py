"""exp(-t) without libm: to a relative 2 eps, everywhere, in both builds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambkit.machine.magnets import core_module

LARGEST = {"float64": 708.0, "float32": 87.0}
"""From here on the result stays what it is, the smallest that is still a normal number."""


def exp_negative(t, precision):
    return core_module(precision).exp_negative(np.ascontiguousarray(t, dtype=precision))


def relative_error(t, precision):
    """Greatest relative error in machine epsilons, against an exponential of higher precision."""
    given_t = t.astype(precision)
    got = exp_negative(given_t, precision)
    # The sums behind longdouble's exp are 64 bits wide on x86; for float32, double is plenty.
    exact = np.exp(-given_t.astype(np.longdouble if precision == "float64" else np.float64))
    error = np.abs(got.astype(exact.dtype) / exact - 1)
    return float(np.max(error) / np.finfo(precision).eps)


@pytest.mark.parametrize("precision", LARGEST)
def test_the_relative_error_stays_below_two_epsilons(precision):
    if precision == "float64" and np.finfo(np.longdouble).nmant <= 52:
        pytest.skip("this machine's long double is no wider than double")
    top = LARGEST[precision]
    dense = np.linspace(0, top, 400_001)
    near_zero = np.logspace(-30, 0, 20_001)
    # Where the nearest multiple of ln 2 changes, the polynomial is at the end of its range.
    edges = (np.arange(int(top / np.log(2))) + 0.5) * np.log(2)
    for t in (dense, near_zero, np.nextafter(edges, 0), edges, np.nextafter(edges, top)):
        assert relative_error(t, precision) < 2


@pytest.mark.parametrize("precision", LARGEST)
def test_special_values(precision):
    tiny = np.finfo(precision).tiny
    top = LARGEST[precision]
    got = exp_negative(np.array([0.0, top, 2 * top, 1e30, np.inf, np.nan]), precision)
    assert got[0] == 1
    assert (got[1:] == got[1]).all()
    assert tiny <= got[1] < 10 * tiny


@given(st.floats(0, 1000), st.floats(0, 1000))
def test_it_falls_and_multiplies(a, b):
    low, high = min(a, b), max(a, b)
    at_low, at_high, together = exp_negative(np.array([low, high, a + b]), "float64")
    # Two neighbours may come out in the wrong order by what the error allows, no more.
    assert at_high <= at_low * (1 + 4 * np.finfo(float).eps)
    if a + b < 700:
        # A rounding of a + b is an absolute error of the exponent.
        room = 8 * np.finfo(float).eps * (1 + a + b)
        assert together == pytest.approx(at_low * at_high, rel=room)
