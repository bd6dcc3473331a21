"""The lowest peaks of S and T that any controller could reach with a plant of one axis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambkit.models.linear import Complex, LinearSystem

Array = NDArray[np.float64]


def least_peaks(plant: LinearSystem) -> tuple[float, float]:
    """Return the least peaks of abs(S) and abs(T) with any stabilising controller.

    Both are 1 for a stable plant. Else S is 0 at the unstable poles, and it is 1 at the zeros
    outside of the unit circle and, to the order of the dead time in samples, at infinity: the least
    of its peak is an interpolation problem after Nevanlinna and Pick, exactly solved. For one
    unstable pole p and a dead time of d samples the peak of T is ``p^d``, as it is
    ``e^(p delay)`` in continuous time.

    Parameters
    ----------
    plant : LinearSystem
        From one control signal to one measurement, sampled; no unstable pole twice.

    Returns
    -------
    tuple of float
        Bounds of the peaks of abs(S) and of abs(T) [1].

    References
    ----------
    Seron, Braslavsky, Goodwin, Fundamental limitations in filtering and control, 1997; Sarason,
    Generalized interpolation in H-infinity, 1967.
    """
    poles = 1 / plant.unstable()
    if not len(poles):
        return 1.0, 1.0
    zeros, order = _zeros(plant)

    def of(points: Complex, at: Complex) -> Complex:
        """Return the product of all-passes with these zeros inside of the unit circle, 1/z."""
        return np.asarray(np.prod([(at - a) / (1 - np.conj(a) * at) for a in points], axis=0))

    # S = b G, where b has the unstable poles as zeros: G takes 1/b at all zeros of the plant.
    turns = np.exp(2j * np.pi * np.arange(SERIES) / SERIES) * RADIUS
    series = np.fft.fft(1 / of(poles, turns))[:order] / SERIES / RADIUS ** np.arange(order)
    least_S = _least(series, zeros, 1 / of(poles, zeros) if len(zeros) else zeros)
    # T = B H, where B has the zeros of the plant: H takes 1/B at the unstable poles.
    B = of(zeros, poles) * poles**order if len(zeros) else poles**order
    return max(1.0, least_S), max(1.0, _least(np.zeros(0, complex), poles, 1 / B))


SERIES = 256
"""Points of the circle from which a power series is taken."""

RADIUS = 0.25
"""Of that circle: 1/p of an unstable pole p of a sampled rotor is well outside of it."""


def _zeros(plant: LinearSystem) -> tuple[Complex, int]:
    """Return 1/z (k,) of the zeros z outside of the unit circle, and how many are at infinity."""
    from scipy.linalg import eigvals

    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    n = len(A)
    size = np.sqrt(np.abs(B[:, 0]) + 1e-12 * np.abs(B).max())
    A, B, C = A * size / size[:, None], B / size[:, None], C * size
    B, C = B / np.abs(B).max(), C / np.abs(C).max()
    pencil = np.block([[A, B], [C, D]])
    mass = np.zeros((n + 1, n + 1))
    mass[:n, :n] = np.eye(n)
    alpha, beta = eigvals(pencil, mass, homogeneous_eigvals=True)
    finite = np.abs(beta) > FAR * np.abs(alpha)
    z = alpha[finite] / beta[finite]
    outside = z[np.abs(z) > 1]
    markov, power, order = C @ B, B, 1
    while order < n and abs(markov.item()) < 1e-9 * np.abs(C).max() * np.abs(power).max():
        power = A @ power
        markov, order = C @ power, order + 1
    return 1 / outside, order


FAR = 1e-7
"""A zero farther out than 1 / FAR is one at infinity."""


def _least(series: Complex, points: Complex, values: Complex) -> float:
    """Return the least sup norm on the disk of what has this power series and these values."""
    d, k = len(series), len(points)
    # The adjoint of multiplication takes w^j to the conjugates of the series, shifted, and the
    # kernel 1/(1 - conj(a) w) of a point a to itself times the conjugate of the value there.
    gram = np.eye(d + k, dtype=complex)
    gram[d:, d:] = 1 / (1 - np.outer(points, np.conj(points)))
    gram[d:, :d] = points[:, None] ** np.arange(d)
    gram[:d, d:] = gram[d:, :d].conj().T
    V = np.zeros((d + k, d + k), complex)
    for j in range(d):
        V[: j + 1, j] = np.conj(series[j::-1])
    V[range(d, d + k), range(d, d + k)] = np.conj(values)
    from scipy.linalg import eigh

    top = eigh(V.conj().T @ gram @ V, gram, eigvals_only=True)[-1]
    return float(np.sqrt(max(float(top), 0.0)))
