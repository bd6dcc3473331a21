"""A trained expert, its accuracy, and its filter."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ambkit.base.arrays import rms
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering, percent
from ambkit.estimate.filter_saving import made_by
from ambkit.estimate.kalman import AdaptiveKalmanFilter
from ambkit.fuzzy.cross_validation import (
    LAW,
    NETWORK,
    REFITTED,
    SURFACE,
    ModelChoice,
    WrongSign,
    range_grid,
    wrong_signs,
)
from ambkit.fuzzy.expert import Expert
from ambkit.fuzzy.expert_card import training_figure
from ambkit.fuzzy.rule_selection import RuleChoice, with_choice, with_surface
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.machine.forces.fitted_law import refitted
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.force_surface import ForceSurface
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, MagnetModel, magnet_of
from ambkit.machine.stiffness import StiffnessMap
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

FORMS = {
    NETWORK: (".json",), SURFACE: (".csv", ".parquet"), LAW: (".toml",), REFITTED: (".toml",),
}  # fmt: skip
"""What each model is written as: the expert, the points that its surface goes through, a law."""

POOR = 0.1
"""A rule is hardly measured where the force is known no better than this part of its RMS."""


@dataclass(frozen=True, eq=False)
class MeasuredForce:
    """A measured force, its surface, and the rules that it determines."""

    surface: ForceSurface  #: The force with its standard errors.
    stiffness: StiffnessMap  #: Training map, one node per rule.
    #: Cross-validation of the number of rules, if it was run.
    choice: RuleChoice | None
    law_error_known: bool  #: Whether the error of the force law was stated rather than estimated.


@dataclass(frozen=True, eq=False, repr=False)
class TrainedExpert(Result):
    """An expert and its accuracy."""

    machine: Machine | None  #: Machine with this force; None if only stiffnesses are known.
    expert: Expert  #: The expert.
    stiffness: StiffnessMap  #: Training data.
    measured: MeasuredForce | None = None  #: None if it was trained on the force law.
    #: Cross-validation of law, surface and network; None with too few points.
    models: ModelChoice | None = None
    requested: str | None = None  #: Model requested by the user.
    source: str | os.PathLike[str] | None = None  #: File or preset of the machine.

    @property
    def taken(self) -> str:
        """The model to use: the requested one, or the best in cross-validation."""
        # ``"the law"``, ``"the law, refitted"``, ``"the surface"`` or ``"the network"``; the
        # network without points, or with too few for cross-validation.
        models = self.models
        if self.requested == "law":
            if models is None:
                return LAW if self.measured is None else REFITTED
            return LAW if models[LAW].worse <= models[REFITTED].worse else REFITTED
        if self.requested is not None:
            return f"the {self.requested}"
        return NETWORK if models is None else models.chosen.name

    @property
    def model(self) -> tuple[Machine, MagnetModel]:
        """Machine and magnet of the filter: a refitted law changes both."""
        assert self.machine is not None  # callers that need a machine check it
        law = self.machine
        surface = None if self.measured is None else self.measured.surface
        if self.taken == NETWORK:
            return law, self.expert
        if surface is not None and self.taken == SURFACE:
            return law, surface
        if surface is not None and self.taken == REFITTED:
            law = refitted(law, surface.points)
        return law, magnet_of(law)

    @cached_property
    def error(self) -> dict[str, float]:
        """RMS errors of the force [N]: constant stiffnesses, untrained and trained expert."""
        expert = self.expert
        if self.machine is None:
            k_i, k_s = (float(value) for value in self.stiffness.stiffness_at(0.0, 0.0))
        else:
            constant = ConstantStiffness.of(self.machine)
            k_i, k_s = constant.k_i, constant.k_s
        untrained = Expert.from_map(
            self.stiffness,
            normalised=expert.normalised,
            scaling=(expert.per_ampere, expert.per_metre),
        )
        models = {
            "constant": lambda iu, x: k_i * iu + k_s * x + self.stiffness.force_bias,
            "untrained": untrained.force,
            "trained": expert.force,
        }
        return {name: self.stiffness.force_rms(model) for name, model in models.items()}

    @cached_property
    def wrong_signs(self) -> dict[str, WrongSign]:
        """See :func:`wrong_signs`."""
        return {} if self.machine is None else wrong_signs(self.expert, self.machine)

    @property
    def sparse_nodes(self) -> list[tuple[float, float, float]]:
        """Rules that the points hardly determine [A], [m], and the force's error there [N]."""
        # There the expert stays close to the force law. Empty without points.
        if self.measured is None:
            return []
        iu, x = (
            item.ravel()
            for item in np.meshgrid(self.stiffness.current, self.stiffness.displacement)
        )
        standard_error = self.measured.surface.standard_error(iu, x)
        poor = standard_error > POOR * self.stiffness.force_rms()
        return list(zip(*(item[poor].tolist() for item in (iu, x, standard_error)), strict=True))

    @property
    def filter(self) -> AdaptiveKalmanFilter:
        """The filter with the model to use."""
        if self.machine is None:
            raise AmbkitError("a filter needs a machine, and the expert was trained on stiffnesses")
        law, magnet = self.model
        made = AdaptiveKalmanFilter(law, magnet)
        part = "machine.file" if self.taken in (LAW, REFITTED) else "magnet.file"
        made.origin = {part: made_by("train", self.expert.source)}
        return made

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether the filter is adequate."""
        return [] if self.machine is None else judge_adequacy(self.filter)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the expert as ``.json``; points, machine and figures by their suffix."""
        if Path(path).suffix.lower() == ".json":
            self.expert.save(path)
        else:
            super().save(path)

    def file(self) -> ForcePoints | None:
        return None if self.measured is None else self.measured.surface.points

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        if self.measured is None or self.machine is None:
            super().save_toml(path)
            return
        points = self.measured.surface.points
        law = self.model[0] if self.taken == LAW else refitted(self.machine, points)
        law.save(path)

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the filter, which refers to the files beside it."""
        written = next((beside[end] for end in FORMS[self.taken] if end in beside), None)
        if self.taken in (LAW, REFITTED):
            machine = written or (self.source if self.taken == LAW else None)
            self.filter.save(path, machine=machine)
        else:
            self.filter.save(path, machine=self.source, magnet=written)

    @property
    def title(self) -> str:
        training = self.expert.training
        assert training is not None  # it was just trained
        what = "widths and weights" if training.weights else "widths"
        return (
            f"{self.expert.source}: {len(self.expert.rules)} rules, {what} by {training.method}, "
            f"{len(training.force_rms) - 1} steps"
        )

    @property
    def finding(self) -> str:
        trained, constant = (engineering(self.error[n], "N", 4) for n in ("trained", "constant"))
        return (
            f"{self.title}; error of the force {trained} rms, with constant stiffnesses {constant}."
        )

    @property
    def rows(self) -> list[Row]:
        errors = ("error with constant stiffnesses", "error of the untrained expert",
                  "error of the trained expert")  # fmt: skip
        result = [
            Row("box", "range", ", ".join(
                f"{engineering(low, unit, 4)} to {engineering(high, unit, 4)}"
                for (low, high), unit in ((self.expert.current_range, "A"),
                                          (self.expert.displacement_range, "m")))),
            Row("force_rms", "force relative to the origin, rms",
                self.stiffness.force_rms(), "N"),
            *(Row(name, f"{text}, rms", self.error[name], "N", section=("force_error_rms",))
              for text, name in zip(errors, ("constant", "untrained", "trained"), strict=True)),
        ]  # fmt: skip
        if self.measured is None:
            return result
        if self.measured.choice is not None:
            for candidate in self.measured.choice.candidates:
                result += put([
                    Row("rules", "rules", candidate.rules),
                    Row("error", "error", candidate.error, digits=3),
                    Row("standard_error", "std. error", candidate.standard_error, digits=2),
                ], section=("rules_left_out",), of=candidate.name)  # fmt: skip
        result += put(self._rows_at_points(), section=("measured",))
        for model in () if self.models is None else self.models.models:
            result += put([
                Row("random", "points", model.random, "N", 3),
                Row("blocks", "blocks", model.blocks, "N", 3),
                Row("mark", "", "taken" if model.name == self.taken else ""),
            ], section=("models",), of=model.name)  # fmt: skip
        return result

    def _rows_at_points(self) -> list[Row]:
        assert self.measured is not None
        surface = self.measured.surface
        data = self._at_points(surface)
        reach = " and ".join(engineering(r, u, 2) for r, u in zip(surface.reach, "Am", strict=True))
        off, errors = data["error_at_points"], data["error_at_points_in_standard_errors"]
        source = "given" if self.measured.law_error_known else "estimated"
        return [
            Row("points_in_box", "points in the range of the expert", data["points_in_box"]),
            Row("scatter", "scatter, rms", surface.scatter, "N", 3),
            Row("law_error", f"error of the law, {source}, correlated within {reach}",
                surface.law_error, "N", 3),
            *(Row(f"force_standard_error.{key}", f"standard error of the force, {text}",
                  data["force_standard_error"][key], "N", 3)
              for key, text in (("rms", "rms"), ("largest", "at most"))),
            *(Row(f"error_at_points.{key}", f"deviation from points, {text}, rms", off[key], "N", 3)
              for key, text in (("law", "the law"), ("trained", "the trained expert"))),
            *(Row(f"error_at_points_in_standard_errors.{key}", "  in standard errors",
                  errors[key], digits=3) for key in ("law", "trained")),
        ]  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        points = 0 if self.measured is None else len(self.measured.surface.points)
        return {
            (): Section(self.title),
            ("force_error_rms",): Section("Errors of the force"),
            ("rules_left_out",): Section(
                "Error at points left out of the training; 1 is as good as can be", across=True
            ),
            ("measured",): Section(f"{points} points"),
            ("models",): Section(
                "Error at points left out, rms: here and there, and whole blocks of them",
                across=True,
            ),
        }

    @property
    def notes(self) -> list[str]:
        measured, results = self.measured, [
            _of_wrong_sign(name, wrong, self.measured is not None)
            for name, wrong in self.wrong_signs.items()
        ]  # fmt: skip
        if measured is not None:
            results += self._of_hardly_measured()
            if self.error["trained"] > self.error["untrained"]:
                results.append("the trained expert's error is larger than the untrained one's")
            if measured.choice is not None:
                results.append(measured.choice.sentence)
        if self.models is not None and (warning := self.models.against(self.taken)):
            results.append(warning)
        if measured is not None and self.taken != NETWORK:
            form = FORMS[self.taken][0]
            results.append(
                f"{self.taken} is better at points left out and is used: --out FILE{form} "
                f"writes it, --model network uses the network nevertheless"
                if self.requested is None
                else f"the filter uses {self.taken}: --out FILE{form} writes it"
            )
        return [*results, *sentences(self.adequacy)]

    def _of_hardly_measured(self) -> list[str]:
        """List the rules that the points hardly determine, and what is used there."""
        poor = self.sparse_nodes
        if not poor:
            return []
        nodes = [f"{engineering(iu, 'A', digits=3)} at {engineering(x, 'm', digits=3)}"
                 for iu, x, _ in poor]  # fmt: skip
        more = f" and {len(nodes) - 6} more" if len(nodes) > 6 else ""
        worst = engineering(max(error for *_, error in poor), "N", digits=2)
        return [
            f"few points near {len(nodes)} of {self.stiffness.k_i.size} rules: there the expert "
            f"stays near the machine's law, its force known to {worst} or better: "
            f"{', '.join(nodes[:6])}{more}"
        ]

    def figures(self) -> list[Figure]:
        result, measured = training_figure(self.expert, self.stiffness), self.measured
        if measured is not None:
            result = with_surface(result, measured.surface, self.stiffness)
            if measured.choice is not None:
                result = with_choice(result, measured.choice)
        return [result]

    @property
    def series(self) -> dict[str, Any]:
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
        }
        if self.measured is not None:
            surface = self.measured.surface
            data["measured"] = {
                "points": len(surface.points),
                "law_error_reach": surface.reach,
                "sparse_nodes": [(iu, x) for iu, x, _ in self.sparse_nodes],
            }
            if self.measured.choice is not None:
                data["choice"] = self.measured.choice.to_dict()
        if self.models is not None:
            data["models"] = {"chosen": self.models.chosen.name, "taken": self.taken}
        return data | {"wrong_sign": {name: vars(w) for name, w in self.wrong_signs.items()}}

    def _at_points(self, surface: ForceSurface) -> dict[str, Any]:
        """Return the errors of surface, law and expert at the points."""
        assert self.machine is not None  # there are points
        expert, points = self.expert, surface.points
        inside = points.where(points.within(expert.current_range, expert.displacement_range))
        off = {
            name: force(inside.current, inside.displacement) - inside.force
            for name, force in (("law", magnet_of(self.machine).force), ("trained", expert.force))
        }
        noise = surface.noise(inside)
        standard_error = surface.standard_error(*range_grid(expert))
        return {
            "points_in_box": len(inside),
            "force_standard_error": {
                "rms": rms(standard_error),
                "largest": float(standard_error.max()),
            },
            "error_at_points": {name: rms(item) for name, item in off.items()},
            "error_at_points_in_standard_errors": {
                name: rms(item / noise) for name, item in off.items()
            },
        }


def _of_wrong_sign(name: str, wrong: WrongSign, measured: bool) -> str:
    unit = "N/A" if name == "k_i" else "N/m"
    hint = "more points there, a smaller --law-error" if measured else "other --rules or --method"
    return (
        f"the trained {name} is not positive in {percent(wrong.share)} of the box, down to "
        f"{engineering(wrong.least, unit, 3)} at {engineering(wrong.current, 'A', 3)}, "
        f"{engineering(wrong.displacement, 'm', 3)}, where the machine's law has "
        f"{engineering(wrong.law, unit, 3)}: no magnet is so; {hint} or fewer rules may help"
    )
