"""Critical speeds of a rotor in its closed loop, whatever the controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.threads import one_thread
from ambkit.control.linear.linear_plant import unbalance_columns
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.judge.whirl_modes import DAMPED, CriticalSpeed, followed
from ambkit.models.linear import Complex

if TYPE_CHECKING:
    from collections.abc import Callable

    from ambkit.control.linear.closed_loop import Loop
    from ambkit.estimate.estimator import Estimator

COUNT, LEAST = 21, 0.01
"""Speeds at which the poles are computed, and the lowest of them over the highest: at rest a filter
that estimates the unbalance does not settle."""

PEAK, NARROWEST, MOST = 1.3, 0.002, 1.2
"""How much larger than three widths beside it the response is, the least width, and up to which
multiple of the greatest speed that is asked."""

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

    speed = np.linspace(LEAST * max_speed, max_speed, COUNT)
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
            result = CriticalSpeed(critical, -pole.real / abs(pole))
            if pole.imag <= OVERDAMPED * abs(pole) or _share(moved, loop, pole) < SHARE:
                continue
            if result.amplification < DAMPED or _is_peak(at, result, max_speed):
                results.append(result)
    return sorted(results)


def _is_peak(
    at: Callable[[float], tuple[LoopOf, Loop]], critical: CriticalSpeed, max_speed: float
) -> bool:
    """Return whether the response to unbalance peaks there, as by no pole of a filter alone."""
    width = max(critical.damping_ratio, NARROWEST)
    size = {}
    for off in (-3, -1, 0, 1, 3):
        speed = (1 + off * width) * critical.speed
        if speed < MOST * max_speed:
            moved, loop = at(speed)
            size[off] = np.linalg.norm(sum(_parts(moved, loop)[1]))
    inside = max(value for off, value in size.items() if abs(off) < 3)
    return bool(inside > PEAK * max(value for off, value in size.items() if abs(off) == 3))


def _share(of: LoopOf, loop: Loop, rate: complex) -> float:
    """Return the share of a pole in the response to unbalance at the bearings."""
    poles, parts = _parts(of, loop)
    k = int(np.argmin(np.abs(poles - np.exp(rate * loop.T))))
    return float(np.linalg.norm(parts[k]) / np.linalg.norm(sum(parts)))


def _parts(of: LoopOf, loop: Loop) -> tuple[Complex, list[Complex]]:
    """Return the poles, and what each adds to the positions (axes, bearings) by unbalance there."""
    places = sorted({bearing.place for bearing in of.machine.bearings})
    columns = unbalance_columns(of.machine, of.point, places)
    poles, right = np.linalg.eig(loop.closed.A)
    z = np.exp(1j * of.machine.speed * loop.T)
    moved = np.linalg.inv(right)[:, : len(columns)] @ columns / (z - poles)[:, None]
    seen = loop.closed.C[loop.measurements : len(loop.plant.outputs)] @ right
    return poles, [np.outer(one, other) for one, other in zip(seen.T, moved, strict=True)]
