"""Which channels move as a levitated rotor and the voltage across its coil do.

A voltage drives the current, ``L i' + R i + k_u v = u``, which moves the rotor: ``x''' = -r x'' + c
v + r a x + g u`` with r = R/L, of third order with one unstable pole. References and stable loops
have none. Each pair is fitted in frequency bands, as for a current
(`ambkit.data.reading.levitation_test`), with past values as instruments; adjacent bands must agree
on the poles.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.levitation_test import (
    AGO,
    ALIKE,
    NO_FIT,
    OPPOSED,
    TURNS,
    LevitationFit,
    agreed_pairs,
    moving_averages,
    two_stages,
)

ORDER = 3  #: Of the derivative that is explained.
TELLS = (1.5, 6.0)  #: Least gain over its standard error: in each of the bands, in sum.


def voltage_fits(channels: Array, rows: Sequence[int]) -> list[LevitationFit]:
    """Find the pairs of channels that move as a rotor and its voltage do; the best first."""
    return agreed_pairs(channels, rows, _derivatives, _fit, TELLS, ALIKE**2)


def _derivatives(values: Array, box: int, thin: int) -> tuple[Array, int]:
    """Return smoothed channels and their derivatives (4, m, rows), all by one kernel of a box."""
    size = values.shape[1] - 6 * (box - 1) - ORDER
    result = []
    for order in range(ORDER + 1):
        part = moving_averages(values, box, 6 - order)
        for _ in range(order):
            part = (part[:, box:] - part[:, :-box]) / (box * thin)
        # Each difference is half a sample early: means of two put it in the middle.
        for _ in range(ORDER - order):
            part = (part[:, 1:] + part[:, :-1]) / 2
        result.append(part[:, :size])
    return np.array(result), box


def _fit(derivatives: Array, box: int, i: int, j: int) -> tuple[float, float, float, float]:
    """Return pole, rate of the coil, gain, and that over its error."""
    ago, step = AGO * box, max(1, box // 2)
    regressors = np.array([*derivatives[2::-1, i], derivatives[0, j]])
    instruments = np.concatenate([derivatives[:3, i], derivatives[:2, j]])[:, :-ago:step]
    rows = np.array([*regressors, derivatives[ORDER, i]])[:, ago::step]
    z, rows = (item - item.mean(axis=1, keepdims=True) for item in (instruments, rows))
    scale = rows.std(axis=1)
    # The plant slows down what the control does; a controller, which an unstable one may look like,
    # does the opposite. Nor is a position driven by its copy.
    speed = [derivatives[1, k].std() / max(derivatives[0, k].std(), 1e-300) for k in (i, j)]
    alike = np.corrcoef(derivatives[0, i], derivatives[0, j])[0, 1] if scale.all() else 1.0
    if speed[1] <= speed[0] or abs(alike) > TURNS:
        return NO_FIT
    rows, z = rows / scale[:, None], z / z.std(axis=1, keepdims=True)
    try:
        weights, spread = two_stages(z @ z.T, z @ rows.T, list(range(len(z))), [0, 1, 2, 3], 4)
    except np.linalg.LinAlgError:
        return NO_FIT
    left = float(np.mean((rows[4] - weights @ rows[:4]) ** 2))
    # Rows half a box apart share their kernel: a quarter of them count.
    error = max(2 * float(spread[3]) * np.sqrt(left), 1e-300)
    w = weights * scale[4] / scale[:4]
    poles = np.roots([1.0, *-w[:3]])
    unstable = poles[poles.real > 0]
    # As in balance, position and voltage are against each other; a velocity and it are not.
    if unstable.size != 1 or not w[0] < 0 or -np.sign(w[3]) * alike < OPPOSED:
        return NO_FIT
    return float(unstable[0].real), -float(w[0]), float(w[3]), abs(weights[3]) / error
