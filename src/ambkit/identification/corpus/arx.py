"""The baseline that knows no physics: an ARX model, straight at so many samples ahead.

``y[k+h] - y[k]`` by least squares from the last positions and controls (Ljung 1999, ch. 4; directly
for h samples as Marcellino, Stock and Watson 2006). Only controls up to sample k enter: in a loop
those that come later have the measurements in them that are to be predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record

ORDER = 30  #: Past samples of each signal.


@dataclass(frozen=True, eq=False)
class ARX:
    """An ARX model, h samples ahead."""

    ahead: int  #: How many samples.
    #: (2 ORDER,) Of past positions less the last one, of the controls, and of a constant.
    weights: Array

    def predict(self, record: Record) -> Array:
        """Return predictions of ``y[k + ahead]`` from sample k on [m], NaN for the first ones."""
        rows, last = regressors(record, self.ahead)
        result = np.full(len(record) - self.ahead, np.nan)
        result[ORDER - 1 :] = last + rows @ self.weights
        return result


def normal_of(records: Sequence[Record], ahead: int) -> Array:
    """Return the normal equations of records (2 ORDER, 2 ORDER + 1), which add up over logs."""
    total = np.zeros((2 * ORDER, 2 * ORDER + 1))
    for record in records:
        rows, last = regressors(record, ahead)
        total += products(rows, record["y"][ORDER - 1 + ahead :] - last)
    return total


def products(rows: Array, targets: Array) -> Array:
    """Return what a record adds to normal equations, of the samples that miss nothing."""
    # rows (n, p); targets (n,), (n, q); returns (p, p + q)
    both = np.column_stack([rows, targets])
    finite_rows = np.isfinite(both).all(axis=1)
    if not finite_rows.all():
        both = both[finite_rows]
    return np.asarray(both[:, : rows.shape[1]].T @ both)


def fit_arx(normal: Array, ahead: int) -> ARX:
    """Fit one."""
    # normal (2 ORDER, 2 ORDER + 1)
    return ARX(ahead, solved(normal)[:, 0])


def solved(normal: Array) -> Array:
    """Solve normal equations of regressors of very different sizes."""
    # normal (p, p + q); returns (p, q)
    p = len(normal)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    left, right = normal[:, :p] / np.outer(scale, scale), normal[:, p:] / scale[:, None]
    weights, *_ = np.linalg.lstsq(left, right, rcond=1e-12)
    return np.asarray(weights / scale[:, None])


def regressors(record: Record, ahead: int) -> tuple[Array, Array]:
    """Return regressors (m, 2 ORDER) and the last positions (m,), of samples from ORDER - 1 on."""
    windows = np.lib.stride_tricks.sliding_window_view
    y, u = (windows(record[name], ORDER)[: len(record) - ORDER + 1 - ahead] for name in ("y", "u"))
    last = y[:, -1]
    return np.column_stack([y[:, :-1] - last[:, None], u, np.ones(len(last))]), last
