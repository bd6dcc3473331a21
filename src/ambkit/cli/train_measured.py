"""``ambkit train --map``: what a measured force adds to the training, its tables and picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli import output
from ambkit.cli.output import value

if TYPE_CHECKING:
    from ambkit.fuzzy.choice import RuleChoice, Shape
    from ambkit.fuzzy.expert import Expert
    from ambkit.fuzzy.left_out import ModelChoice
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.forces.surface import ForceSurface
    from ambkit.machine.stiffness import StiffnessMap
    from ambkit.show.report.figure import Figure

POOR = 0.1
"""A rule is hardly measured where the force is known no better than this part of its RMS."""


@dataclass
class Measured:
    """A measured force, the surface through it, and how many rules it carries."""

    path: Path
    bearing: Bearing
    surface: ForceSurface
    given_law_error: float | None
    choice: RuleChoice | None = None
    models: ModelChoice | None = None

    @classmethod
    def load(
        cls, path: Path, bearing: Bearing, law_error: float | None, channels: Path | None = None
    ) -> Measured:
        """Read the points, and find the force."""
        from ambkit.base.units import engineering
        from ambkit.machine.forces.file import load_force_points
        from ambkit.machine.forces.surface import ForceSurface

        points = load_force_points(path, channels)
        gap, farthest = bearing.magnet.air_gap, max(points.displacement.tolist(), key=abs)
        if abs(farthest) >= gap:
            raise AmbkitError(
                f"--map: x must stay within the air gap, {engineering(gap, 'm')}, reaches "
                f"{engineering(farthest, 'm')}: is a unit, scale or offset wrong?"
            )
        try:
            surface = ForceSurface(bearing, points, law_error)
        except AmbkitError as error:
            raise AmbkitError(f"{path}: {error}") from None
        return cls(path, bearing, surface, law_error)

    def choose_shape(self, options: dict[str, Any], note: Callable[[str], None]) -> Shape:
        """Choose the number of rules by cross-validation."""
        from ambkit.fuzzy.choice import choose_rules

        try:
            self.choice = choose_rules(
                self.bearing,
                self.surface.points,
                law_error=self.given_law_error,
                note=note,
                **options,
            )
        except AmbkitError as error:
            raise AmbkitError(f"{self.path}: {error}") from None
        return self.choice.chosen.shape

    def choose_model(
        self, shape: Shape, options: dict[str, Any], note: Callable[[str], None]
    ) -> None:
        """Find by points left out whether law, surface or network is to be believed."""
        from ambkit.fuzzy.left_out import choose_model

        self.models = choose_model(self.bearing, self.surface, shape, note, **options)

    def save(self, path: Path, expert: Expert) -> None:
        """Write the network, the points, or the bearing with the law refitted, by the ending."""
        from ambkit.fuzzy.left_out import refitted

        match path.suffix.lower():
            case ".csv" | ".parquet":
                self.surface.points.save(path)
            case ".toml":
                refitted(self.bearing, self.surface.points).save(path)
            case _:
                expert.save(path)

    def models_table(self, data: dict[str, Any]) -> list[Any]:
        """Say how the models do at points left out; warn of a network that is worse than a law."""
        from ambkit.fuzzy.left_out import LAW, NETWORK, SURFACE

        if self.models is None:
            return []
        models, chosen = self.models.models, self.models.chosen
        data["models"] = {"chosen": chosen.name} | {
            m.name: {"random": m.random, "blocks": m.blocks} for m in models
        }
        network, law = self.models[NETWORK], self.models[LAW]
        if network.worse > law.worse:
            output.note(
                f"at points left out the trained expert is off by {value(network.worse, 'N', 3)} "
                f"rms, the law that it started from by {value(law.worse, 'N', 3)}: leave it; "
                f"{chosen.name} has {value(chosen.worse, 'N', 3)}"
            )
        elif chosen.name != NETWORK:
            what = "write it" if chosen.name == SURFACE else "write the bearing with it"
            ending = {SURFACE: "--out map.csv"}.get(chosen.name, "--out bearing.toml")
            how = "" if chosen.name == LAW else f"; {what} with {ending}"
            output.note(
                f"at points left out {chosen.name} is off by {value(chosen.worse, 'N', 3)} rms, "
                f"the trained expert by {value(network.worse, 'N', 3)}{how}"
            )
        rows = [
            [m.name, value(m.random, "N", 3), value(m.blocks, "N", 3),
             "best" if m == chosen else ""]
            for m in models
        ]  # fmt: skip
        title = "Error at points left out, rms: here and there, and whole blocks of them"
        return [output.table(title, ["", "points", "blocks", ""], rows)]

    def map(self, shape: Shape) -> StiffnessMap:
        """Return the stiffnesses of the measured force, a node for each rule."""
        from ambkit.fuzzy.choice import measured_map

        try:
            return measured_map(self.bearing, self.surface, shape)
        except AmbkitError as error:
            raise AmbkitError(f"{self.path}: {error}") from None

    def choice_table(self) -> list[Any]:
        """Say what cross-validation found, if it was asked."""
        choice = self.choice
        if choice is None:
            return []
        marks = {choice.best.name: "best", choice.chosen.name: "chosen"}
        rows = [
            [c.name, str(c.rules), f"{c.error:.3g}", f"{c.standard_error:.2g}",
             marks.get(c.name, "")]
            for c in choice.candidates
        ]  # fmt: skip
        rows.append(["any number", "", f"{choice.surface_error:.3g}", "", ""])
        taken, best, limit = choice.chosen.name, choice.best.name, f"{choice.limit:.3g}"
        if taken == best:
            said = (
                f"Chosen: {taken}, the best; no smaller one is within a standard error ({limit})."
            )
        else:
            said = f"Chosen: {taken}, the smallest within a standard error of {best} ({limit})."
        title = "Error at points left out of the training; 1 is as good as can be"
        return [output.table(title, ["rules", "", "error", "std. error", ""], rows), said]

    def table(self, data: dict[str, Any], expert: Expert, stiff: StiffnessMap) -> Any:
        """Add to the results what the points said, warn where they said little; return a table."""
        import numpy as np

        from ambkit.fuzzy.lesson import rms
        from ambkit.machine.magnets import magnet_of

        points, surface = self.surface.points, self.surface
        inside = points.where(points.within(expert.current_range, expert.displacement_range))
        at = inside.current, inside.displacement
        off = {
            name: model(*at) - inside.force
            for name, model in (("law", magnet_of(self.bearing).force), ("trained", expert.force))
        }
        noise = surface.noise(inside)
        box = np.meshgrid(
            np.linspace(*expert.current_range, 41), np.linspace(*expert.displacement_range, 41)
        )
        doubt = surface.standard_error(*box)
        found = {
            "points": len(points),
            "points_in_box": len(inside),
            "law_error": surface.law_error,
            "law_error_reach": surface.reach,
            "scatter": surface.scatter,
            "force_standard_error": {"rms": rms(doubt), "largest": float(doubt.max())},
            "error_at_points": {name: rms(each) for name, each in off.items()},
            "error_at_points_in_standard_errors": {
                name: rms(each / noise) for name, each in off.items()
            },
            "hardly_measured": self._hardly_measured(stiff, data["force_rms"]),
        }
        data["measured"] = found
        if self.choice is not None:
            data["choice"] = _plain(self.choice)
        if data["force_error_rms"]["trained"] > data["force_error_rms"]["untrained"]:
            output.note("the trained expert's error is larger than the untrained one's")
        reach = [value(size, unit, 2) for size, unit in zip(surface.reach, "Am", strict=True)]
        how = "given" if self.given_law_error else "found"
        rows = [
            ["in the box of the expert", f"{len(inside)} of {len(points)}"],
            [f"error of the bearing's law, {how}",
             f"{value(surface.law_error, 'N', 3)}, alike within {reach[0]} and {reach[1]}"],
            ["standard error of the force over the box",
             f"{value(rms(doubt), 'N', 3)} rms, {value(float(doubt.max()), 'N', 3)} at most"],
            ["off the points: the law", self._off(off["law"], noise)],
            ["off the points: the trained expert", self._off(off["trained"], noise)],
        ]  # fmt: skip
        if surface.scatter is not None:
            rows.insert(1, ["their scatter, found", f"{value(surface.scatter, 'N', 3)} rms"])
        return output.table(f"{self.path.name}: {len(points)} points", ["", ""], rows)

    def _off(self, off: Any, noise: Any) -> str:
        from ambkit.fuzzy.lesson import rms

        return f"{value(rms(off), 'N', 3)} rms, {rms(off / noise):.3g} standard errors"

    def _hardly_measured(self, stiff: StiffnessMap, size: float) -> list[tuple[float, float]]:
        """Name the rules at which the points tell little, [A] and [m], and what stays there."""
        import numpy as np

        from ambkit.base.units import engineering

        iu, x = (each.ravel() for each in np.meshgrid(stiff.current, stiff.displacement))
        doubt = self.surface.standard_error(iu, x)
        poor = doubt > POOR * size
        nodes = [
            f"{engineering(a, 'A', digits=3)} at {engineering(b, 'm', digits=3)}"
            for a, b in zip(iu[poor], x[poor], strict=True)
        ]
        if nodes:
            more = f" and {len(nodes) - 6} more" if len(nodes) > 6 else ""
            worst = engineering(float(doubt[poor].max()), "N", digits=2)
            output.note(
                f"hardly measured at {len(nodes)} of {iu.size} rules: there the expert stays near "
                f"the bearing's law, its force known to {worst} at worst: "
                f"{', '.join(nodes[:6])}{more}"
            )
        return list(zip(iu[poor].tolist(), x[poor].tolist(), strict=True))

    def figure(self, figure: Figure, stiff: StiffnessMap) -> Figure:
        """Put points, their surface, and the choice before the picture of a training."""
        from ambkit.show.plots.rules import with_choice, with_surface

        shown = with_surface(figure, self.surface, stiff)
        return shown if self.choice is None else with_choice(shown, self.choice)


def _plain(choice: RuleChoice) -> dict[str, Any]:
    return {
        "chosen": choice.chosen.name,
        "best": choice.best.name,
        "limit": choice.limit,
        "surface_error": choice.surface_error,
        "folds": choice.folds,
        "candidates": [
            {
                "shape": c.name,
                "rules": c.rules,
                "error": c.error,
                "standard_error": c.standard_error,
            }
            for c in choice.candidates
        ],
    }
