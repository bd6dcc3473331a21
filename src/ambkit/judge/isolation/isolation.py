"""Fault isolation beside a filter, and what it cannot tell apart."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.control.linear.steady_state_filter import tangents_known
from ambkit.data.record import Record
from ambkit.judge.isolation.signatures import (
    LATE_BY,
    Places,
    Signature,
    lags_of,
    signatures_of,
    tones_of,
)
from ambkit.judge.load_following import operating_point
from ambkit.machine.axes import bias_forces
from ambkit.machine.machine import Machine

WINDOW = 0.08  #: Length of the window [s].
LONGEST = 1024  #: Samples of the window at most.
SEARCHES = 4  #: Of a window.
LIMIT, MARGIN = 40.0, 16.0
"""Log likelihood ratios (times two): of an alarm, and between what is named and what is not."""

LIKE, FINE, ALIKE = 0.05, 0.001, 0.5
"""Shares of what is observed that a linearised signature may miss, that a replayed one may, and by
which those of a group do not differ: a lag is seen in readings that are late already."""
NINE_IN_TEN = 1.65
"""Standard deviations that 19 in 20 are above: nine in ten pass two limits at once."""


@dataclass(frozen=True, eq=False)
class Searches:
    """What the searches along a record say, n of them, of k faults."""

    t: Array  #: (n,) Times [s].
    signatures: tuple[Signature, ...]  #: (k,)
    likelihood: Array  #: (n, k) Twice the log likelihood ratio against no fault [1].
    size: Array  #: (n, k, 2) [unit of the fault]
    std: Array  #: (n, k, 2) Standard deviation of that.
    since: NDArray[np.intp]  #: (n, k) Samples.
    instead: NDArray[np.intp]  #: (n, k) The named fault in whose place it explains as much, or -1.
    before: NDArray[np.bool_]  #: (n, k) Whether it was there before the window.
    contact: NDArray[np.intp]  #: (n,) Samples since the rotor was on a stop, up to two windows.
    roughness: Array  #: (n,) Variance of slow innovations before the window over the stated one.
    window: int  #: Samples that a search sees.

    @property
    def named(self) -> NDArray[np.bool_]:
        """Which are named (n, k)."""
        return np.asarray(self.instead == np.arange(len(self.signatures)), bool)

    @property
    def alarms(self) -> NDArray[np.bool_]:
        """Whether a fault is named that no disturbance force explains (n,)."""
        load = np.array([signature.load for signature in self.signatures])
        faults = self.named & ~load
        for k in np.flatnonzero(load):
            at, of = np.arange(len(faults)), self.instead[:, k]
            faults[at[of >= 0], of[of >= 0]] = False
        return np.asarray(faults.any(axis=1), bool)

    def groups(self, k: int) -> list[list[str]]:
        """Return the names that a search gives each fault, the likeliest first."""
        names = [signature.name for signature in self.signatures]
        return [
            [names[j], *(names[i] for i in np.flatnonzero(self.instead[k] == j) if i != j)]
            for j in np.flatnonzero(self.named[k])
        ]


class LeastSizes(NamedTuple):
    """The least sizes of k faults that can be detected and named, in the units of the faults."""

    detected: Array  #: (k,) That raise an alarm.
    apart: Array  #: (k, k) That exclude each other fault.

    @property
    def named(self) -> Array:
        """That are named, and no other (k,)."""
        return np.asarray(np.maximum(self.detected, self.apart.max(axis=1)), float)


def _least(M: Array) -> float:
    """Return the information in the worst direction of one or two columns."""
    return float(np.linalg.eigvalsh(M)[0])


def _left(M: Array, own: NDArray[np.intp], other: NDArray[np.intp]) -> float:
    """Return the information of a fault beside another one."""
    of_other = M[np.ix_(other, other)]
    if not _least(of_other) > 0:
        return _least(M[np.ix_(own, own)])
    across = M[np.ix_(own, other)]
    return _least(M[np.ix_(own, own)] - across @ np.linalg.solve(of_other, across.T))


def window_of(machine: Machine) -> int:
    """Return the samples that are searched."""
    return min(LONGEST, max(64, round(WINDOW / machine.sampling_time)))


class FaultIsolation:
    """Fault isolation beside a filter."""

    def __init__(self, kalman: Any):
        if not kalman.by_model or not hasattr(kalman.core, "covariance"):
            raise AmbkitError(f"{kalman.name}: no model of the machine to isolate faults by")
        self.kalman = kalman
        self.signatures = tuple(signatures_of(kalman.view, kalman.magnet))
        self.window = window_of(kalman.machine)
        self.every = self.window // SEARCHES
        self.core = kalman.engine.core.Isolation(self.constants)

    @cached_property
    def constants(self) -> dict[str, Any]:
        """What the core is made of."""
        kalman = self.kalman
        A, b, H, units, K = _error_model(kalman)
        gradient = np.vstack([H, kalman.model.r * units])
        tones = np.array(tones_of(kalman.view)) * kalman.machine.sampling_time
        columns = [column for signature in self.signatures for column in signature.columns]
        first = np.cumsum([0, *(len(signature.columns) for signature in self.signatures)])
        places, lags = Places(kalman.view), lags_of(kalman.machine)
        form = np.vstack([kalman.model.r, _momenta(kalman)])
        return {
            "states": len(A), "forces": len(b), "sensors": len(H), "columns": len(columns),
            "tones": len(tones), "forms": len(form), "window": self.window, "spare": self.every,
            "late": LATE_BY, "speed": kalman.view.speed or 0.0,
            "limit": LIMIT, "margin": MARGIN, "like": LIKE, "fine": FINE, "alike": ALIKE,
            "gradients": len(gradient), "gradient": gradient.ravel().tolist(),
            "A": A.ravel().tolist(), "b": b.ravel().tolist(), "H": H.ravel().tolist(),
            "h": (kalman.model.h * units).ravel().tolist(),
            "k_s": np.atleast_1d(_tangents(kalman)[1]).tolist(),
            "bias": [of.magnet.bias_current or 0.0 for of in kalman.view.isolated],
            "F_0": bias_forces(kalman.magnet, kalman.machine),
            "unit": units.tolist(), "K": None if K is None else K.ravel().tolist(),
            "form": form.ravel().tolist(),
            "lag": [share for lag in lags for share in _lag(lag / kalman.machine.sampling_time)],
            "turn": np.column_stack([np.cos(tones), np.sin(tones)]).ravel().tolist(),
            "faults": [
                (int(at), len(signature.columns), signature.load, signature.group)
                for at, signature in zip(first, self.signatures, strict=False)
            ],
            "terms": [
                (k, term.direction, term.signal, places.gradient(term.signal), term.weight)
                for k, column in enumerate(columns) for term in column
            ],
        }  # fmt: skip

    def run(self, record: Record) -> Searches:
        """Run the filter along a record, and search every quarter of a window."""
        kalman = self.kalman
        y, u = kalman._start(record)
        speed, measured = kalman._rotation(record)
        rotation = {} if speed is None else {"model": kalman.engine.model_of_core, "speed": speed}
        result = self.core.run(kalman.core, y, u, self.every, measured=measured, **rotation)
        searches = np.arange(1, len(result["since"]) + 1) * self.every - 1
        return Searches(
            record.t[searches], self.signatures, np.asarray(result["likelihood"], float),
            np.asarray(result["size"], float),
            np.sqrt(np.maximum(np.asarray(result["variance"], float), 0.0)),
            np.asarray(result["since"], int), np.asarray(result["instead"], int),
            np.asarray(result["before"], bool), np.asarray(result["contact"], int),
            np.asarray(result["roughness"], float), self.window,
        )  # fmt: skip

    def least_sizes(self) -> LeastSizes:
        """Return the least sizes of faults that the last search of the last run can tell."""
        # By Fisher's information: nine in ten pass the limit and the margin to each other fault.
        M, k = self.information(self.span), len(self.signatures)
        first = np.cumsum([0, *(len(s.columns) for s in self.signatures)])
        of = [np.arange(first[j], first[j + 1]) for j in range(k)]
        seen = np.sqrt(LIMIT) + NINE_IN_TEN
        apart = np.sqrt(MARGIN) + NINE_IN_TEN
        detected, separated = np.full(k, np.inf), np.full((k, k), np.inf)
        for j in range(k):
            own = _least(M[np.ix_(of[j], of[j])])
            detected[j] = seen / np.sqrt(own) if own > 0 else np.inf
            for other in range(k):
                if other == j or not own > 0:
                    continue
                left = _left(M, of[j], of[other])
                if left > 2 * (ALIKE if self.alike(j, other) else FINE) * own:
                    separated[j, other] = apart / np.sqrt(left)
        np.fill_diagonal(separated, 0.0)
        return LeastSizes(detected, separated)

    def alike(self, one: int, other: int) -> bool:
        """Whether two faults are the same or of one group."""
        group = self.signatures[one].group
        return one == other or 0 < group == self.signatures[other].group

    @property
    def span(self) -> int:
        """Samples of a fault by which a search knows it: one begins in each quarter of a window."""
        return self.window - self.every

    def information(self, since: int, *, before: bool = False) -> Array:
        """Information of all columns (k, k) on faults that began so many samples ago."""
        return np.asarray(self.core.information(self.kalman.core, since, before), float)


def _tangents(kalman: Any) -> Any:
    """Return the tangents of the magnets at the operating point."""
    return tangents_known(kalman.magnet, "tangent", operating_point(kalman.machine))


def _momenta(kalman: Any) -> Array:
    """Return the forces that give the rotor its velocity within a sample, by the state."""
    moving = np.array([float(state.role == "velocity") for state in kalman.states])
    E = kalman.linear_model(*_tangents(kalman)).E
    return np.asarray(np.linalg.pinv(E * moving[:, None]) * moving, float)


def _lag(samples: float) -> tuple[float, float]:
    """Return the shares of the last reading and of its change by which a lag follows a ramp."""
    old = -math.expm1(-1 / samples)
    return old, 1 - samples * old


def _error_model(kalman: Any) -> tuple[Array, Array, Array, Array, Array | None]:
    """Return A, b, H of the filter's error, the units of its states, and a constant gain."""
    model = kalman.linear_model(*_tangents(kalman))
    units = np.array(kalman.default_std())
    gain = getattr(kalman, "gain", None)
    constant = kalman.steady == "constant" and gain is not None
    K = (np.asarray(gain) / units)[None] if constant else None
    return model.A * units / units[:, None], model.E.T / units, model.H * units, units, K
