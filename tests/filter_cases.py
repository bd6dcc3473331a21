"""A filter, a record for it, and what its covariance is looked at with; for several tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracles
from numpy.typing import NDArray

import ambkit
from ambkit import Bearing, ClosedLaw
from ambkit.machine.magnets import core_module

Array = NDArray[np.float64]

BEARING = Bearing.preset("zittau_axial")
SETTINGS = oracles.settings_of(BEARING)
START = np.array([2e-5, 0.01, -1.0, 1e-5])
STD = np.array([3e-5, 0.012, 5.0, 3e-5])
PRECISIONS = ("float64", "float32")


def core_filter(s: oracles.Settings, precision: Any = "float64", magnet: Any = None) -> Any:
    """A filter of the core, straight from settings; started at START, STD."""
    core = core_module(precision)
    kf = core.Kalman(magnet or core.Constant(10.05, 7537.5), **s)
    kf.reset(START, STD)
    return kf


def moving_record(duration: float, seed: int = 0) -> dict[str, Array]:
    """A rotor that swings by 0.3 mm under noise, and its stiffnesses, other ones at each step."""
    scenario = ambkit.Scenario(
        duration=duration,
        seed=seed,
        reference=ambkit.Sine(amplitude=3e-4, frequency=5.0),
        disturbance=ambkit.Sine(amplitude=3.0, frequency=20.0),
    )
    record = ambkit.simulate(BEARING, scenario)
    k_i, k_s = ClosedLaw(BEARING).stiffness(record["iu"], record["x"])
    return {"y": record["y"], "u": record["u"], "k_i": k_i, "k_s": k_s}


def full(triangle: Array) -> Array:
    """Covariances (n, 4, 4) from upper triangles (n, 10)."""
    P = np.empty((len(triangle), 4, 4))
    rows, columns = np.triu_indices(4)
    P[:, rows, columns] = P[:, columns, rows] = triangle
    return P


def least_correlation_eigenvalue(P: Array) -> float:
    """Positive exactly where P is positive definite, whatever the units of the states."""
    P = np.asarray(P, dtype=float)
    d = np.sqrt(np.diag(P))
    return float(np.linalg.eigvalsh(P / np.outer(d, d))[0])


def off(a: Array, b: Array) -> Array:
    """Greatest difference of each state, relative to its scale in b."""
    return np.asarray(np.abs(a - b).max(axis=0) / np.abs(b).max(axis=0))
