"""The root between two numbers, beside SciPy's."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from ambkit.base.root import root


@pytest.mark.parametrize("seed", range(20))
def test_it_has_the_bits_of_scipy(seed):
    draw = np.random.default_rng(seed)
    a, b, c = (draw.normal(size=3) * 10 ** draw.uniform(-3, 3, 3)).tolist()
    low, high = -10.0, float(draw.uniform(1, 1e3))
    functions = (
        lambda x: abs(a) * (x - c / 1e3) + b * b * (x - c / 1e3) ** 3,
        lambda x: math.atan(a * (x - b / 1e3)) + 1e-3 * a * x,
    )
    for f in functions:
        if f(low) * f(high) < 0:
            at = root(f, low, high, 1e-15 * (high - low))
            assert at == brentq(f, low, high, xtol=1e-15 * (high - low), maxiter=1000)


def test_an_end_may_be_the_root():
    assert root(lambda x: x - 1, 1.0, 2.0, 1e-15) == 1.0
    assert root(lambda x: x - 2, 1.0, 2.0, 1e-15) == 2.0
