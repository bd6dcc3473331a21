"""The linear-quadratic regulator of a whole machine, by an estimator's states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.machine.magnets import ConstantStiffness

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing
    from ambkit.simulation.plant import Plant

Array = NDArray[np.float64]

REGULATED = (
    "position", "velocity", "bending", "bending velocity", "current", "past control",
)  # fmt: skip
"""Roles of the states that the controls move."""

SHARE = 0.2
"""Of its current, what an axis may use for a deflection by a tenth of what the stops leave."""


def regulator(plant: Plant, estimator: Estimator) -> tuple[Array, Array]:
    """Return the feedback (p, n) of an estimator's states, and (p, p) of the axes' references.

    The currents are ``iu = -K x + F r`` [A]. Least is the mean of the squared deflections in tenths
    of the travel and of the currents in a share of their limits (Bryson and Ho 1975). The estimated
    loads are cancelled at rest, and references held.

    Parameters
    ----------
    plant : Plant
        The machine.
    estimator : Estimator
        Whose model is regulated, with its amplifiers and dead time.

    Raises
    ------
    AmbkitError
        There is no such regulator.
    """
    assert estimator.whole is not None
    along = estimator.whole.along_axes(estimator.states)[0]
    return regulator_of(plant.alone, estimator, along)


def regulator_of(
    alone: Sequence[Bearing], estimator: Estimator, along: Array
) -> tuple[Array, Array]:
    """Return the same of axes.

    Parameters
    ----------
    alone : sequence of Bearing (p,)
        The axes, each by itself.
    estimator : Estimator
        Whose model is regulated.
    along : ndarray (p, n)
        Displacements along the axes by the estimator's states.

    Raises
    ------
    AmbkitError
        There is no such regulator.
    """
    from scipy.linalg import solve_discrete_are

    k = [ConstantStiffness.of(each) for each in alone]
    model = estimator.linear_model(np.array([e.k_i for e in k]), np.array([e.k_s for e in k]))
    roles = [state.role for state in estimator.states]
    own = [at for at, role in enumerate(roles) if role in REGULATED]
    loads = [at for at, role in enumerate(roles) if role == "disturbance force"]
    volts = np.array([each.amplifier.gain for each in alone])
    A, B = model.A[np.ix_(own, own)], model.B[own] / volts
    n, p = len(own), len(volts)
    C = along[:, own]
    travel = np.array([each.rotor.travel_limit for each in alone])
    limit = np.array([min(abs(each.current_min), each.current_max) for each in alone])
    weight = np.diag(1 / (SHARE * limit) ** 2)
    seen = C / (0.1 * travel)[:, None]
    # States are counted in what the currents make of them, or digits are lost.
    pulsed = [B * limit]
    for _ in range(n):
        pulsed.append(A @ pulsed[-1])
    size = np.abs(pulsed).max(axis=(0, 2))
    scaled, moved = A * size / size[:, None], B / size[:, None]
    try:
        P = solve_discrete_are(scaled, moved, (seen * size).T @ (seen * size), weight)
    except np.linalg.LinAlgError:
        raise AmbkitError(
            f"{estimator.bearing.name}: there is no regulator of this machine"
        ) from None
    K_own = np.linalg.solve(weight + moved.T @ P @ moved, moved.T @ P @ scaled)
    # At rest: x = A x + B u + E f with C x = r; with the least currents, where there are more axes
    # than coordinates.
    E = model.A[np.ix_(own, loads)] / size[:, None]
    rest = np.block([[np.eye(n) - scaled, -moved], [C * size, np.zeros((p, p))]])
    asked = np.block([[E, np.zeros((n, p))], [np.zeros((p, len(loads))), np.eye(p)]])
    found = np.linalg.lstsq(rest, asked, rcond=1e-12)[0]
    ahead = K_own @ found[:n] + found[n:]
    K = np.zeros((p, len(roles)))
    K[:, own] = K_own / size
    K[:, loads] = -ahead[:, : len(loads)]
    return K, ahead[:, len(loads) :]
