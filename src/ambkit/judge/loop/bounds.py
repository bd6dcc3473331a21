"""The lowest peaks of S and T that any controller could reach with a plant of one axis."""

from __future__ import annotations

import numpy as np

from ambkit.models.linear import EDGE, Complex, LinearSystem


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
        From one control signal to one measurement, sampled.

    Returns
    -------
    tuple of float
        Bounds of the peaks of abs(S) and of abs(T) [1].

    References
    ----------
    Seron, Braslavsky, Goodwin, Fundamental limitations in filtering and control, 1997; Sarason,
    Generalized interpolation in H-infinity, 1967.
    """
    poles, zeros = 1 / plant.unstable(), _zeros(plant)
    if not len(poles):
        return 1.0, 1.0
    # S = b G, where b is all-pass with the unstable poles as zeros: G takes 1/b at all zeros of the
    # plant. T = B H, where B has those zeros: H takes 1/B at the unstable poles.
    S, T = (
        np.linalg.norm(np.linalg.inv(_all_pass(points, _shift(at))), 2)
        for points, at in ((poles, zeros), (zeros, poles))
    )
    return max(1.0, float(S)), max(1.0, float(T))


def _all_pass(points: Complex, Z: Complex) -> Complex:
    """Return b(Z) of a matrix (n, n); b is 0 at the points and of size 1 on the unit circle."""
    one, found = np.eye(len(Z)), np.eye(len(Z), dtype=complex)
    for a in points:
        found = found @ np.linalg.solve(one - np.conj(a) * Z, Z - a * one)
    return found


def _shift(points: Complex) -> Complex:
    """Return the matrix (n, n) of which a function's norm is the least sup norm on the disk.

    That of all functions with its values at the points, and its derivatives where points are equal:
    multiplication by w, compressed to what vanishes at none of them, in the basis of Takenaka and
    Malmquist (Sarason 1967).
    """
    size = np.sqrt(1 - np.abs(points) ** 2)
    Z = np.diag(points).astype(complex)
    for i in range(len(points)):
        for j in range(i):
            Z[i, j] = size[i] * size[j] * np.prod(-np.conj(points[j + 1 : i]))
    return Z


def _zeros(plant: LinearSystem) -> Complex:
    """Return 1/z (k,) of the zeros z outside of the unit circle: 0 of those at infinity."""
    from scipy.linalg import eigvals

    n = len(plant.A)
    # The states are counted in what a pulse of the control makes of them.
    pulsed = [plant.B]
    for _ in range(n):
        pulsed.append(plant.A @ pulsed[-1])
    size = np.abs(pulsed).max(axis=(0, 2))
    A, B, C = plant.A * size / size[:, None], plant.B / size[:, None], plant.C * size
    order = 1
    while order < n and not np.abs(C @ B).item() > NONE * (np.abs(C) @ np.abs(B)).item():
        C, order = C @ A, order + 1
    # Without the dead time those at infinity are at 0: as several at one place, digits are lost.
    pencil = np.block([[A, B / np.abs(B).max()], [C / np.abs(C).max(), np.zeros((1, 1))]])
    mass = np.diag([*np.ones(n), 0.0])
    alpha, beta = eigvals(pencil, mass, homogeneous_eigvals=True)
    outside = np.abs(beta) < (1 - EDGE) * np.abs(alpha)
    w = beta[outside] / alpha[outside]
    return np.concatenate([np.zeros(order), w[np.abs(w) > FAR]])


NONE = 1e-12
"""Of the sum of its terms, a first response that is none."""

FAR = 1e-6
"""A zero farther out than 1 / FAR is one at infinity."""
