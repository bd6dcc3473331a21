"""Critical speeds of a rotor in its closed loop, whatever the controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.threads import one_thread
from ambkit.control.linear.linear_plant import unbalance_columns
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.judge.whirl_modes import CriticalSpeed, followed
from ambkit.models.linear import Complex

if TYPE_CHECKING:
    from ambkit.control.linear.closed_loop import Loop
    from ambkit.estimate.estimator import Estimator

COUNT = 21
"""Speeds at which the poles are computed."""

OVERDAMPED = 1e-3
"""Of a pole, the imaginary part below which it does not oscillate but for rounding."""

SHARE = 0.1
"""Of the unbalance response, below which a pole is no whirl of the rotor but one of a filter, which
cancels, or one backwards, which unbalance does not excite."""


@one_thread()
def loop_criticals(of: LoopOf, fed_by: Estimator | None, max_speed: float) -> list[CriticalSpeed]:
    """Return the critical speeds of a loop up to a speed [rad/s], with the damping there."""
    of = of.with_controllers(fed_by, max_speed)

    def at(speed: float) -> tuple[LoopOf, Loop]:
        there, inner = of.at_speed(speed, fed_by)
        return there, there.loop(inner)

    def rates(loop: Loop) -> Complex:
        poles = np.linalg.eigvals(loop.closed.A).astype(complex)
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(poles) / loop.T)

    speed = np.linspace(0.0, max_speed, COUNT)
    paths = [rates(at(speed[-1])[1])]
    for k in reversed(range(COUNT - 1)):
        paths.insert(0, followed(paths[:2], rates(at(speed[k])[1])))
    results = []
    for path in np.array(paths).T:
        ahead = path.imag - speed
        for n in np.flatnonzero((ahead[:-1] > 1e-9 * max_speed) & (ahead[1:] <= 0)):
            share = ahead[n] / (ahead[n] - ahead[n + 1])
            critical = float(speed[n] + share * (speed[n + 1] - speed[n]))
            moved, loop = at(critical)
            near = rates(loop) - (path[n] + share * (path[n + 1] - path[n]))
            pole = complex(rates(loop)[np.argmin(np.abs(near))])
            if pole.imag > OVERDAMPED * abs(pole) and _of_response(moved, loop, pole) >= SHARE:
                results.append(CriticalSpeed(critical, -pole.real / abs(pole)))
    return sorted(results)


def _of_response(of: LoopOf, loop: Loop, rate: complex) -> float:
    """Return the share of a pole in the response to unbalance at the bearings."""
    places = sorted({bearing.place for bearing in of.machine.bearings})
    columns = unbalance_columns(of.machine, of.point, places)
    A, n = loop.closed.A, len(columns)
    poles, right = np.linalg.eig(A)
    k = int(np.argmin(np.abs(poles - np.exp(rate * loop.T))))
    left = np.linalg.inv(right)
    z = np.exp(1j * of.machine.speed * loop.T)
    C = loop.closed.C[loop.measurements : len(loop.plant.outputs)]
    parts = (left[:, :n] @ columns) / (z - poles)[:, None]
    full, own = C @ (right @ parts), C @ np.outer(right[:, k], parts[k])
    return float(np.linalg.norm(own) / np.linalg.norm(full))
