"""The peak of the sensitivity of many loops: what `LoopOf.peak` says of one, for thousands.

Of one axis the sensitivity is the ratio of two polynomials whose roots are known:
``S(z) = det(zI - A_open)/det(zI - A_closed)``, with the poles of plant and compensator over those
of the closed loop. So the peak costs three sets of eigenvalues, and no linear system at any
frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.errors import AmbkitError
from ambkit.machine.magnets import ConstantStiffness
from ambkit.simulation.control import needs_states
from ambkit.simulation.default_control import end_of_range
from ambkit.simulation.linear.control import compensator, controller
from ambkit.simulation.linear.pieces import WorkPoint, plant
from ambkit.simulation.linear.settled import estimator_at, tells
from ambkit.workflow.loop_of import LoopOf

if TYPE_CHECKING:
    from ambkit.estimate.base import Estimator
    from ambkit.machine.bearing import Bearing
    from ambkit.models.linear import LinearSystem
    from ambkit.simulation.scenario import PID

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

GRID = 160
"""Frequencies that each loop is looked at, besides those of its own poles."""
LOWEST = 1e-4
"""Of the end of the range, where they begin."""
TOPS, REFINED = 3, 32
"""So many of the highest peaks among them are refined, by steps of golden section (Kiefer 1953)."""
AT_ONCE = 128
"""Loops side by side."""


class Margins:
    """Finds peaks of abs(S), and keeps what loops have in common."""

    def __init__(self) -> None:
        self._settled: dict[Any, LinearSystem | None] = {}
        self._compensators: dict[Any, tuple[Any, LinearSystem, Complex]] = {}

    def peaks(self, loops: Sequence[tuple[Bearing, PID, Estimator | None]]) -> Array:
        """Return the peak of abs(S) of each loop within the standard's range (n,) [1].

        Infinite where the loop is unstable or nothing holds the rotor; NaN where the estimator
        settles to no gain.

        Parameters
        ----------
        loops : sequence of (Bearing, PID, Estimator or None)
            Plant, controller with all its gains, and what feeds it: None of the measurement.
        """
        found = np.full(len(loops), np.nan)
        alike: dict[tuple[int, int, float, float], list[tuple[int, Array, Complex, Array]]] = {}
        for at, (bearing, pid, estimator) in enumerate(loops):
            try:
                of = self._matrices(bearing, pid, estimator)
            except AmbkitError:  # nothing holds the rotor
                found[at] = math.inf
                continue
            if of is not None:
                top = end_of_range(bearing.sampling_time, bearing.speed)
                key = len(of[0]), len(of[2]), bearing.sampling_time, top
                alike.setdefault(key, []).append((at, *of))
        for (_, _, T, top), group in alike.items():
            for start in range(0, len(group), AT_ONCE):
                places, plants, inner, loop = zip(*group[start : start + AT_ONCE], strict=True)
                opened = np.hstack([np.linalg.eigvals(plants), inner]).astype(complex)
                closed = np.linalg.eigvals(loop).astype(complex)
                stable = (np.abs(closed) < 1).all(axis=1)
                peaks = np.full(len(places), np.inf)
                if stable.any():
                    peaks[stable] = highest(opened[stable], closed[stable], T, top)
                found[list(places)] = peaks
        return found

    def _matrices(
        self, bearing: Bearing, pid: PID, estimator: Estimator | None
    ) -> tuple[Array, Complex, Array] | None:
        """Return A of the plant, the poles of the compensator, and A of the closed loop."""
        if needs_states(pid):
            if estimator is None or not tells(estimator):
                return None
            loop = LoopOf(bearing, pid).loop(estimator)
            return loop.plant.A, loop.compensator.poles(), loop.closed.A
        point = WorkPoint.hovering(bearing)
        P = plant(bearing, point)
        fed = pid
        if estimator is None and pid.feedback != "measurement":
            fed = pid.model_copy(update={"feedback": "measurement"})
        inner = None
        if fed.feedback == "estimate" and estimator is not None:
            inner = self._at(estimator, point)
            if inner is None:
                return None
        K, poles = self._compensated(bearing, fed, inner)
        B_u, C_y, B_y, D_y = P.B[:, :1], P.C[:1], K.B[:, :1], K.D[:, :1]
        n = len(P.A)
        closed = np.empty((n + len(K.A),) * 2)
        closed[:n, :n], closed[:n, n:] = P.A + B_u @ D_y @ C_y, B_u @ K.C
        closed[n:, :n], closed[n:, n:] = B_y @ C_y, K.A
        return P.A, poles, closed

    def _compensated(
        self, bearing: Bearing, fed: PID, inner: LinearSystem | None
    ) -> tuple[LinearSystem, Complex]:
        """Return the compensator and its poles; what the bearing is besides, it does not know."""
        # Identities of what is kept with the result, so that no other takes its place.
        key = (id(fed), id(inner), bearing.sensor.gain, bearing.amplifier.gain,
               bearing.sampling_time)  # fmt: skip
        if key not in self._compensators:
            if len(self._compensators) > 1000:
                self._compensators.clear()
            shown = np.array([[1 / bearing.sensor.gain]])
            K = compensator(controller(fed, bearing), inner, shown)
            self._compensators[key] = (fed, inner), K, K.poles()
        _, K, poles = self._compensators[key]
        return K, poles

    def _at(self, estimator: Estimator, point: WorkPoint) -> LinearSystem | None:
        """Return an estimator with its gain; of one with constant stiffness it is one for all."""
        everywhere = isinstance(estimator.magnet, ConstantStiffness)
        key = (id(estimator), *(() if everywhere else (float(point.iu), float(point.x))))
        if key not in self._settled:
            if len(self._settled) > 1000:
                self._settled.clear()
            self._settled[key] = estimator_at(estimator, point) if tells(estimator) else None
        return self._settled[key]


def highest(opened: Complex, closed: Complex, T: float, top: float) -> Array:
    """Return the highest abs(S) of loops up to a frequency (n,) [1].

    Parameters
    ----------
    opened, closed : ndarray of complex (n, a), (n, b)
        Poles of plant and compensator, and of the closed loop, of z.
    T : float
        Sampling time [s].
    top : float
        End of the range [Hz].
    """

    def gain(f: Array) -> Array:
        """Return log abs(S) of each loop at frequencies of its own (n, k)."""
        z = np.exp(2j * np.pi * T * f)[:, :, None]
        up, down = z - opened[:, None, :], z - closed[:, None, :]
        with np.errstate(divide="ignore"):  # S is zero at a pole of the open loop on the circle
            return np.asarray(
                np.log(np.abs(up)).sum(axis=2) - np.log(np.abs(down)).sum(axis=2), float
            )

    own = np.abs(np.angle(closed)) / (2 * np.pi * T)
    common = np.broadcast_to(np.geomspace(LOWEST * top, top, GRID), (len(closed), GRID))
    f = np.sort(np.hstack([common, np.clip(own, LOWEST * top, top)]), axis=1)
    return np.asarray(np.exp(top_of(gain, f)))


def top_of(gain: Callable[[Array], Array], f: Array) -> Array:
    """Return the highest of curves (n,), of each between the neighbours of its highest peaks.

    Parameters
    ----------
    gain : callable
        Gives each curve at frequencies of its own (n, k), (n, k).
    f : ndarray (n, m)
        Where each is looked at first, ascending.
    """
    seen = gain(f)
    beside = np.pad(seen, ((0, 0), (1, 1)), constant_values=-np.inf)
    tops = np.where((seen >= beside[:, :-2]) & (seen >= beside[:, 2:]), seen, -np.inf)
    best = np.argsort(-tops, axis=1, kind="stable")[:, :TOPS]
    low = np.take_along_axis(f, np.maximum(best - 1, 0), axis=1)
    high = np.take_along_axis(f, np.minimum(best + 1, f.shape[1] - 1), axis=1)
    share = (math.sqrt(5) - 1) / 2
    for _ in range(REFINED):
        a, b = high - share * (high - low), low + share * (high - low)
        left = gain(a) > gain(b)
        low, high = np.where(left, low, a), np.where(left, b, high)
    refined = gain(0.5 * (low + high)).max(axis=1)
    return np.asarray(np.maximum(refined, seen.max(axis=1)))
