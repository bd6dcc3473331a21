"""Limit states from the literature, as functions of standard normal numbers that fail from 0 on."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import chi2

Array = NDArray[np.float64]


class LimitState(NamedTuple):
    """A function that fails from 0 on, and how likely that is."""

    dimensions: int
    value: Callable[[Array], Array]
    probability: float
    several_modes: bool


def _branches(u: Array) -> Array:
    x, y = u.T
    bent, root = 3 + 0.1 * (x - y) ** 2, math.sqrt(2)
    total = (x + y) / root
    return -np.min([bent - total, bent + total, x - y + 7 / root, y - x + 7 / root], axis=0)


def _modes(u: Array) -> Array:
    x, y = u[:, 0] + 1.5, u[:, 1] + 2.5
    return (x**2 + 4) * (y - 1) / 20 - np.sin(2.5 * x) - 2


def _lognormal(u: Array) -> Array:
    spread = math.sqrt(math.log(1.04))  # mean 1, standard deviation 0.2
    return np.exp(spread * u - spread**2 / 2).sum(axis=1) - (40 + 0.6 * math.sqrt(40))


LIMIT_STATES = {
    "plane, 10": LimitState(
        10, lambda u: u.sum(axis=1) / math.sqrt(10) - 3.5, float(ndtr(-3.5)), False
    ),
    "plane, 100": LimitState(100, lambda u: u.sum(axis=1) / 10 - 4, float(ndtr(-4)), False),
    "two sides": LimitState(2, lambda u: np.abs(u[:, 0]) - 4, float(2 * ndtr(-4)), True),
    "far mode": LimitState(
        2, lambda u: np.maximum(u[:, 0] - 3.6, 2 * (u[:, 1] - 3.5)),
        float(1 - ndtr(3.6) * ndtr(3.5)), True,
    ),
    "sphere": LimitState(20, lambda u: (u**2).sum(axis=1) - 51, float(chi2.sf(51, 20)), True),
    # Waarts, Structural reliability using finite element methods, 2000.
    "four branches": LimitState(2, _branches, 2.22e-3, True),
    # Der Kiureghian and Dakessian, Multiple design points in first and second-order reliability,
    # 1998.
    "parabola": LimitState(
        2, lambda u: u[:, 1] + 0.5 * (u[:, 0] - 0.1) ** 2 - 5, 3.01e-3, True
    ),
    # Bichon et al., Efficient global reliability analysis for nonlinear implicit performance
    # functions, 2008.
    "several modes": LimitState(2, _modes, 3.13e-2, False),
    # Rackwitz, Reliability analysis: a review and some perspectives, 2001; by 4e6 samples.
    "lognormal sum": LimitState(40, _lognormal, 0.00199, False),
    # Echard, Gayton and Lemaire, AK-MCS, 2011.
    "Rastrigin": LimitState(
        2, lambda u: (u**2 - 5 * np.cos(2 * math.pi * u)).sum(axis=1) - 10, 7.31e-2, True
    ),
}  # fmt: skip
