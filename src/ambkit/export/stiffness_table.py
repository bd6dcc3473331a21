"""Stiffnesses of any magnet as a table, just fine enough for a bound on the force error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.machine.magnets import core_module, evaluate_force, evaluate_stiffness

if TYPE_CHECKING:
    from ambkit._core import Table
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.machine import Machine
    from ambkit.machine.magnets import Precision


MOST_NODES = 32767  #: Maximum number of nodes, so that an index fits into an int with 16 bits.
DEFAULT_SHARE = 0.001  #: Default bound, over the largest force.
_MOST_ALONG = 512  # nodes along one axis
_ACROSS = 65  # nodes on the other axis, while one axis is varied
_WITHIN = 8  # points compared along a cell of that axis ...
_IN_THE_END = 16  # ... and along both sides of each cell at the end
_SAFETY = 0.98  # margin for points in between


@dataclass(frozen=True, eq=False)
class TabulatedExpert:
    """An expert's stiffnesses at the nodes of a grid over its range."""

    current: Array  #: (columns,) Nodes of the control current [A], equidistant.
    displacement: Array  #: (rows,) Nodes of the displacement [m], evenly spaced.
    k_i: Array  #: (rows, columns) Stiffnesses [N/A], [N/m].
    k_s: Array
    bound: float  #: Bound of the force error [N].
    error: float  #: Largest observed force error [N].

    def in_core(self, core: ModuleType) -> Table:
        """Build the C implementation: bilinear between the nodes, constant outside."""
        return _table(core, self.current, self.displacement, self.k_i, self.k_s)


def tabulate(
    expert: Expert, machine: Machine, *, bound: float | None = None, precision: Precision
) -> TabulatedExpert:
    """Return the smallest table with a force within a bound of the expert's."""
    # The force ``k_i iu + k_s x`` of both is compared wherever the filter evaluates it: over the
    # expert's range and beyond it, with constant stiffnesses, up to the current limits and the
    # stops.
    search = _Search(expert, machine, precision)
    if bound is None:
        forces = evaluate_force(expert, *search.points(2, 2, (50, 50)))  # without the bias force
        bound = DEFAULT_SHARE * float(np.max(np.abs(forces)))
    if not (math.isfinite(bound) and bound > 0):
        raise AmbkitError(f"force_bound must be greater than 0 N, is {bound!r}")
    for rows, columns in search.candidates(_SAFETY * bound):
        error = search.error(rows, columns, (2, 2))
        if error <= _SAFETY * bound:
            error = search.error(rows, columns, (_IN_THE_END, _IN_THE_END))
        if error <= _SAFETY * bound:
            current, displacement = search.nodes(rows, columns)
            k_i, k_s = evaluate_stiffness(expert, *np.meshgrid(current, displacement))
            return TabulatedExpert(current, displacement, k_i, k_s, bound, error)
    raise AmbkitError(
        f"force_bound = {bound:g} N needs a table larger than {MOST_NODES} nodes, or "
        f"{_MOST_ALONG} along one axis; take a larger bound, or the expert in its exact form"
    )


class _Search:
    """The expert, and the region of the comparison with tables."""

    def __init__(self, expert: Expert, machine: Machine, precision: Precision) -> None:
        self.expert = expert
        self.core = core_module(precision)
        stop = machine.clearance
        self.limits = ((machine.current_min, machine.current_max), (-stop, stop))

    def nodes(self, rows: int, columns: int) -> tuple[Array, Array]:
        return (
            np.linspace(*self.expert.current_range, columns),
            np.linspace(*self.expert.displacement_range, rows),
        )

    def candidates(self, bound: float) -> list[tuple[int, int]]:
        """Yield candidate sizes, rows and columns, the smallest first, up to a sufficient one."""
        # Bilinear interpolation is linear interpolation along both axes: its error is at least
        # about that of the worse axis, and at most the sum of both.
        rows = self.errors(bound, lambda n: self.error(n, _ACROSS, (_WITHIN, 1)))
        columns = self.errors(bound, lambda n: self.error(_ACROSS, n, (1, _WITHIN)))
        sizes = {(r, c): (rows[r], columns[c]) for r in rows for c in columns}
        enough = [r * c for (r, c), errors in sizes.items() if sum(errors) <= bound]
        most = min([MOST_NODES, *enough])
        can = [(r, c) for (r, c), errors in sizes.items() if max(errors) <= bound and r * c <= most]
        return sorted(can, key=lambda size: (size[0] * size[1], size))

    def errors(self, bound: float, error: Callable[[int], float]) -> dict[int, float]:
        """Yield the error of one axis by its number of nodes, until it is negligible."""
        results: dict[int, float] = {}
        n = 2
        while n <= _MOST_ALONG:
            results[n] = error(n)
            if results[n] < bound / 16:
                break
            n += 1 + n // 16
        return results

    def points(self, rows: int, columns: int, within: tuple[int, int]) -> tuple[Array, Array]:
        """Points of comparison: several in each cell, and the ends of the region."""
        box = self.nodes((rows - 1) * within[0] + 1, (columns - 1) * within[1] + 1)
        ends = [
            np.concatenate([[min(low, nodes[0])], nodes, [max(high, nodes[-1])]])
            for nodes, (low, high) in zip(box, self.limits, strict=True)
        ]
        iu, x = np.meshgrid(*ends)
        return iu.ravel(), x.ravel()

    def error(self, rows: int, columns: int, within: tuple[int, int]) -> float:
        """Return the largest force error of a table [N] at the points of comparison."""
        current, displacement = self.nodes(rows, columns)
        k_i, k_s = evaluate_stiffness(self.expert, *np.meshgrid(current, displacement))
        table = _table(self.core, current, displacement, k_i, k_s)
        iu, x = self.points(rows, columns, within)
        return float(np.max(np.abs(table.force(iu, x) - evaluate_force(self.expert, iu, x))))


def _table(core: ModuleType, current: Array, displacement: Array, k_i: Array, k_s: Array) -> Table:
    dx, diu = displacement[1] - displacement[0], current[1] - current[0]
    table: Table = core.Table(
        x_min=displacement[0], dx=dx, iu_min=current[0], diu=diu, k_i=k_i, k_s=k_s
    )
    return table
