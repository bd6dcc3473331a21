"""Position and control of a floating rotor where the sensor's noise goes round the loop.

Position and control then share that noise, and plain regression of the acceleration is biased. What
both were a while ago shares none of it, and serves as instruments (two-stage least squares;
Söderström and Stoica 1983, Instrumental Variable Methods).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.reading.levitation_test import (
    ALIKE,
    POLE,
    LevitationFit,
    decimated,
    moving_averages,
)

AGO = 3  #: Boxes between what is regressed and its instruments: half of the kernel.
LONG = 60  #: Boxes that a record has at least.

TELLS = (2.0, 13.0)
"""Standard errors by which pole and gain are off zero: in each of three bands, and in sum."""


def instrumented(channels: Array, rows: Sequence[int]) -> list[LevitationFit]:
    """Find the pairs of channels that move as a rotor and its current do; the best first."""
    # channels (m, n)
    fits: dict[tuple[int, int], list[tuple[int, float, float, float, float]]] = {}
    for box, thin, values in decimated(channels[list(rows)]):
        if values.shape[1] < LONG * box:
            break
        sums = _sums(values, box, thin)
        for i, j in permutations(range(len(rows)), 2):
            fits.setdefault((rows[i], rows[j]), []).append((box * thin, *_fit(*sums, i, j)))
    results = [best for pair, bands in fits.items() if (best := _agreed(*pair, bands))]
    return sorted(results, key=lambda item: -item.evidence)


def _sums(values: Array, box: int, thin: int) -> tuple[Array, Array, Array, Array, int]:
    """Return products of instruments, of smoothed channels and their derivatives, and the rows."""
    four = moving_averages(values, box, 4)
    bent = (four[:, 2 * box :] - 2 * four[:, box:-box] + four[:, : -2 * box]) / (box * thin) ** 2
    smooth = moving_averages(four, box, 2)[:, 1 : 1 + bent.shape[1]]
    ago, step = AGO * box, max(1, box // 2)
    rate = np.gradient(smooth, thin, axis=1)
    z = np.concatenate([smooth, rate])[:, :-ago:step]
    s, v, a = (item[:, ago::step] for item in (smooth, rate, bent))
    z, s, v, a = (item - item.mean(axis=1, keepdims=True) for item in (z, s, v, a))
    both = np.concatenate([s, a, v])
    return z @ z.T, z @ both.T, s @ both.T, np.einsum("ik,ik->i", a, a), s.shape[1]


def _fit(
    zz: Array, zb: Array, sb: Array, aa: Array, count: int, i: int, j: int
) -> tuple[float, float, float, float]:
    """Return a and b of a pair, and by how many standard errors each is off zero."""
    m = len(aa)
    z, x = [i, j, m + i, m + j], [i, j]
    try:
        estimate, spread = _two_stages(zz, zb, z, x, m + i)
        free, _ = _two_stages(zz, zb, z, [i, j, 2 * m + i], m + i)
    except np.linalg.LinAlgError:
        return -1.0, 0.0, 0.0, 0.0
    a, b = estimate
    if not free[0] > 0.5 * a:  # friction explains it as well
        return -1.0, 0.0, 0.0, 0.0
    left = aa[i] - 2 * (a * sb[i, m + i] + b * sb[j, m + i])
    left += a * a * sb[i, i] + 2 * a * b * sb[i, j] + b * b * sb[j, j]
    # Rows half a box apart share their kernel: a quarter of them count.
    error = spread * np.sqrt(max(left, 0.0) / count * 4)
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(a), float(b), float(abs(a) / error[0]), float(abs(b) / error[1])


def _two_stages(zz: Array, zb: Array, z: list[int], x: list[int], y: int) -> tuple[Array, Array]:
    """Regress y on x with instruments z, all columns: coefficients, and their unscaled errors."""
    cross = zb[np.ix_(z, x)]
    weighed = np.linalg.solve(zz[np.ix_(z, z)], zb[np.ix_(z, [*x, y])])
    normal = cross.T @ weighed[:, :-1]
    return (
        np.linalg.solve(normal, cross.T @ weighed[:, -1]),
        np.sqrt(np.maximum(np.diag(np.linalg.inv(normal)), 0)),
    )


def _agreed(
    i: int, j: int, bands: Sequence[tuple[int, float, float, float, float]]
) -> LevitationFit | None:
    """Return what three neighbouring bands tell, if they tell the same."""
    best = None
    for near in zip(bands, bands[1:], bands[2:], strict=False):
        box, a, b, of_a, of_b = (np.array(item) for item in zip(*near, strict=True))
        if not (a.min() > 0 and abs(np.sign(b).sum()) == 3):
            continue
        pole, gain = np.sqrt(a), abs(b)
        mean_pole = pole.mean() * box[1]
        evidence = np.minimum(of_a, of_b)
        if (
            pole.max() <= ALIKE * pole.min() and gain.max() <= ALIKE * gain.min()
            and POLE[0] < mean_pole < POLE[1] and evidence.min() > TELLS[0]
            and evidence.sum() > TELLS[1]
            and (best is None or evidence.sum() > best.evidence)
        ):  # fmt: skip
            best = LevitationFit(
                i,
                j,
                float(pole.mean()),
                float(b[1]),
                0.0,
                int(box[1]),
                float(evidence.sum()),
                False,
            )
    return best
