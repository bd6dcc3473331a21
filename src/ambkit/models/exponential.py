"""Exponentials of a linear system over a time, each entry to its own digits.

A library's Padé approximant is right to a rounding of the *greatest* entry; in metres and newtons
small ones would be lost. The series over a share of the time, doubled, is right entry by entry.
"""

from __future__ import annotations

import math

import numpy as np

from ambkit.base.arrays import Array

TERMS = 20  #: 1/20! is below the rounding of a double where terms do not grow.


def transition(A: Array, time: float) -> Array:
    """Return ``exp(A time)`` (..., n, n)."""
    share, doublings = _share(A * time)
    Phi = _series(share)
    for _ in range(doublings):
        Phi = Phi @ Phi
    return Phi


def growth(A: Array, intensity: Array, time: float) -> Array:
    """Return the covariances that white noises leave in the state over a time (k, n, n)."""
    # It solves ``dN/dt = A N + N A' + W`` (Van Loan 1978): by its series over a share of the time,
    # and from there by ``N(2t) = N(t) + Phi(t) N(t) Phi(t)'``, a sum of squares. Van Loan's own
    # exponential holds exp(-A t), which overflows for a fast sensor.
    # A (n, n); intensity (k, n)
    share, doublings = _share(A * time)
    Phi = _series(share)
    N = term = np.eye(len(A)) * (intensity * (time / 2.0**doublings))[:, None, :]
    for k in range(2, TERMS + 2 * len(A)):
        driven = share @ term
        term = (driven + driven.swapaxes(1, 2)) / k
        before, N = N, N + term
        if np.array_equal(before, N):  # each state is reached one term after its neighbour
            break
    for _ in range(doublings):
        N = N + Phi @ N @ Phi.T
        Phi = Phi @ Phi
    return np.asarray((N + N.swapaxes(1, 2)) / 2)


def _series(share: Array) -> Array:
    """Return the exponential by Horner's scheme: past the longest way from state to state."""
    one = np.eye(share.shape[-1])
    Phi = one
    for k in range(TERMS + len(one), 0, -1):
        Phi = one + share @ Phi / k
    return Phi


def _share(A: Array) -> tuple[Array, int]:
    """Return ``A / 2^k``, whose circles pass on at most half of what they are given, and k."""
    # That is the spectral radius of |A|, its norm in the units in which that is least.
    radius = float(np.abs(np.linalg.eigvals(np.abs(A))).max())
    doublings = max(0, math.ceil(math.log2(radius)) + 1) if radius > 0 else 0
    return A / 2.0**doublings, doublings
