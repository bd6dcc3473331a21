"""Critical speeds of a rotor in its closed loop, whatever the controller."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Complex
from ambkit.base.threads import one_thread
from ambkit.control.linear.linear_plant import unbalance_columns
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.judge.whirl_modes import DAMPED, CriticalSpeed, followed

if TYPE_CHECKING:
    from collections.abc import Callable

    from ambkit.control.linear.closed_loop import Loop
    from ambkit.estimate.estimator import Estimator

    At = Callable[[float], tuple[LoopOf, Loop]]

COUNT, LEAST = 21, 0.01
"""Speeds of the poles; lowest over highest: at rest an estimator of unbalance does not settle."""

PEAK, NARROWEST, MOST = 1.3, 0.002, 1.2
"""Response over that three widths beside it; least width; end over the greatest speed."""

HALF_POWER, BETWEEN = math.sqrt(0.5), 6
"""Of a peak, how far the response falls between it and the next, and speeds looked at there."""

ACROSS = np.linspace(-3, 3, 13)  #: Speeds about each pole of a peak of several, in widths.
SAME = 1e-6  #: Distance of two critical speeds, over the lower one, up to which they are one.
OVERDAMPED = 1e-3  #: Imaginary part of a pole that is rounding, relative to the pole.

SHARE = 0.1
"""Share of a pole in the unbalance response, below which it is a filter's or a backward whirl's."""


@one_thread()
def loop_criticals(of: LoopOf, fed_by: Estimator | None, max_speed: float) -> list[CriticalSpeed]:
    """Return the critical speeds of a loop up to a speed [rad/s], with the damping there."""
    of = of.with_controllers(fed_by, max_speed)

    @lru_cache(maxsize=8)
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
            poles, expected = rates(loop), path[n] + share * (path[n + 1] - path[n])
            pole = complex(poles[np.argmin(np.abs(poles - expected))])
            result = CriticalSpeed(critical, -pole.real / abs(pole))
            if pole.imag <= OVERDAMPED * abs(pole) or _share(moved, loop, pole) < SHARE:
                continue
            if result.amplification < DAMPED or _is_peak(at, result, max_speed):
                results.append(result)
    return _distinct(at, sorted(results), MOST * max_speed)


def _response(at: At, speed: float) -> float:
    """Return the size of the response to unbalance at the bearings."""
    return float(np.linalg.norm(sum(_parts(*at(speed))[1])))


def _distinct(at: At, criticals: list[CriticalSpeed], end: float) -> list[CriticalSpeed]:
    """Return critical speeds, each peak of the response once."""
    # Where poles of rotor and filter are coupled, two of them make one peak. Two peaks are distinct
    # where the response between them falls to half the power, by which API 684 defines the
    # amplification factor.
    # Of a rotor that is the same in x and y, a whirl and its mirror image are one.
    groups: list[list[CriticalSpeed]] = []
    for critical in criticals:
        last = groups[-1][-1] if groups else critical
        if groups and critical.speed <= (1 + SAME) * last.speed:
            continue
        sharp = min(critical.amplification, last.amplification) >= DAMPED
        if sharp and last is not critical and not _valley(at, last.speed, critical.speed):
            groups[-1].append(critical)
        else:
            groups.append([critical])
    return [group[0] if len(group) == 1 else _peak_of(at, group, end) for group in groups]


def _valley(at: At, low: float, high: float) -> bool:
    """Return whether the response falls to half the power between two speeds."""
    size = [_response(at, float(speed)) for speed in np.linspace(low, high, BETWEEN)]
    return min(size) < HALF_POWER * min(size[0], size[-1])


def _peak_of(at: At, group: list[CriticalSpeed], end: float) -> CriticalSpeed:
    """Return the one peak of several poles, with the damping ratio of its half-power points."""
    across = [(1 + one.damping_ratio * ACROSS) * one.speed for one in group]
    speed = np.unique(np.minimum(across, end))
    size = np.array([_response(at, float(one)) for one in speed])
    peak = int(np.argmax(size))
    wide = speed[size > HALF_POWER * size[peak]]
    return CriticalSpeed(float(speed[peak]), float((wide[-1] - wide[0]) / (2 * speed[peak])))


def _is_peak(at: At, critical: CriticalSpeed, max_speed: float) -> bool:
    """Return whether the response to unbalance peaks there, as by no pole of a filter alone."""
    width = max(critical.damping_ratio, NARROWEST)
    size = {}
    for off in (-3, -1, 0, 1, 3):
        speed = (1 + off * width) * critical.speed
        if speed < MOST * max_speed:
            size[off] = _response(at, speed)
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
