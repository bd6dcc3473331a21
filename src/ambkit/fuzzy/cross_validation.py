"""Selection of a magnet model: force law, surface through measured points, or network.

Each model is fitted without some of the points and evaluated at these: single points for the
interpolation, and complete blocks for the extrapolation (Roberts et al. 2017).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambkit.base.units import engineering
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.rule_selection import FEWEST, FOLDS, Shape, blocks_of, box_of, briefly, map_of
from ambkit.fuzzy.training import train
from ambkit.machine.forces.fitted_law import fitted_law
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.laws import law_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import evaluate_stiffness, magnet_of
from ambkit.machine.stiffness import ForceFunction

LAW, REFITTED, SURFACE, NETWORK = "the law", "the law, refitted", "the surface", "the network"


@dataclass(frozen=True)
class LeftOut:
    """Error of a model at points left out."""

    name: str  #: Name of the model.
    #: RMS error for random fifths of the points, and for blocks of them [N].
    random: float
    blocks: float

    @property
    def worse(self) -> float:
        """The larger of the two [N]."""
        return max(self.random, self.blocks)


@dataclass(frozen=True)
class ModelChoice:
    """Errors of the models, and the selected one."""

    models: tuple[LeftOut, ...]  #: From simple to complicated.

    @property
    def chosen(self) -> LeftOut:
        """The one with the least larger error; the simpler one of two within 5 %."""
        limit = 1.05 * min(model.worse for model in self.models)
        return next(model for model in self.models if model.worse <= limit)

    def __getitem__(self, name: str) -> LeftOut:
        return next(model for model in self.models if model.name == name)

    def against(self, chosen_name: str) -> str:
        """Return a sentence against a model, unless it is the selected one."""
        best, network, law = self.chosen, self[NETWORK], self[LAW]
        worst = [
            engineering(model.worse, "N", 3) for model in (network, law, best, self[chosen_name])
        ]
        if network.worse > law.worse:
            return (
                f"at points left out of the training the force error is {worst[0]} rms with the "
                f"expert, {worst[1]} with its initial law, {worst[2]} with {best.name}: do not use "
                "the expert"
            )
        if chosen_name != best.name:
            return (
                f"at points left out of the training {best.name} has a force error of {worst[2]} "
                f"rms, the requested model ({chosen_name}) {worst[3]}"
            )
        return ""


def choose_model(
    machine: Machine,
    surface: ForceSurface,
    shape: Shape = (5, 5),
    note: Callable[[str], None] = lambda text: None,
    **training: Any,
) -> ModelChoice | None:
    """Select the model of a magnet by cross-validation."""
    box = box_of(machine, surface.points)
    points = surface.points.where(surface.points.within(*box))
    _, by_blocks = blocks_of(points, box)
    if len(points) < FEWEST or np.unique(by_blocks).size < FOLDS:
        return None
    training = briefly(training)
    by_chance = np.random.default_rng(0).permutation(len(points)) % FOLDS
    errors: dict[str, list[float]] = {}
    for text, fold in (("points", by_chance), ("blocks of points", by_blocks)):
        squares: dict[str, float] = {}
        for k in range(FOLDS):
            note(f"leaving out {text}, {k + 1} of {FOLDS}")
            left_out = points.where(fold == k)
            for name, force in _models(machine, surface, points.where(fold != k), box, shape,
                                       training):  # fmt: skip
                at = left_out.current, left_out.displacement
                off = np.asarray(force(*at), dtype=float) - left_out.force
                squares[name] = squares.get(name, 0.0) + float(np.sum(off**2))
        for name, total in squares.items():
            errors.setdefault(name, []).append(float(np.sqrt(total / len(points))))
    return ModelChoice(tuple(LeftOut(name, *both) for name, both in errors.items()))


def _models(
    machine: Machine, surface: ForceSurface, known: ForcePoints, box: Any, shape: Shape,
    training: dict[str, Any],
) -> list[tuple[str, ForceFunction]]:  # fmt: skip
    """Return the models fitted to some points."""
    through = ForceSurface(machine, known, like=surface)
    network = train(map_of(machine, through, box, shape), **training)
    return [
        (LAW, law_of(machine).force),
        (REFITTED, fitted_law(machine, known)[2]),
        (SURFACE, through),
        (NETWORK, network.force),
    ]


CLEAR = 0.2  #: Share of its maximum from which the law's k_i or k_s is clearly positive.


@dataclass(frozen=True)
class WrongSign:
    """Region in which a trained stiffness is not positive though the force law's clearly is."""

    share: float  #: Share of the range.
    current: float  #: The worst place [A], [m].
    displacement: float
    least: float  #: Minimum of the trained stiffness, and the law's there [N/A] or [N/m].
    law: float


def wrong_signs(expert: Expert, machine: Machine) -> dict[str, WrongSign]:
    """Return where a trained k_i or k_s is not positive though the force law's clearly is."""
    # Near the ends of a one-sided magnet's range the law's own k_i and k_s, which share the force,
    # cross zero; signs are not significant there.
    box = range_grid(expert)
    results = {}
    known = evaluate_stiffness(magnet_of(machine), *box)
    for name, values, law in zip(("k_i", "k_s"), expert.stiffness(*box), known, strict=True):
        wrong = (values <= 0) & (law > CLEAR * law.max())
        if wrong.any():
            worst = np.unravel_index(np.argmin(np.where(wrong, values, np.inf)), values.shape)
            at = [float(item[worst]) for item in (*box, values, law)]
            results[name] = WrongSign(float(wrong.mean()), *at)
    return results


def range_grid(expert: Expert) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return currents [A] and displacements [m] over the range of an expert, (41, 41) each."""
    iu, x = np.meshgrid(
        np.linspace(*expert.current_range, 41), np.linspace(*expert.displacement_range, 41)
    )
    return iu, x
