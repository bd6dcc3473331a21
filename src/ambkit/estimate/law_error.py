"""What the force law of a filter leaves out of the machine's own."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.arrays import Array
from ambkit.machine.axes import isolated_axes, models_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import MagnetModel, evaluate_force, magnet_of

DEGREE = 5
"""Of the polynomial in current and displacement over the gaps' squares (``ambkit/law_error.h``): of
constant stiffnesses beside an ideal magnet it is exact."""
NODES = 13  #: Of currents within their limits, and of displacements between the stops.
DIGITS = 6  #: Of a coefficient, behind the greatest error.
FLOOR = 0.02  #: Errors are fitted in shares of themselves, from this share of the greatest on.


def law_errors(machine: Machine, magnet: Any) -> Array:
    """Return the coefficients of what a magnet's law differs by, axis by axis; empty: nothing."""
    axes = zip(isolated_axes(machine), models_of(magnet), strict=True)
    rows = np.array([_of_axis(axis, model) for axis, model in axes])
    return rows.ravel() if rows.any() else np.zeros(0)


def _of_axis(axis: Machine, known: MagnetModel) -> Array:
    law, x_max = magnet_of(axis), axis.clearance
    i_max = max(-axis.current_min, axis.current_max)
    i, x = (item.ravel() for item in np.meshgrid(
        np.linspace(axis.current_min, axis.current_max, NODES), np.linspace(-x_max, x_max, NODES)
    ))  # fmt: skip
    true = evaluate_force(law, i, x)
    error = evaluate_force(known, i, x) - true
    powers = [(p, q) for p in range(DEGREE, -1, -1) for q in range(DEGREE - p, -1, -1)]
    max_error = np.abs(error).max()
    if max_error <= 1e-9 * np.abs(true).max():
        return np.zeros(len(powers) + 1)
    by_gap = 1 / axis.magnet.air_gap**2
    near = (1 - by_gap * x**2) ** 2
    terms = np.column_stack([(i / i_max) ** p * (x / x_max) ** q / near for p, q in powers])
    weight = 1 / (FLOOR * max_error + np.abs(error))
    fitted = np.linalg.lstsq(terms * weight[:, None], error * weight, rcond=None)[0]
    rounded = np.round(fitted / max_error, DIGITS) + 0.0  # the same whatever solved for it
    return np.append(max_error * rounded / [i_max**p * x_max**q for p, q in powers], by_gap)
