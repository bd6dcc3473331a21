"""Default gains of PIDs that hold a machine, one for each axis, and how well they do."""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, lru_cache
from operator import itemgetter
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.control.held_loop import (
    Gains,
    HeldLoop,
    Sensitivities,
    Stabilisation,
    overshoot,
    pid_response,
    sensitivities,
)
from ambkit.control.linear.closed_loop import Loop
from ambkit.control.linear.linear_controller import compensator, controller
from ambkit.control.linear.linear_plant import OperatingPoint, plant
from ambkit.control.linear.steady_state_filter import estimator_at
from ambkit.estimate.kalman import KalmanFilter
from ambkit.machine.axes import isolated_axes
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, own_time, typical_stiffness
from ambkit.models.linear import LinearSystem

PEAK = 1.8  #: Of abs(S), at most, where the bearing allows it: a tenth below 2.
STIFFEST = 4.0  #: Proportional gain beyond which nothing is looked for, in k_s/k_i.

RATIOS = (STIFFEST, 3.5, 3.0, 2.6, 2.3, 2.0, 1.8, 1.6, 1.4)
DAMPINGS = np.arange(1.5, 0.49, -0.05)

FREQUENCIES = 300  #: At which peaks are looked at.

SOFTER = (1.0, 0.75, 0.6, 0.5, 0.4, 0.35)
"""Shares of the proportional gain; below about 0.3 no spring is left against the magnets' own."""
LESS_DAMPED = (1.5, 1.0, 0.75, 0.5, 0.35, 0.2)  #: Shares of the derivative gain.
SLOWER = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  #: By how much the derivative is filtered more.
BOUNDS = np.log([(0.3, 0.2, 0.5), (1.25, 1.5, 32.0)])  #: Logarithms of the limits of these.
ENOUGH = 2.0  #: Peak of abs(S) from which on others are looked for.
STRIDE, TRIES, UNHELD = 0.2, 250, 1e3
"""Of the search for the lowest peak: its first steps, its evaluations, the cost of what falls."""
OVERSHOOT_ALONE, OVERSHOOT, WEIGHTS = 0.1, 0.13, (0.85, 0.7, 0.55, 0.4, 0.25, 0.0)
"""Of a reference step, of an isolated axis and a machine; shares of the set-point weight."""
NEARBY, FINER = (0.87, 1.0, 1.15), 2  #: What is tried next to the best of these, and how often.


@lru_cache(maxsize=128)
def chosen(machine: Machine) -> Gains:
    """Return the stiffest gains that keep the sensitivity below `PEAK` and the step calm."""
    # Both loops are looked at, as they are sampled and late: fed by the measurement, and by a
    # linear Kalman filter with its default noise. With the stiffnesses k_i, k_s at the centre and
    # ``kp = c k_s/k_i`` a loop has the frequency ``w = sqrt((c - 1) k_s/m)``, and with ``kd = 2 D m
    # w/k_i`` the damping D; integral, derivative filter and tracking time go with w. Of all c, from
    # high to low, the first is taken with which some D has no peak of abs(S) above `PEAK` and no
    # overshoot above `OVERSHOOT_ALONE`; where there is none, the c and D of the lowest peak.
    at = OperatingPoint.nearest(machine)
    P = plant(machine, at)
    P = P.select(["y", "x"], P.inputs[0][:1])
    E = _estimator(machine, at)
    f = frequencies(machine, FREQUENCIES)
    responses = P.response(f)[:, 0, 0], None if E is None else E.response(f)
    lowest, best = math.inf, textbook(machine)
    for ratio in RATIOS:
        candidates = [_gains(machine, ratio, float(damping)) for damping in DAMPINGS]
        peaks = _peaks(machine, candidates, f, *responses)
        for peak, gains in sorted(zip(peaks, candidates, strict=True), key=itemgetter(0)):
            if peak > PEAK and peak >= lowest:
                break
            loops = list(_loops(machine, gains, P, E))
            if not all(loop.is_stable for loop in loops):
                continue
            if peak <= PEAK and all(
                overshoot(loop, own_time(machine)) <= OVERSHOOT_ALONE for loop in loops
            ):
                return gains
            if peak < lowest:
                lowest, best = float(peak), gains
    return best


def textbook(machine: Machine) -> Gains:
    """Return gains by a rule of thumb: ``kp = 4 k_s/k_i``, D = 0.56, all of the reference to kp."""
    # A step overshoots by a half: it takes the rotor far out, where filters differ.
    return _gains(machine, STIFFEST, 0.56)._replace(setpoint_weight=1.0)


def weight_of(machine: Machine, kp: float, ki: float, kd: float) -> float:
    """Return the set-point weight with which the integral does not show in a step."""
    # The slow pole that the integral brings is then cancelled by the zero that it brings too.
    # Without an integral the rotor would come to rest at ``kp k_i/(kp k_i - k_s)`` of the
    # reference, as the magnet pulls the harder the closer the rotor is: the weight takes that back.
    k, m = ConstantStiffness.of(machine), machine.rotor.mass
    stiffness = k.k_i * kp - k.k_s
    if not stiffness > 0:
        return 1.0
    if not ki > 0:
        return stiffness / (k.k_i * kp)
    poles = np.roots([m, k.k_i * kd, stiffness, k.k_i * ki])
    real = poles[np.abs(poles.imag) <= 1e-9 * np.abs(poles)].real
    return float(min(1.0, ki / (kp * np.abs(real).min())))


def round_to_two_digits(value: float) -> float:
    """Return a gain as it is written down: more of it nobody could tell."""
    return float(f"{value:.2g}")


def _gains(machine: Machine, ratio: float, damping: float) -> Gains:
    k_i, k_s = ConstantStiffness.of(machine).k_i, typical_stiffness(machine)
    m = machine.rotor.mass
    w = math.sqrt((ratio - 1) * k_s / m)
    kp = round_to_two_digits(ratio * k_s / k_i)
    ki, kd = round_to_two_digits(kp * w / 31), round_to_two_digits(2 * damping * m * w / k_i)
    weight = round_to_two_digits(weight_of(machine, kp, ki, kd))
    return Gains(
        kp, ki, kd, round_to_two_digits(1 / (24 * w)), round_to_two_digits(5.2 / w), weight
    )


def _estimator(machine: Machine, at: OperatingPoint) -> LinearSystem | None:
    try:
        return estimator_at(KalmanFilter(machine), at)
    except AmbkitError:  # a model that has no gain to settle to
        return None


def frequencies(machine: Machine, count: int) -> Array:
    """Return frequencies [Hz] from below the plant's own up to half the sampling rate."""
    min_frequency, highest = 1 / (40 * math.pi * own_time(machine)), 0.5 / machine.sampling_time
    return np.geomspace(min(min_frequency, highest / 2), highest, count)


def _peaks(
    machine: Machine, candidates: list[Gains], f: Array, P: Complex, E: Complex | None
) -> Array:
    """Return the higher peak of abs(S) of both loops for each candidate, stable or not."""
    T, volts = machine.sampling_time, 1 / machine.amplifier.gain
    gains = np.array(candidates).T[:, :, None]
    x, v, slope = pid_response(gains, np.exp(2j * np.pi * f * T), T, volts)
    S = [1 / (1 + P * (x + v * slope) / machine.sensor.gain)]
    if E is not None:
        fed = x * E[:, 0, 0] + v * E[:, 1, 0]
        S.append(1 / (1 + P * fed / (1 + x * E[:, 0, 1] + v * E[:, 1, 1])))
    return np.asarray(np.abs(S).max(axis=(0, 2)))


def _loops(
    machine: Machine, gains: Gains, P: LinearSystem, E: LinearSystem | None
) -> Iterator[Loop]:
    """Yield the loop that is fed by the measurement, and the one that is fed by the estimate."""
    transform = np.array([[1 / machine.sensor.gain]])
    yield Loop(P, compensator(controller(gains, machine, measured=True), None, transform))
    if E is not None:
        yield Loop(P, compensator(controller(gains, machine, measured=False), E, transform))


def holding(
    machine: Machine, feedback: Literal["measurement", "estimate"] = "measurement"
) -> Stabilisation:
    """Return controllers for a machine, each axis with its own."""
    # Each is tuned to its axis alone, see `chosen`. Where that shakes a bending mode, by
    # the loop's delay or a sensor on the other side of a node, softer gains and slower derivatives
    # are tried, the same for all axes, and those are taken that leave most damping: to the rigid
    # body up to `WELL_DAMPED`, to a bending mode up to `LEFT_TO_IT` of its own. Where the peak of
    # abs(S) of an axis with all others closed is `ENOUGH` or more then, those that bring it down to
    # that of one axis alone, `PEAK`, with most stiffness; or the lowest that is found. Where a step
    # of a reference overshoots by more than `OVERSHOOT`, kp sees less of it.
    return _held(machine.model_copy(update={"unbalance": ()}), feedback)  # which does not matter


@lru_cache(maxsize=64)
@one_thread()
def _held(machine: Machine, feedback: Literal["measurement", "estimate"]) -> Stabilisation:
    usual = tuple(map(chosen, isolated_axes(machine)))
    search = _Search(machine, usual, feedback)
    result = Stabilisation(usual, np.zeros(0, complex), 1.0)
    if machine.rotor.type == "mass":  # an axis alone is all there is
        return result
    if machine.bending is not None:
        result = search.max_damping()
    margins = sensitivities(machine, estimated=feedback == "estimate")
    if margins is None or not result.held:
        return search.weighted(result)
    if margins.peaks(result.pids).max() >= ENOUGH:
        result = search.on_margins(result, margins)
    return search.calm(search.weighted(result))


class _Search:
    """Controllers that are softer, less damped and slower than the usual ones, all axes alike."""

    def __init__(self, machine: Machine, usual: tuple[Gains, ...], feedback: str) -> None:
        self.machine, self.usual, self.feedback = machine, usual, feedback
        # A velocity is not filtered again.
        self.slower = SLOWER if feedback == "measurement" else (1.0,)

    @cached_property
    def loop(self) -> HeldLoop:
        """The machine, and what controllers make of it."""
        return HeldLoop(self.machine, self.feedback)

    def of(self, pids: tuple[Gains, ...], p: float, d: float, f: float) -> tuple[Gains, ...]:
        """Return controllers with these shares of gains and filter."""
        return tuple(_changed(pid, p, d, f) for pid in pids)

    def max_damping(self) -> Stabilisation:
        """Return those that leave most damping."""
        best = self.loop.with_(self.usual)
        if best.score >= 1:
            return best
        for shares in itertools.product(SOFTER, LESS_DAMPED, self.slower):
            trial = self.loop.with_(self.of(self.usual, *shares))
            best = trial if trial.score > best.score else best
        for _ in range(FINER):
            nearby = NEARBY if len(self.slower) > 1 else (1.0,)
            for shares in itertools.product(NEARBY, NEARBY, nearby):
                trial = self.loop.with_(self.of(best.pids, *shares))
                best = trial if trial.score > best.score else best
        return best

    def on_margins(self, result: Stabilisation, margins: Sensitivities) -> Stabilisation:
        """Return the stiffest whose peaks of abs(S) are at most `PEAK`, or those of the lowest."""
        best, lowest = result, float(margins.peaks(result.pids).max())
        near: Array = np.zeros(3)
        for p, d, f in itertools.product(SOFTER, LESS_DAMPED, self.slower):
            pids = self.of(self.usual, p, d, f)
            peak = float(margins.peaks(pids).max())
            if peak < lowest and (trial := self.loop.with_(pids)).held:
                best, lowest, near = trial, peak, np.log([p, d, f])
                if peak <= PEAK:
                    return best
        return self._refined(best, near, margins) if best is not result else best

    def _refined(self, best: Stabilisation, near: Array, margins: Sensitivities) -> Stabilisation:
        """Look for a lower peak beside what was tried: of all axes alike, then of each bearing."""
        # By the simplex of Nelder and Mead, in the logarithms of the shares.
        names = list(dict.fromkeys(axis.bearing.name for axis in self.machine.axes))
        of_axis = np.array([names.index(axis.bearing.name) for axis in self.machine.axes])
        free = 3 if len(self.slower) > 1 else 2
        shares = near[None, :]
        for bearings in (1, len(names)):
            start = np.broadcast_to(shares, (bearings, 3))[:, :free]
            peak, least, at = self._lowest(start, of_axis % bearings, margins)
            if least < peak:
                best = self.loop.with_(self._shared(at, of_axis % bearings))
                shares = np.zeros((bearings, 3))
                shares[:, :free] = at
            if least < ENOUGH:
                break
        return best

    def _lowest(
        self, start: Array, of_axis: NDArray[np.intp], margins: Sensitivities
    ) -> tuple[float, float, Array]:
        """Return the peak at a start, the lowest that was found, and the logarithms there."""
        from scipy.optimize import minimize

        lowest = math.inf

        def cost(at: Array) -> float:
            nonlocal lowest
            pids = self._shared(at.reshape(start.shape), of_axis)
            peak = max(PEAK, float(margins.peaks(pids).max()))
            if peak < lowest:  # poles take longer, and are asked of the best alone
                if not self.loop.with_(pids).held:
                    return UNHELD
                lowest = peak
            return peak

        first = start.ravel()
        result: Any = minimize(
            cost, first, method="Nelder-Mead",
            options={
                "maxfev": TRIES * len(start), "xatol": 1e-2, "fatol": 1e-3,
                "initial_simplex": np.vstack([first, first + STRIDE * np.eye(len(first))]),
            },
        )  # fmt: skip
        return cost(first), float(result.fun), result.x.reshape(start.shape)

    def _shared(self, logs: Array, of_axis: NDArray[np.intp]) -> tuple[Gains, ...]:
        """Return the usual controllers with shares of given logarithms (bearings, 2 or 3)."""
        every = np.zeros((len(logs), 3))
        every[:, : logs.shape[1]] = logs
        shares = np.exp(np.clip(every, *BOUNDS))[of_axis]
        parts = zip(self.usual, shares, strict=True)
        return tuple(_changed(pid, *map(float, share)) for pid, share in parts)

    def weighted(self, result: Stabilisation) -> Stabilisation:
        """Return controllers that were changed with the weight of the reference of their gains."""
        if result.pids is self.usual:
            return result
        pids = tuple(
            pid._replace(setpoint_weight=weight_of(isolated, pid.kp, pid.ki, pid.kd))
            for pid, isolated in zip(result.pids, isolated_axes(self.machine), strict=True)
        )
        return replace(result, pids=pids)

    def calm(self, result: Stabilisation) -> Stabilisation:
        """Return the same with less of the references to kp, where a step overshoots by much."""
        pids = result.pids
        for share in WEIGHTS:
            if self.loop.overshoot(pids) <= OVERSHOOT:
                break
            pids = tuple(
                pid._replace(setpoint_weight=share * pid.setpoint_weight) for pid in result.pids
            )
        return replace(result, pids=pids)


def _changed(pid: Gains, p: float, d: float, f: float) -> Gains:
    """Return a PID with shares of its gains; neither poles nor margins need its weight."""
    return pid._replace(
        kp=pid.kp * p, ki=pid.ki * p, kd=pid.kd * d, derivative_filter=pid.derivative_filter * f
    )
