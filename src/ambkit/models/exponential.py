"""Exponentials of a linear system over a time, in units in which its entries are alike."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from ambkit.models.model import Array


def units(A: Array) -> Array:
    """Return units of the states (n,), powers of two, in which the couplings are about 1.

    The exponential is right to a rounding of its greatest entry: in metres and newtons the small
    ones would be lost. By least squares of the logarithms of ``A_ij units_j / units_i``.
    """
    n = len(A)
    i, j = np.nonzero(A - np.diag(np.diag(A)))
    differences = np.zeros((len(i), n))
    differences[np.arange(len(i)), j] = 1.0
    differences[np.arange(len(i)), i] -= 1.0
    exponents, *_ = np.linalg.lstsq(differences, -np.log2(np.abs(A[i, j])), rcond=None)
    return np.asarray(np.exp2(np.round(exponents)))


def transition(A: Array, time: float) -> Array:
    """Return ``exp(A time)`` (n, n)."""
    scaled = A * time
    unit = units(scaled)
    return np.asarray(expm(scaled * unit / unit[:, None])) * unit[:, None] / unit


def growth(A: Array, intensity: Array, time: float) -> Array:
    """Return the covariance that white noise leaves in the state over a time (n, n).

    By the exponential of Van Loan (1978) over a share of the time in which nothing decays by much,
    and from there by doubling: ``N(2t) = N(t) + Phi(t) N(t) Phi(t)'``, a sum of squares.

    Parameters
    ----------
    A : ndarray, shape (n, n)
        ``dX/dt = A X``.
    intensity : ndarray, shape (n,)
        Variance that the noise adds to each state in a second.
    time : float
        The time [s].
    """
    n, scaled = len(A), A * time
    unit = units(scaled)
    scaled = scaled * unit / unit[:, None]
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(scaled).sum(0).max(), 1e-300)))) + 1)
    share = scaled / 2.0**doublings
    given = intensity * time / unit**2
    largest = given.max()
    if largest == 0:
        return np.zeros((n, n))
    W = np.diag(given / (largest * 2.0**doublings))
    both = expm(np.block([[-share, W], [np.zeros((n, n)), share.T]]))
    Phi = both[n:, n:].T
    N = Phi @ both[:n, n:]
    for _ in range(doublings):
        N = N + Phi @ N @ Phi.T
        Phi = Phi @ Phi
    return np.asarray((N + N.T) / 2 * largest * np.outer(unit, unit))
