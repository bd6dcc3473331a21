"""The peak of the sensitivity of whole machines: what `LoopOf.peak` says of one, for many.

Seen along an axis, with all other loops closed, S is ``d + sum_j c_j b_j/(z - z_j)`` over the poles
z_j of the closed loop: one set of eigenvectors serves all axes and all frequencies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.batch import processors
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.simulation.linear.settled import tells
from ambkit.workflow.campaign.margins import GRID, LOWEST, top_of

if TYPE_CHECKING:
    from ambkit.simulation.linear.closed import Loop
    from ambkit.simulation.many_machines import PlannedMachine

Array = NDArray[np.float64]


def peaks_of_machines(runs: Sequence[PlannedMachine], threads: int | None = None) -> Array:
    """Return the peak of abs(S) of each machine's loop within the standard's range (n,) [1]."""
    # At the machine's own speed, of the worst axis. Infinite where the loop is unstable or nothing
    # holds the rotor; NaN where the estimator settles to no gain.
    with ThreadPoolExecutor(threads or processors()) as pool:
        return np.array(list(pool.map(peak_of, runs)), float)


def peak_of(planned: PlannedMachine) -> float:
    """Return the peak of one, see `peaks_of_machines`."""
    machine, flight = planned.machine, planned.flight
    fed = planned.estimator if flight.feedback == "estimate" else None
    if fed is not None and not tells(fed):
        return math.nan
    try:
        of = LoopOf(machine, flight.control, flown=planned.controllers)
        loop = of.loop(fed)
    except AmbkitError:  # nothing holds the rotor
        return math.inf
    return highest(loop, of.top)


def highest(loop: Loop, top: float) -> float:
    """The highest abs(S) of the axes of a loop up to a frequency [Hz]; of unstable ones inf."""
    closed, m = loop.closed, loop.measurements
    poles, V = np.linalg.eig(closed.A)
    if not (np.abs(poles) < 1).all():
        return math.inf
    seen, added = loop.shown, loop.added
    of: Any = np.eye(m) if seen is None else seen
    to: Any = np.eye(m) if added is None else added
    C = of @ closed.C[:m] @ V
    B = np.linalg.solve(V, closed.B[:, :m] @ to)
    residues = C * B.T  # (axes, poles)
    through = np.diag(of @ (np.eye(m) + closed.D[:m, :m]) @ to)

    def gain(f: Array) -> Array:
        """Return abs(S) of each axis at frequencies of its own (axes, k)."""
        z = np.exp(2j * np.pi * loop.T * f)[..., None]
        return np.asarray(np.abs(through[:, None] + (residues[:, None] / (z - poles)).sum(axis=2)))

    own = np.unique(np.abs(np.angle(poles)) / (2 * np.pi * loop.T))
    near = np.outer(own, [0.97, 1.0, 1.03]).ravel()
    grid = np.concatenate([np.geomspace(LOWEST * top, top, GRID), near])
    f = np.unique(np.clip(grid, LOWEST * top, top))
    return float(top_of(gain, np.broadcast_to(f, (len(residues), len(f)))).max())
