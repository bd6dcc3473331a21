"""The gains of a PID for a bearing, chosen on the margins of the loop."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from operator import itemgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.magnets import ConstantStiffness, own_time
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.control import compensator, controller
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.models.linear import LinearSystem

Complex = NDArray[np.complex128]

PEAK = 1.8
"""Of abs(S), at most, where the bearing allows it: a tenth below 2."""

STIFFEST = 4.0
"""Proportional gain beyond which nothing is looked for, in k_s/k_i."""

RATIOS = (STIFFEST, 3.5, 3.0, 2.6, 2.3, 2.0, 1.8, 1.6, 1.4)
DAMPINGS = np.arange(1.5, 0.49, -0.05)

OVERSHOOT = 0.1
"""Of a step of the reference, at most, where the margins allow it."""

FREQUENCIES, TIMES = 300, 300
"""Points at which peaks and overshoot are sought."""


class Gains(NamedTuple):
    """Gains of a PID, as `ambkit.simulation.scenario.PID` has them."""

    kp: float
    ki: float
    kd: float
    derivative_filter: float
    anti_windup: float
    setpoint_weight: float
    feedback: str = "measurement"


@lru_cache(maxsize=128)
def chosen(bearing: Bearing) -> Gains:
    """Return the stiffest gains that keep the sensitivity below `PEAK` and the step calm."""
    # Both loops are looked at, as they are sampled and late: fed by the measurement, and by a
    # linear Kalman filter with its default noise. With the stiffnesses k_i, k_s at the centre and
    # ``kp = c k_s/k_i`` a loop has the frequency ``w = sqrt((c - 1) k_s/m)``, and with ``kd = 2 D m
    # w/k_i`` the damping D; integral, derivative filter and tracking time go with w. Of all c, from
    # high to low, the first is taken with which some D has no peak of abs(S) above `PEAK` and no
    # overshoot above `OVERSHOOT`; where there is none, the c and D of the lowest peak.
    at = _work_point(bearing)
    P = plant(bearing, at)
    P = P.select(["y", "x"], P.inputs[0][:1])
    E = _estimator(bearing, at)
    f = _frequencies(bearing)
    told = P.response(f)[:, 0, 0], None if E is None else E.response(f)
    lowest, best = math.inf, textbook(bearing)
    for ratio in RATIOS:
        candidates = [_gains(bearing, ratio, float(damping)) for damping in DAMPINGS]
        peaks = _peaks(bearing, candidates, f, *told)
        for peak, gains in sorted(zip(peaks, candidates, strict=True), key=itemgetter(0)):
            if peak > PEAK and peak >= lowest:
                break
            loops = list(_loops(bearing, gains, P, E))
            if not all(loop.is_stable for loop in loops):
                continue
            if peak <= PEAK and all(_overshoot(bearing, loop) <= OVERSHOOT for loop in loops):
                return gains
            if peak < lowest:
                lowest, best = float(peak), gains
    return best


def textbook(bearing: Bearing) -> Gains:
    """Return gains by a rule of thumb: ``kp = 4 k_s/k_i``, D = 0.56, all of the reference to kp."""
    # A step overshoots by a half: it takes the rotor far out, where filters differ.
    return _gains(bearing, STIFFEST, 0.56)._replace(setpoint_weight=1.0)


def weight_of(bearing: Bearing, kp: float, ki: float, kd: float) -> float:
    """Return the set-point weight with which the integral does not show in a step."""
    # The slow pole that the integral brings is then cancelled by the zero that it brings too.
    # Without an integral the rotor would come to rest at ``kp k_i/(kp k_i - k_s)`` of the
    # reference, as the magnet pulls the harder the closer the rotor is: the weight takes that back.
    k, m = ConstantStiffness.of(bearing), bearing.rotor.mass
    stiffness = k.k_i * kp - k.k_s
    if not stiffness > 0:
        return 1.0
    if not ki > 0:
        return stiffness / (k.k_i * kp)
    poles = np.roots([m, k.k_i * kd, stiffness, k.k_i * ki])
    real = poles[np.abs(poles.imag) <= 1e-9 * np.abs(poles)].real
    return float(min(1.0, ki / (kp * np.abs(real).min())))


def two_digits(value: float) -> float:
    """Return a gain as it is written down: more of it nobody could tell."""
    return float(f"{value:.2g}")


def _gains(bearing: Bearing, ratio: float, damping: float) -> Gains:
    k, m = ConstantStiffness.of(bearing), bearing.rotor.mass
    w = math.sqrt((ratio - 1) * k.k_s / m)
    kp = two_digits(ratio * k.k_s / k.k_i)
    ki, kd = two_digits(kp * w / 31), two_digits(2 * damping * m * w / k.k_i)
    weight = two_digits(weight_of(bearing, kp, ki, kd))
    return Gains(kp, ki, kd, two_digits(1 / (24 * w)), two_digits(5.2 / w), weight)


def _work_point(bearing: Bearing) -> WorkPoint:
    try:
        return WorkPoint.hovering(bearing)
    except AmbkitError:  # it is not held at the centre, but perhaps elsewhere
        return WorkPoint(0.0, 0.0)


def _estimator(bearing: Bearing, at: WorkPoint) -> LinearSystem | None:
    try:
        return estimator_at(KalmanFilter(bearing), at)
    except AmbkitError:  # a model that has no gain to settle to
        return None


def _frequencies(bearing: Bearing) -> NDArray[np.float64]:
    slowest = 1 / (40 * math.pi * own_time(bearing))
    highest = 0.5 / bearing.sampling_time
    return np.geomspace(min(slowest, highest / 2), highest, FREQUENCIES)


def _peaks(
    bearing: Bearing,
    candidates: list[Gains],
    f: NDArray[np.float64],
    P: Complex,
    E: Complex | None,
) -> NDArray[np.float64]:
    """Return the higher peak of abs(S) of both loops for each candidate, stable or not."""
    # The controller's response is written out, as `controller` has it in states: hundreds are
    # asked.
    T, volts = bearing.sampling_time, 1 / bearing.amplifier.gain
    kp, ki, kd, T_f, *_ = np.array([each[:-1] for each in candidates]).T[:, :, None]
    z = np.exp(2j * np.pi * f * T)
    x, v = volts * (kp + ki * T / (z - 1)), volts * kd
    share = 1 / (T_f + T)
    slope = share * (1 - 1 / z) / (1 - (1 - T * share) / z)
    S = [1 / (1 + P * (x + v * slope) / bearing.sensor.gain)]
    if E is not None:
        fed = x * E[:, 0, 0] + v * E[:, 1, 0]
        S.append(1 / (1 + P * fed / (1 + x * E[:, 0, 1] + v * E[:, 1, 1])))
    return np.asarray(np.abs(S).max(axis=(0, 2)))


def _loops(
    bearing: Bearing, gains: Gains, P: LinearSystem, E: LinearSystem | None
) -> Iterator[Loop]:
    """Yield the loop that is fed by the measurement, and the one that is fed by the estimate."""
    shown = np.array([[1 / bearing.sensor.gain]])
    yield Loop(P, compensator(controller(gains, bearing), None, shown))
    if E is not None:
        fed = gains._replace(feedback="estimate")
        yield Loop(P, compensator(controller(fed, bearing), E, shown))


def _overshoot(bearing: Bearing, loop: Loop) -> float:
    """Return how far the rotor goes beyond a step of the reference [1]."""
    closed = loop.closed
    samples = max(1, round(30 * own_time(bearing) / loop.T / TIMES))
    n = len(closed.A)
    step = np.block([[closed.A, closed.B[:, -1:]], [np.zeros((1, n)), np.ones((1, 1))]])
    several, state = np.linalg.matrix_power(step, samples), np.eye(n + 1)[-1]
    x = np.empty(TIMES)
    for k in range(TIMES):
        state = several @ state
        x[k] = closed.C[loop.measurements] @ state[:n]
    return float(x.max()) - 1
