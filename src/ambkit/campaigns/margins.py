"""The peak of the sensitivity of many loops: what `LoopOf.peak` says of one, for thousands.

Seen along an axis with all other loops closed, the sensitivity is the ratio of two polynomials
whose roots are known: ``S(z) = d det(zI - A_open)/det(zI - A_closed)``, where A_open has
the loop of that axis open. So the peak costs eigenvalues, and no linear system at any frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.arrays import Array, Complex
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.linear_controller import compensator, controller
from ambkit.control.linear.linear_plant import OperatingPoint, alike, plants
from ambkit.control.linear.steady_state_filter import estimator_at, estimators_at, tells
from ambkit.estimate.batch import processors
from ambkit.estimate.estimator import Estimator
from ambkit.judge.loop.loop_of import LoopOf
from ambkit.machine.magnets import ConstantStiffness
from ambkit.machine.rotors.modes import end_of_range
from ambkit.models.linear import LinearSystem
from ambkit.simulation.planned import Planned

GRID = 160
"""Frequencies that each loop is looked at, besides those of its own poles."""
LOWEST = 1e-4
"""Of the end of the range, where they begin."""
TOPS, REFINED = 3, 32
"""So many of the highest peaks among them are refined, by steps of golden section (Kiefer 1953)."""
AT_ONCE = 512
"""Loops side by side."""


def peaks(runs: Sequence[Planned], threads: int | None = None) -> Array:
    """Return the peak of abs(S) of each run's loop within the standard's range (n,) [1]."""
    # Of the worst axis, at the machine's own speed. Infinite where the loop is unstable or nothing
    # holds the rotor; NaN where the estimator settles to no gain. Loops of one axis with a PID are
    # looked at many at once.
    result = np.full(len(runs), np.nan)
    points: dict[int, OperatingPoint] = {}
    groups: dict[Any, list[int]] = {}
    single_axes: list[int] = []
    for at, run in enumerate(runs):
        law = run.scenario.controller
        if not run.bearing.single or law.needs_estimate or law.block:  # of as many states as others
            single_axes.append(at)
            continue
        try:
            points[at] = OperatingPoint.equilibrium(run.axis)
        except AmbkitError:  # nothing holds the rotor
            result[at] = math.inf
            continue
        fed = _fed(run)
        if fed is None or tells(fed):
            pid, bearing = run.scenario.controller, run.axis
            key = (*alike(bearing), bearing.speed, pid.ki > 0, id(fed))
            groups.setdefault(key, []).append(at)
    for group in groups.values():
        for start in range(0, len(group), AT_ONCE):
            places = group[start : start + AT_ONCE]
            batch: list[Any] = [runs[at] for at in places]
            result[places] = _highest(batch, [points[at] for at in places])
    with ThreadPoolExecutor(threads or processors()) as pool:
        result[single_axes] = list(pool.map(peak_of, [runs[at] for at in single_axes]))
    return result


def peak_of(run: Planned) -> float:
    """Return the peak of one, see `peaks`."""
    fed = _fed(run)
    if fed is not None and not tells(fed):
        return math.nan
    try:
        of = LoopOf(run.bearing, run.scenario.controller, law=run.controllers)
        loop = of.loop(fed)
    except AmbkitError:  # nothing holds the rotor
        return math.inf
    closed, m = loop.closed, loop.measurements
    to: Any = np.eye(m) if loop.added is None else loop.added
    seen: Any = np.eye(m) if loop.shown is None else loop.shown
    B, C = closed.B[:, :m] @ to, seen @ closed.C[:m]
    through = np.diag(seen @ (np.eye(m) + closed.D[:m, :m]) @ to)
    poles = np.linalg.eigvals(closed.A).astype(complex)
    if not (np.abs(poles) < 1).all():
        return math.inf
    # Opened at one axis: its position is fed back with the opposite sign.
    opened = np.linalg.eigvals(closed.A - B.T[:, :, None] * C[:, None, :] / through[:, None, None])
    poles = np.broadcast_to(poles, opened.shape)
    return float((through * highest(opened.astype(complex), poles, loop.T, of.top)).max())


def _highest(runs: Sequence[Planned], points: Sequence[OperatingPoint]) -> Array:
    """Return the peaks of loops alike (n,)."""
    try:
        opened, closed = _poles(runs, points)
    except AmbkitError:  # an estimator of one of them has no gain
        if len(runs) == 1:
            return np.array([math.inf])
        return np.concatenate([
            _highest([run], [at]) for run, at in zip(runs, points, strict=True)
        ])  # fmt: skip
    stable, result = (np.abs(closed) < 1).all(axis=1), np.full(len(runs), np.inf)
    if stable.any():
        bearing = runs[0].axis
        T = bearing.sampling_time
        result[stable] = highest(opened[stable], closed[stable], T, end_of_range(T, bearing.speed))
    return result


def _fed(run: Planned) -> Estimator | None:
    """Return the estimator that feeds the controllers."""
    return run.estimator if run.scenario.feedback == "estimate" else None


def _poles(runs: Sequence[Planned], points: Sequence[OperatingPoint]) -> tuple[Complex, Complex]:
    """Return the poles of plant and compensator, and of the closed loop, each (n, ...)."""
    bearings = [run.axis for run in runs]
    P, fed = plants(bearings, points), _fed(runs[0])
    inner = None if fed is None else _estimators(fed, points)
    made: dict[tuple[int, float, float], LinearSystem] = {}
    parts = []
    for bearing, pid in zip(bearings, (run.scenario.controller for run in runs), strict=True):
        key = id(pid), bearing.amplifier.gain, bearing.sampling_time
        if key not in made:
            made[key] = controller(pid, bearing, measured=fed is None)
        parts.append(made[key])
    A, B, C, D = (np.array([getattr(one, name) for one in parts]) for name in "ABCD")
    gains = np.array([1 / bearing.sensor.gain for bearing in bearings])[:, None, None]
    K = compensator(replace(parts[0], A=A, B=B, C=C, D=D), inner, gains)
    B_u, C_y, B_y, D_y = P.B[..., :1], P.C[..., :1, :], K.B[..., :1], K.D[..., :1]
    closed = np.block([[P.A + B_u @ D_y @ C_y, B_u @ K.C], [B_y @ C_y, K.A]])
    opened = [np.linalg.eigvals(of).astype(complex) for of in (P.A, K.A)]
    return np.hstack(opened), np.linalg.eigvals(closed).astype(complex)


def _estimators(estimator: Estimator, points: Sequence[OperatingPoint]) -> LinearSystem:
    """Return an estimator with its gain at points; of constant stiffness it is one for all."""
    n = len(points)
    if isinstance(estimator.magnet, ConstantStiffness) or not estimator.by_model:
        one = estimator_at(estimator, points[0])
        A, B, C, D = (np.repeat(getattr(one, name)[None], n, axis=0) for name in "ABCD")
    else:
        one = estimators_at(estimator, points)
        A, B, C, D = (
            np.broadcast_to(of, (n, *of.shape[-2:])) for of in (one.A, one.B, one.C, one.D)
        )
    return replace(one, A=A, B=B, C=C, D=D)


def highest(opened: Complex, closed: Complex, T: float, top: float) -> Array:
    """Return the highest abs(S) of loops up to a frequency (n,) [1]."""
    # opened (n, a); closed (n, b)

    def gain(f: Array) -> Array:
        """Return log abs(S) of each loop at frequencies of its own (n, k)."""
        z = np.exp(2j * np.pi * T * f)
        with np.errstate(divide="ignore"):  # S is zero at a pole of the open loop on the circle
            return np.asarray(np.log(np.abs(_product(z, opened) / _product(z, closed))), float)

    own = np.abs(np.angle(closed)) / (2 * np.pi * T)
    common = np.broadcast_to(np.geomspace(LOWEST * top, top, GRID), (len(closed), GRID))
    f = np.sort(np.hstack([common, np.clip(own, LOWEST * top, top)]), axis=1)
    return np.asarray(np.exp(top_of(gain, f)))


def _product(z: Complex, poles: Complex) -> Complex:
    """Return the product of z (n, k) less each of the poles (n, m) of its row."""
    result = z - poles[:, :1]
    for k in range(1, poles.shape[1]):
        result *= z - poles[:, k : k + 1]
    return result


def top_of(gain: Callable[[Array], Array], f: Array) -> Array:
    """Return the highest of curves (n,), of each between the neighbours of its highest peaks."""
    # f (n, m)
    seen = gain(f)
    beside = np.pad(seen, ((0, 0), (1, 1)), constant_values=-np.inf)
    tops = np.where((seen >= beside[:, :-2]) & (seen >= beside[:, 2:]), seen, -np.inf)
    best = np.argsort(-tops, axis=1, kind="stable")[:, :TOPS]
    low = np.take_along_axis(f, np.maximum(best - 1, 0), axis=1)
    high = np.take_along_axis(f, np.minimum(best + 1, f.shape[1] - 1), axis=1)
    share = (math.sqrt(5) - 1) / 2
    a, b = high - share * (high - low), low + share * (high - low)
    at_a, at_b = gain(a), gain(b)
    for _ in range(REFINED):
        left = at_a > at_b
        low, high = np.where(left, low, a), np.where(left, b, high)
        new = np.where(left, high - share * (high - low), low + share * (high - low))
        at_new = gain(new)
        a, b = np.where(left, new, b), np.where(left, a, new)
        at_a, at_b = np.where(left, at_new, at_b), np.where(left, at_a, at_new)
    refined = gain(0.5 * (low + high)).max(axis=1)
    return np.asarray(np.maximum(refined, seen.max(axis=1)))
