"""Restored covariances of the controllers' self-test, whose digits float loses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.arrays import Array, Bools
from ambkit.control.controller_states import Controller

STATE_TOLERANCE, CURRENT_TOLERANCE = 1e-2, 2e-4
"""Tolerances of float against double from an equal start: states over their initial standard
deviations, currents over the maximum. A fifth of the self-test's.
"""

MOST_NUMBERS = 8
"""Maximum number of restored covariance entries of a run, over half of those of its means."""

COMPARED = ("status", "mode", "usable")


@dataclass(frozen=True)
class Snapshots:
    """Snapshots of n samples."""

    restored: Bools  #: (n,): whether the covariance is restored before the sample.
    amplified: Bools  #: (n,): whether rounding is amplified nevertheless.
    covariance: Array  #: (n, entries): upper triangles after each sample.

    @classmethod
    def joined(cls, parts: Sequence[Snapshots]) -> Snapshots:
        """Return those of runs in sequence."""
        return cls(
            *(np.concatenate([getattr(part, item.name) for part in parts]) for item in fields(cls))
        )

    @property
    def at(self) -> list[int]:
        """The samples before which the covariance is restored."""
        return np.flatnonzero(self.restored).tolist()

    @property
    def before(self) -> Array:
        """Covariances restored there (snapshots, entries)."""
        return np.asarray(self.covariance[np.array(self.at, int) - 1])


def snapshots_of(controller: Controller, run: Callable[..., dict[str, NDArray[Any]]]) -> Snapshots:
    """Place as few snapshots as keep float close to double from the same recorded state."""
    # `run` maps a controller, and a restored state or None, to its output along one run.
    filter = controller.estimator
    args, options = filter._made
    sharp = type(filter)(*args, **(options | {"precision": "float64"}))
    double = replace(controller, estimator=sharp)
    simulated = run(controller, None)
    n, states = simulated["mean"].shape
    recorded = {key: simulated[key] for key in ("mean", "u", "covariance")}
    std = np.array(filter.default_std())
    axes = controller.plant.machine.axes
    most = np.array(
        [a.bearing.amplifier.current_limit / abs(a.bearing.amplifier.gain) for a in axes]
    )

    def off(restored: Bools) -> Bools:
        output = run(double, recorded | {"snapshot": restored.astype(float)})
        result = (np.abs(output["mean"] - simulated["mean"]) > STATE_TOLERANCE * std).any(axis=1)
        result |= (np.abs(output["u"] - simulated["u"]) > CURRENT_TOLERANCE * most).any(axis=1)
        for key in COMPARED:
            result |= output[key] != simulated[key]
        return np.asarray(result)

    amplified, restored = off(np.ones(n, bool)), np.zeros(n, bool)
    # Such samples change the covariance for the next one that is compared.
    restored[1:] = amplified[:-1] & ~amplified[1:]
    wanting = np.flatnonzero(off(restored) & ~amplified & ~restored)
    while wanting.size and restored.sum() < MOST_NUMBERS * n // states:
        restored[wanting[0]] = True
        wanting = np.flatnonzero(off(restored) & ~amplified & ~restored)
    if wanting.size:
        amplified[wanting[0] :] = True
    return Snapshots(restored, amplified, simulated["covariance"])
