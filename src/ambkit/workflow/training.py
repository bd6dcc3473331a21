"""An expert for k_i and k_s: what it is trained on where nobody says it, and what speaks for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ambkit.base.progress import shown_in_notebooks
from ambkit.base.units import engineering
from ambkit.fuzzy.cross_validation import (
    LAW,
    NETWORK,
    REFITTED,
    SURFACE,
    ModelChoice,
    choose_model,
    refitted,
)
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.rule_selection import RuleChoice, Shape, choose_rules, measured_map
from ambkit.fuzzy.training import train
from ambkit.fuzzy.training_set import rms
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.magnets import ConstantStiffness, evaluate_stiffness, magnet_of
from ambkit.machine.stiffness import StiffnessMap, stiffness_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ambkit.machine.forces.force_points import ForcePoints
    from ambkit.machine.machine import Bearing
    from ambkit.machine.magnets import MagnetModel

RULES: Shape = (5, 5)
"""Rules along current and displacement where nobody says it: the paper's."""

CLEAR = 0.2
"""The law's k_i or k_s is clearly positive from this part of its largest on."""

POOR = 0.1
"""A rule is hardly measured where the force is known no better than this part of its RMS."""


def how_to_train(
    method: str = "least-squares",
    weights: bool | None = None,
    *,
    normalised: bool = True,
    scaling: str = "grid",
) -> dict[str, Any]:
    """Return the options of :func:`ambkit.train`, with what is not said."""
    return {
        "method": method,
        "weights": method == "least-squares" if weights is None else weights,
        "normalised": normalised,
        "scaling": scaling,
    }


def stiffness_of_law(
    bearing: Bearing, shape: Shape = RULES, max_displacement: float | None = None
) -> StiffnessMap:
    """Return the stiffnesses of a bearing's law, over all currents."""
    travel = bearing.rotor.clearance
    far = travel / 2 if max_displacement is None else max_displacement
    if not 0 < far <= travel:
        limit = engineering(travel, "m")
        raise ValueError(
            f"reach must be above 0 m and at most the travel, {limit}, is {engineering(far, 'm')}"
        )
    return stiffness_map(
        bearing,
        currents=np.linspace(bearing.current_min, bearing.current_max, shape[0]),
        displacements=np.linspace(-far, far, shape[1]),
    )


def check_within_gap(bearing: Bearing, points: ForcePoints) -> None:
    """Refuse points at which no rotor can be."""
    gap, farthest = bearing.magnet.air_gap, max(points.displacement.tolist(), key=abs)
    if abs(farthest) >= gap:
        raise ValueError(
            f"x must stay within the air gap, {engineering(gap, 'm')}, reaches "
            f"{engineering(farthest, 'm')}: is a unit, scale or offset wrong?"
        )


@dataclass(frozen=True, eq=False)
class MeasuredForce:
    """A measured force, the surface through it, and the rules that it carries."""

    surface: ForceSurface  #: The force, with its errors.
    stiffness: StiffnessMap  #: What an expert is trained on, a node for each rule.
    #: What cross-validation says of the number of rules, if it was asked.
    choice: RuleChoice | None
    law_error_given: bool  #: Whether the law's error was given, not found.


@shown_in_notebooks("finding the force", by="note")
def measured_force(
    bearing: Bearing,
    points: ForcePoints,
    shape: Shape | None = RULES,
    *,
    law_error: float | None = None,
    note: Callable[[str], None] = lambda _text: None,
    **options: Any,
) -> MeasuredForce:
    """Find the force from points of it, and where an expert needs its stiffnesses."""
    check_within_gap(bearing, points)
    surface = ForceSurface(bearing, points, law_error)
    choice = None
    if shape is None:
        choice = choose_rules(
            bearing, points, law_error=law_error, note=note, **how_to_train(**options)
        )
        shape = choice.chosen.shape
        note("training")
    stiffness = measured_map(bearing, surface, shape)
    return MeasuredForce(surface, stiffness, choice, law_error is not None)


@dataclass(frozen=True)
class WrongSign:
    """Where a trained stiffness is not positive though the bearing's law is clearly so."""

    share: float  #: Of the box.
    current: float  #: The worst place [A], [m].
    displacement: float
    least: float  #: The trained stiffness there, and the law's [N/A] or [N/m].
    law: float


def wrong_signs(expert: Expert, bearing: Bearing) -> dict[str, WrongSign]:
    """Return where a trained k_i or k_s is not positive though the bearing's law is clearly so."""
    # Towards the ends of a one-sided magnet's box the law's own k_i and k_s, which share the force
    # between them, go through zero; there a sign tells nothing.
    box = _box(expert)
    results = {}
    known = evaluate_stiffness(magnet_of(bearing), *box)
    for name, values, law in zip(("k_i", "k_s"), expert.stiffness(*box), known, strict=True):
        wrong = (values <= 0) & (law > CLEAR * law.max())
        if wrong.any():
            worst = np.unravel_index(np.argmin(np.where(wrong, values, np.inf)), values.shape)
            at = [float(item[worst]) for item in (*box, values, law)]
            results[name] = WrongSign(float(wrong.mean()), *at)
    return results


def _box(expert: Expert) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    iu, x = np.meshgrid(
        np.linspace(*expert.current_range, 41), np.linspace(*expert.displacement_range, 41)
    )
    return iu, x


@dataclass(frozen=True, eq=False)
class TrainedExpert:
    """An expert, and how good it is."""

    bearing: Bearing  #: Whose force it knows.
    expert: Expert  #: What was trained.
    stiffness: StiffnessMap  #: What it was trained on.
    measured: MeasuredForce | None = None  #: None where it was trained on the bearing's law.
    #: What points left out say of law, surface and network; None where there were too few.
    models: ModelChoice | None = None
    asked: str | None = None  #: What is taken whatever the points say.

    @property
    def taken(self) -> str:
        """What is to be believed: what was asked for, else what points left out prefer."""
        # ``"the law"``, ``"the law, refitted"``, ``"the surface"`` or ``"the network"``; without
        # points, or with too few to leave some out, the network.
        models = self.models
        if self.asked == "law":
            if models is None:
                return LAW if self.measured is None else REFITTED
            return LAW if models[LAW].worse <= models[REFITTED].worse else REFITTED
        if self.asked is not None:
            return f"the {self.asked}"
        return NETWORK if models is None else models.chosen.name

    @property
    def model(self) -> tuple[Bearing, MagnetModel]:
        """The bearing and the magnet that a filter then assumes: of a law that is refitted both."""
        if self.taken == NETWORK or self.measured is None:
            return self.bearing, self.expert if self.taken == NETWORK else magnet_of(self.bearing)
        if self.taken == SURFACE:
            return self.bearing, self.measured.surface
        law = self.bearing
        if self.taken == REFITTED:
            law = refitted(law, self.measured.surface.points)
        return law, magnet_of(law)

    @cached_property
    def error(self) -> dict[str, float]:
        """RMS errors of the force [N]: of constant stiffnesses, and untrained and trained."""
        constant, expert = ConstantStiffness.of(self.bearing), self.expert
        untrained = Expert.from_map(
            self.stiffness,
            normalised=expert.normalised,
            scaling=(expert.per_ampere, expert.per_metre),
        )
        models = {
            "constant": lambda iu, x: (
                constant.k_i * iu + constant.k_s * x + self.stiffness.force_bias
            ),
            "untrained": untrained.force,
            "trained": expert.force,
        }
        return {name: self.stiffness.force_rms(model) for name, model in models.items()}

    @cached_property
    def wrong_signs(self) -> dict[str, WrongSign]:
        """See :func:`wrong_signs`."""
        return wrong_signs(self.expert, self.bearing)

    @property
    def hardly_measured(self) -> list[tuple[float, float, float]]:
        """The rules at which the points tell little [A], [m], and the force's error there [N]."""
        # There the expert stays near the bearing's law. Empty without points.
        if self.measured is None:
            return []
        iu, x = (
            item.ravel()
            for item in np.meshgrid(self.stiffness.current, self.stiffness.displacement)
        )
        standard_error = self.measured.surface.standard_error(iu, x)
        poor = standard_error > POOR * self.stiffness.force_rms()
        return list(zip(*(item[poor].tolist() for item in (iu, x, standard_error)), strict=True))

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as plain data, in SI."""
        expert, training = self.expert, self.expert.training
        assert training is not None  # it was just trained
        data: dict[str, Any] = {
            "source": expert.source,
            "rules": len(expert.rules),
            "method": training.method,
            "weights": training.weights,
            "normalised": expert.normalised,
            "steps": len(training.force_rms) - 1,
            "current_range": expert.current_range,
            "displacement_range": expert.displacement_range,
            "force_rms": self.stiffness.force_rms(),
            "force_error_rms": self.error,
        }
        if self.measured is not None:
            data["measured"] = self._at_points(self.measured.surface)
            if self.measured.choice is not None:
                data["choice"] = self.measured.choice.to_dict()
        if self.models is not None:
            data["models"] = {"chosen": self.models.chosen.name, "taken": self.taken} | {
                m.name: {"random": m.random, "blocks": m.blocks} for m in self.models.models
            }
        return data | {"wrong_sign": {name: vars(w) for name, w in self.wrong_signs.items()}}

    def _at_points(self, surface: ForceSurface) -> dict[str, Any]:
        """Return what the points say of the surface, the law and the expert."""
        expert, points = self.expert, surface.points
        inside = points.where(points.within(expert.current_range, expert.displacement_range))
        off = {
            name: force(inside.current, inside.displacement) - inside.force
            for name, force in (("law", magnet_of(self.bearing).force), ("trained", expert.force))
        }
        noise = surface.noise(inside)
        standard_error = surface.standard_error(*_box(expert))
        return {
            "points": len(points),
            "points_in_box": len(inside),
            "law_error": surface.law_error,
            "law_error_reach": surface.reach,
            "scatter": surface.scatter,
            "force_standard_error": {
                "rms": rms(standard_error),
                "largest": float(standard_error.max()),
            },
            "error_at_points": {name: rms(item) for name, item in off.items()},
            "error_at_points_in_standard_errors": {
                name: rms(item / noise) for name, item in off.items()
            },
            "hardly_measured": [(iu, x) for iu, x, _ in self.hardly_measured],
        }


@shown_in_notebooks("training the expert", by="note")
def train_expert(
    bearing: Bearing,
    shape: Shape = RULES,
    *,
    reach: float | None = None,
    measured: MeasuredForce | None = None,
    take: str = "best",
    note: Callable[[str], None] = lambda _text: None,
    **options: Any,
) -> TrainedExpert:
    """Train an expert on a bearing's law, or on a measured force, and say how good it is."""
    how = how_to_train(**options)
    model_name = None if take == "best" else take
    if measured is None:
        stiffness = stiffness_of_law(bearing, shape, reach)
        return TrainedExpert(bearing, train(stiffness, **how), stiffness, asked=model_name)
    stiffness = measured.stiffness
    expert = train(stiffness, **how)
    shape = (stiffness.current.size, stiffness.displacement.size)
    models = choose_model(bearing, measured.surface, shape, note, **how)
    return TrainedExpert(bearing, expert, stiffness, measured, models, model_name)
