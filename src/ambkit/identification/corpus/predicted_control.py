"""Which controls are to be expected: what a loop will do next, told by its past alone.

A prediction that is given the controls since lets each of them act as if it came from outside. But
in a loop they answer to the very motion that is to be predicted, and what they say of it is lost:
a filter that knows the truth predicts 20.7 µm so, where the controls that were to be expected give
18.7 and an ARX model, which never sees later ones, 19.4 (a simulated rig, 10 ms ahead). So beside a
model that knows no later control stands one that does not know them either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.data.record import Record
from ambkit.identification.corpus.arx import ORDER, products, regressors, solved


@dataclass(frozen=True, eq=False)
class ExpectedControls:
    """The next control signals, linear in the last positions and control signals."""

    #: (2 ORDER + 1, ahead) Of past positions less the last one, of the controls, of a constant, and
    #: of that position.
    weights: Array

    def windows(self, record: Record) -> Array:
        """Return the last controls and those to be expected (m, ORDER + ahead) [V]."""
        rows = _rows(record, 0)
        return np.column_stack([rows[:, ORDER - 1 : 2 * ORDER - 1], rows @ self.weights])


def normal_of_controls(records: Sequence[Record], ahead: int) -> Array:
    """Return the normal equations of records, which add up over logs."""
    # returns (2 ORDER + 1, 2 ORDER + 1 + ahead)
    total = np.zeros((2 * ORDER + 1, 2 * ORDER + 1 + ahead))
    for record in records:
        rows = _rows(record, ahead)
        next_ones = np.lib.stride_tricks.sliding_window_view(record["u"][ORDER:], ahead)
        total += products(rows, next_ones)
    return total


def fit_controls(normal: Array) -> ExpectedControls:
    """Fit them."""
    # normal (2 ORDER + 1, 2 ORDER + 1 + ahead)
    return ExpectedControls(solved(normal))


def _rows(record: Record, ahead: int) -> Array:
    rows, last = regressors(record, ahead)
    return np.column_stack([rows, last])
