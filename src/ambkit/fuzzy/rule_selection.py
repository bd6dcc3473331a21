"""Number of rules for measured points: the smallest sufficient network by cross-validation.

Complete blocks of the box are left out, not single points: errors that neighbouring points share
would otherwise be hidden, and more rules would seem better than they are (Roberts et al. 2017).
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit._core import MAX_RULES
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.fuzzy.training import train
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import ForceFunction, StiffnessMap, stiffness_map
from ambkit.result.report import Axis, Figure, Heatmap, Item, Note, Panel, Points, Rule

Shape = tuple[int, int]  #: Rules along the current, and along the displacement.
Box = tuple[tuple[float, float], tuple[float, float]]
"""Lowest and highest current [A], and displacement [m]."""

CANDIDATES: tuple[Shape, ...] = (
    (2, 2), (3, 3), (4, 3), (3, 4), (4, 4), (5, 3), (3, 5), (5, 5), (7, 5), (5, 7), (7, 7),
)  # fmt: skip
"""Candidate grids of rules, as far as the points allow."""

BLOCKS = 6  #: Blocks per side of the range.

FOLDS = 5
"""Number of folds. A block of column i and row j is in fold i + 2 j: no two of a fold touch."""

FEWEST = 20  #: Minimum number of points for cross-validation: about four per fold.

PATIENCE = 3
"""Number of larger networks without improvement that ends the search: they cost the most."""

EPOCHS = 30
"""Steps of least squares in each training: further ones change less than the standard errors, at
five times the cost.
"""


@dataclass(frozen=True)
class Candidate:
    """A grid of rules, and its cross-validation error."""

    shape: Shape  #: Rules along the current, and along the displacement.
    #: RMS error at the points left out, over the expected standard deviation of the point and the
    #: prediction from the others. The optimum is 1.
    error: float
    standard_error: float  #: Standard error of `error`, from its scatter over the blocks.

    @property
    def rules(self) -> int:
        """Number of rules."""
        return self.shape[0] * self.shape[1]

    @property
    def name(self) -> str:
        """Name for ``--rules``: ``"5x3"``."""
        return f"{self.shape[0]}x{self.shape[1]}"


@dataclass(frozen=True)
class RuleChoice:
    """Cross-validation of the number of rules."""

    candidates: tuple[Candidate, ...]  #: Candidates, from few rules to many.
    #: The same error of the force that the networks were trained on, a bound for any number of
    #: rules.
    surface_error: float
    folds: int  #: Number of folds.

    @property
    def best(self) -> Candidate:
        """The candidate with the least error."""
        return min(self.candidates, key=lambda c: c.error)

    @property
    def limit(self) -> float:
        """Error up to which a candidate is as good as the best: one standard error above it."""
        return self.best.error + self.best.standard_error

    @property
    def chosen(self) -> Candidate:
        """The smallest network within the limit (Breiman et al. 1984, 3.4.3), of two the better."""
        enough = [c for c in self.candidates if c.error <= self.limit]
        return min(enough, key=lambda c: (c.rules, c.error))

    @property
    def sentence(self) -> str:
        """Selected rules, with the reason."""
        name, best, limit = self.chosen.name, self.best.name, f"{self.limit:.3g}"
        why = (
            f"the best; no smaller one is within a standard error ({limit})"
            if name == best
            else f"the smallest within a standard error of {best} ({limit})"
        )
        return f"Chosen: {name}, {why}; any number of rules has {self.surface_error:.3g}."

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data."""
        return {
            "chosen": self.chosen.name,
            "best": self.best.name,
            "limit": self.limit,
            "surface_error": self.surface_error,
            "folds": self.folds,
        }


def choose_rules(
    machine: Machine,
    points: ForcePoints,
    *,
    candidates: Sequence[Shape] | None = None,
    law_error: float | None = None,
    threads: int | None = None,
    note: Callable[[str], None] = lambda text: None,
    **training: Any,
) -> RuleChoice:
    """Select the number of rules by cross-validation and the one-standard-error rule."""
    if threads is not None and threads < 1:
        raise AmbkitError(f"threads must be 1 or more, is {threads}")
    training = briefly(training)
    box = box_of(machine, points)
    inside = points.within(*box)
    block, fold = blocks_of(points, box)
    fold = np.where(inside, fold, -1)
    folds = [fold == k for k in range(FOLDS) if np.any(fold == k)]
    count = int(np.count_nonzero(inside))
    if count < FEWEST or len(folds) < FOLDS:
        raise AmbkitError(
            "too few points to choose the number of rules, for which some are left out: "
            f"{FEWEST} or more are needed all over the bearing's box; there are {count} in "
            f"{np.unique(block[inside]).size} of its {BLOCKS * BLOCKS} blocks"
        )
    remain = min(min(count - int(np.count_nonzero(out)) for out in folds), MAX_RULES)
    shapes = _allowed(candidates, remain)
    note("finding the force without some points")
    surfaces = [ForceSurface(machine, points.where(~out), law_error) for out in folds]
    spreads = [_spread(s, points.where(out)) for s, out in zip(surfaces, folds, strict=True)]
    results: list[Candidate] = []
    least, since = np.inf, 0
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:

        def evaluate(force: Callable[[int], ForceFunction]) -> tuple[float, float]:
            """Return error and standard error of the force, each fold predicted by the others."""

            def squares(k: int) -> Array:
                left = points.where(folds[k])
                off = np.asarray(force(k)(left.current, left.displacement)) - left.force
                return np.asarray((off / spreads[k]) ** 2)

            parts = np.concatenate(list(pool.map(squares, range(FOLDS))))
            return _error(parts, np.concatenate([block[left_out] for left_out in folds]))

        for shape in shapes:
            note(f"trying {shape[0]}x{shape[1]} rules")

            def trained(k: int, shape: Shape = shape) -> ForceFunction:
                return train(map_of(machine, surfaces[k], box, shape), **training).force

            results.append(Candidate(shape, *evaluate(trained)))
            since = 0 if results[-1].error < least else since + 1
            least = min(least, results[-1].error)
            if since == PATIENCE and candidates is None:
                break
        limit, _ = evaluate(lambda k: surfaces[k])
    return RuleChoice(tuple(results), limit, len(folds))


def _allowed(candidates: Sequence[Shape] | None, remain: int) -> list[Shape]:
    """Return the grids permitted by a number of points, from few rules to many."""
    shapes = []
    for shape in sorted(CANDIDATES if candidates is None else candidates, key=np.prod):
        if min(shape) >= 2 and shape[0] * shape[1] <= remain:
            shapes.append(shape)
        elif candidates is not None:
            raise AmbkitError(
                f"candidates: {shape[0]}x{shape[1]} rules cannot be judged; these points allow 2 "
                f"or more in each direction, and {remain} or less in total"
            )
    return shapes


def measured_map(
    machine: Machine, points: ForcePoints | ForceSurface, shape: Shape = (5, 5)
) -> StiffnessMap:
    """Return the stiffnesses of a measured force, in the range of rotor and points."""
    surface = ForceSurface(machine, points) if isinstance(points, ForcePoints) else points
    return map_of(machine, surface, box_of(machine, surface.points), shape)


def map_of(machine: Machine, surface: ForceSurface, box: Box, shape: Shape) -> StiffnessMap:
    """Return the stiffnesses of a surface over a range, with so many nodes per side."""
    return stiffness_map(
        machine,
        currents=np.linspace(*box[0], shape[0]),
        displacements=np.linspace(*box[1], shape[1]),
        force=surface,
    )


def box_of(machine: Machine, points: ForcePoints) -> Box:
    """Return the common range of points and machine: current [A] and displacement [m]."""
    travel = machine.clearance
    box = []
    for name, values, low, high, unit in (
        ("current", points.current, machine.current_min, machine.current_max, "A"),
        ("displacement", points.displacement, -travel, travel, "m"),
    ):
        first, last = np.clip([values.min(), values.max()], low, high).tolist()
        if not first < last:
            raise AmbkitError(
                f"the points have {name}s of {values.min():g} to {values.max():g} {unit};  "
                f"they must overlap with the bearing's range, {low:g} to {high:g} {unit}"
            )
        box.append((first, last))
    return box[0], box[1]


def _spread(surface: ForceSurface, left_out: ForcePoints) -> Array:
    """Standard deviation of points about a surface that excludes them (n,) [N]."""
    of_surface = surface.standard_error(left_out.current, left_out.displacement)
    return np.asarray(np.hypot(surface.noise(left_out), of_surface))


def briefly(training: dict[str, Any]) -> dict[str, Any]:
    """Return training options with fewer steps of least squares, unless they are stated."""
    default = training.get("method", "least-squares") == "least-squares"
    return {"epochs": EPOCHS} | training if default else training


def blocks_of(points: ForcePoints, box: Box) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the block of each point, row by row, and its fold."""
    (first, last), (left, right) = box
    # Lines of a grid must be inside blocks, not on their borders.
    column = np.round((points.current - first) / (last - first) * (BLOCKS - 1))
    row = np.round((points.displacement - left) / (right - left) * (BLOCKS - 1))
    i, j = (np.clip(line, 0, BLOCKS - 1).astype(np.int64) for line in (column, row))
    return BLOCKS * j + i, (i + 2 * j) % FOLDS


def _error(squares: Array, block: NDArray[np.int64]) -> tuple[float, float]:
    """Return the root mean square, and its standard error by the scatter of blocks."""
    # A ratio of sums over blocks, because the numbers of points differ (Cochran 1977, section 6.3).
    _, place = np.unique(block, return_inverse=True)
    size, total = np.bincount(place), np.bincount(place, squares)
    mean, many = float(squares.mean()), size.size
    variance = many / (many - 1) * np.sum((total - mean * size) ** 2) / squares.size**2
    error = float(np.sqrt(mean))
    return error, float(np.sqrt(variance)) / (2 * error) if error > 0 else 0.0


MOST_SHOWN = 400  #: Maximum number of points shown: more would hide the surface.
FEW = 60  #: Number of points up to which they are large.
NEARBY = 7  #: Number of neighbours, of 61 places per axis, over which the maximum error is shown.


def with_surface(figure: Figure, surface: ForceSurface, stiff: StiffnessMap) -> Figure:
    """Add a measured force before the figure of a training."""
    from scipy.ndimage import maximum_filter

    iu = np.linspace(stiff.current[0], stiff.current[-1], 61)
    x = np.linspace(stiff.displacement[0], stiff.displacement[-1], 61)
    grid = np.meshgrid(iu, x)
    axes = Axis("control current $i_u$", "A"), Axis("displacement $x$", "mm", 1e3)
    points = surface.points.where(
        surface.points.within((iu[0], iu[-1]), (x[0], x[-1]))  # the figure shows the range
    )
    step = -(-len(points) // MOST_SHOWN)
    look = "measurement" if len(points) <= FEW else "place"
    marks = Points(points.current[::step], points.displacement[::step], signal=look)
    moved = Heatmap(iu, x, surface.correction(*grid), Axis("force", "N"), diverging=True)
    # The error oscillates between the rows of a grid; shown is its envelope.
    worst = maximum_filter(surface.standard_error(*grid), NEARBY, mode="nearest")
    known = Heatmap(iu, x, worst, Axis("standard error", "N"), lines=4)
    panels = [
        Panel(*axes, [moved, marks], title="measured force minus the bearing's law"),
        Panel(*axes, [known, marks], title="standard error of the force"),
    ]
    return replace(figure, panels=[*panels, *figure.panels])


def with_choice(figure: Figure, choice: RuleChoice) -> Figure:
    """Add the selection of the number of rules before the figure of a training."""
    caption = (
        "Error at points that the network was not trained on, with its standard error; 1 is as "
        f"good as can be. The smallest network below the line is taken, {choice.chosen.name}. "
        f"{figure.caption}"
    )
    chosen = choice.chosen
    groups = {"constant": [c for c in choice.candidates if c is not chosen], "estimate": [chosen]}
    items: list[Item | Note] = [
        Points(*np.array([(c.rules, c.error, c.standard_error) for c in some]).T, signal=signal,
               label="")
        for signal, some in groups.items() if some
    ]  # fmt: skip
    items.append(Rule(choice.limit, signal="limit", label=""))
    items.append(Note(chosen.rules, chosen.error + chosen.standard_error, chosen.name))
    panel = Panel(
        Axis("number of rules"), Axis("error", "standard deviations"), items,
        title="points left out of the training",
    )  # fmt: skip
    return replace(figure, panels=[panel, *figure.panels], caption=caption)
