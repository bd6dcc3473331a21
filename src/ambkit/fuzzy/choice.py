"""How many rules measured points carry: cross-validation, and the smallest network that is enough.

Lines of the measured grid are left out, a network is trained on the others, and held to the points
left out. Whole lines, not points: an error of the force that is smooth over the grid is still seen
by the neighbours of a single point, and more rules would look better than they are. The lines at
the edge stay, as without them the network would be asked beyond all that it has learned.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ambkit._core import MAX_RULES
from ambkit.errors import AmbkitError
from ambkit.fuzzy.training import train
from ambkit.identification.force_table import ForceTable
from ambkit.identification.stiffness import StiffnessMap, stiffness_map

if TYPE_CHECKING:
    from ambkit.bearing import Bearing

Array = NDArray[np.float64]
Fold = tuple[ForceTable, NDArray[np.bool_]]
Shape = tuple[int, int]
"""Rules along the current, and along the displacement."""

CANDIDATES: tuple[Shape, ...] = (
    (2, 2), (3, 3), (4, 3), (3, 4), (4, 4), (5, 3), (3, 5), (5, 5), (7, 5), (5, 7), (7, 7),
)  # fmt: skip
"""Grids of rules that are tried, as far as the points allow."""

FOLDS = 4
"""Sets of lines in each direction; no two lines of a set are neighbours."""

PATIENCE = 3
"""So many larger networks in a row that are no better end the search: they cost the most."""

EPOCHS = 30
"""Steps of least squares in each training here: what the rest of them changes is less than the
standard errors, and costs five times as much."""


@dataclass(frozen=True)
class Candidate:
    """A grid of rules, and how it does on points that it was not trained on.

    Attributes
    ----------
    shape : tuple of 2 int
        Rules along the current, and along the displacement.
    error : float
        RMS error at the points left out, in standard errors of the points: 1 is as good as they
        are known. In newtons where their standard errors are not known.
    standard_error : float
        Of `error`, from its scatter over the sets of lines that were left out.
    """

    shape: Shape
    error: float
    standard_error: float

    @property
    def rules(self) -> int:
        """Number of rules."""
        return self.shape[0] * self.shape[1]

    @property
    def name(self) -> str:
        """As ``--rules`` takes it: ``"5x3"``."""
        return f"{self.shape[0]}x{self.shape[1]}"


@dataclass(frozen=True)
class RuleChoice:
    """What cross-validation says about the number of rules.

    Attributes
    ----------
    candidates : tuple of Candidate
        What was tried, from few rules to many.
    weighted : bool
        The errors are in standard errors of the points; otherwise in newtons.
    folds : int
        Sets of lines that were left out, one after the other.
    """

    candidates: tuple[Candidate, ...]
    weighted: bool
    folds: int

    @property
    def best(self) -> Candidate:
        """The one with the least error."""
        return min(self.candidates, key=lambda c: c.error)

    @property
    def limit(self) -> float:
        """Error up to which a candidate is as good as the best: one standard error above it."""
        return self.best.error + self.best.standard_error

    @property
    def chosen(self) -> Candidate:
        """The smallest network within the limit; of two with as many rules the better one."""
        enough = [c for c in self.candidates if c.error <= self.limit]
        return min(enough, key=lambda c: (c.rules, c.error))


def choose_rules(
    bearing: Bearing,
    table: ForceTable,
    *,
    candidates: Sequence[Shape] | None = None,
    threads: int | None = None,
    note: Callable[[str], None] = lambda text: None,
    **training: Any,
) -> RuleChoice:
    """Choose the number of rules by cross-validation and the one-standard-error rule.

    The smallest network whose error is within one standard error of the best one's (Breiman,
    Friedman, Olshen and Stone 1984, section 3.4.3). A candidate has no more rules in a direction
    than lines remain there when some are left out.

    Parameters
    ----------
    bearing : Bearing
        Gives the box, see `measured_map`.
    table : ForceTable
        The measured points, with standard errors where they are known.
    candidates : sequence of (int, int), optional
        Rules along current and displacement. Default: `CANDIDATES`, as far as the points allow.
    threads : int, optional
        Trainings side by side. Default: a thread for each processor. The result does not depend
        on it.
    note : callable
        Called with a text when a candidate is begun.
    **training
        Options of :func:`ambkit.train`; least squares takes `EPOCHS` steps by default.

    Raises
    ------
    AmbkitError
        Too few points for that, candidates that they do not allow, or an option of the training
        outside its limits.
    """
    if threads is not None and threads < 1:
        raise AmbkitError(f"threads must be 1 or more, is {threads}")
    if training.get("method", "least-squares") == "least-squares":
        training = {"epochs": EPOCHS} | training
    box = _box(bearing, table)
    folds = list(_folds(table, box))
    # Lines inside, and one for each end of the box: there, or beyond and bearing on it.
    kept = [
        2 + min(int(np.count_nonzero((nodes > ends[0]) & (nodes < ends[1]))) for nodes in remaining)
        for remaining, ends in zip(
            zip(*((rest.current, rest.displacement) for rest, _ in folds), strict=True),
            box,
            strict=True,
        )
    ]
    tried = []
    for shape in sorted(CANDIDATES if candidates is None else candidates, key=np.prod):
        allowed = 2 <= shape[0] <= kept[0] and 2 <= shape[1] <= kept[1]
        if allowed and shape[0] * shape[1] <= MAX_RULES:
            tried.append(shape)
        elif candidates is not None:
            raise AmbkitError(
                f"candidates: {shape[0]}x{shape[1]} rules cannot be judged; these points allow "
                f"2x2 to {kept[0]}x{kept[1]}, and no more than {MAX_RULES} in total"
            )
    done: list[Candidate] = []
    least, since = np.inf, 0
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for shape in tried:
            note(f"trying {shape[0]}x{shape[1]} rules")

            def squares(fold: Fold, shape: Shape = shape) -> float:
                return _mean_square(bearing, table, fold, shape, training)

            each = np.array(list(pool.map(squares, folds)))
            error = float(np.sqrt(each.mean()))
            spread = float(each.std(ddof=1) / np.sqrt(each.size))
            done.append(Candidate(shape, error, spread / (2 * error) if error > 0 else 0.0))
            since = 0 if error < least else since + 1
            least = min(least, error)
            if since == PATIENCE and candidates is None:
                break
    return RuleChoice(tuple(done), table.standard_error is not None, len(folds))


def measured_map(bearing: Bearing, table: ForceTable, shape: Shape = (5, 5)) -> StiffnessMap:
    """Return the stiffnesses of a measured force, where the table and the bearing's box overlap.

    Parameters
    ----------
    bearing : Bearing
        Its box: the currents that the amplifier gives, half the travel to either side.
    table : ForceTable
        The measured force.
    shape : tuple of 2 int
        Nodes along current and displacement, evenly spaced; the expert has a rule at each.

    Raises
    ------
    AmbkitError
        The table is beside the box, or fewer than two nodes a side are asked for.
    """
    (first, last), (left, right) = _box(bearing, table)
    return stiffness_map(
        bearing,
        currents=np.linspace(first, last, shape[0]),
        displacements=np.linspace(left, right, shape[1]),
        force=table,
    )


def _box(bearing: Bearing, table: ForceTable) -> tuple[Array, Array]:
    """Lowest and highest current [A] and displacement [m] of table and bearing together."""
    half = bearing.rotor.travel_limit / 2
    return (
        np.clip(table.current[[0, -1]], bearing.current_min, bearing.current_max),
        np.clip(table.displacement[[0, -1]], -half, half),
    )


def _within(nodes: Array, ends: Array) -> NDArray[np.bool_]:
    return np.asarray((nodes >= ends[0]) & (nodes <= ends[1]))


def _folds(table: ForceTable, box: tuple[Array, Array]) -> Iterator[Fold]:
    """Tables without some lines inside the box, each with a mask (nx, ni) of what is to be judged.

    Raises
    ------
    AmbkitError
        Fewer lines than can be left out.
    """
    grid = table.current, table.displacement
    lines = [
        np.flatnonzero((nodes > ends[0]) & (nodes < ends[1]))
        for nodes, ends in zip(grid, box, strict=True)
    ]
    if min(table.current.size, table.displacement.size) < 5 or min(map(len, lines)) < 2:
        raise AmbkitError(
            "too few points to choose the number of rules, for which lines of their grid are left "
            "out: 5 currents and 5 displacements or more are needed, 2 or more of each inside the "
            f"bearing's box; there are {table.current.size} currents, {lines[0].size} of them "
            f"inside, and {table.displacement.size} displacements, {lines[1].size} inside"
        )
    judged = np.outer(_within(table.displacement, box[1]), _within(table.current, box[0]))
    for axis, inner in ((1, lines[0]), (0, lines[1])):
        for k in range(min(FOLDS, inner.size)):
            out = inner[k::FOLDS]
            mask = np.zeros_like(judged)
            np.moveaxis(mask, axis, 0)[out] = True
            errors = table.standard_error
            rest = ForceTable(
                np.delete(table.current, out) if axis else table.current,
                table.displacement if axis else np.delete(table.displacement, out),
                np.delete(table.values, out, axis),
                None if errors is None else np.delete(errors, out, axis),
            )
            yield rest, mask & judged


def _mean_square(
    bearing: Bearing,
    table: ForceTable,
    fold: Fold,
    shape: Shape,
    training: dict[str, Any],
) -> float:
    """Train without a set of lines; mean square error on them, in the points' variances."""
    rest, left_out = fold
    expert = train(measured_map(bearing, rest, shape), **training)
    iu, x = np.meshgrid(table.current, table.displacement)
    off = expert.force(iu[left_out], x[left_out]) - table.values[left_out]
    if table.standard_error is not None:
        off = off / table.standard_error[left_out]
    return float(np.mean(off**2))
