"""``ambkit train --force-map``: what a measured force adds, its tables and picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.cli import printing
from ambkit.cli.printing import value

if TYPE_CHECKING:
    from ambkit.fuzzy.cross_validation import ModelChoice
    from ambkit.fuzzy.rule_selection import RuleChoice
    from ambkit.result.report.figure import Figure
    from ambkit.workflow.training import MeasuredForce, TrainedExpert


def tables(
    path: Path, result: TrainedExpert, data: dict[str, Any], trained: list[Any]
) -> list[Any]:
    """Put what the points said around the table of a training, and warn where they said little."""
    assert result.measured is not None  # there are points
    _say_what_is_hardly_measured(result)
    if result.error["trained"] > result.error["untrained"]:
        printing.note("the trained expert's error is larger than the untrained one's")
    choice = result.measured.choice
    return [
        *([] if choice is None else _choice_table(choice)),
        *trained,
        _points_table(path, result.measured, data["measured"]),
        *([] if result.models is None else [_models_table(result.models, result.taken)]),
    ]


def save(path: Path, result: TrainedExpert) -> None:
    """Write the network, the points, or the bearing with the law refitted, by the ending."""
    from ambkit.fuzzy.cross_validation import LAW, refitted

    ending = path.suffix.lower()
    if result.measured is None or ending == ".json":
        result.expert.save(path)
        return
    points = result.measured.surface.points
    if ending == ".toml":
        law = result.model[0] if result.taken == LAW else refitted(result.bearing, points)
        law.save(path)
    else:
        points.save(path)


def say_what_is_taken(result: TrainedExpert, out: Path | None, save_filter: Path | None) -> None:
    """Say where a file that was asked for holds another model than the one that is taken."""
    from ambkit.fuzzy.cross_validation import NETWORK, SURFACE

    chosen_name = result.taken
    if chosen_name == NETWORK or (out is not None and out.suffix.lower() != ".json"):
        return
    writes = "--out force.csv" if chosen_name == SURFACE else "--out bearing.toml"
    if out is not None:
        asks = "" if save_filter is None else f" and {save_filter.name} asks that"
        printing.note(
            f"{out.name} holds the network, but {chosen_name} is better at points left out{asks}: "
            f"{writes} writes it, --as network takes the network all the same"
        )
    elif save_filter is None:
        printing.note(f"{chosen_name} is better at points left out: {writes} writes it")


def with_points(figure: Figure, result: TrainedExpert) -> Figure:
    """Put points, their surface, and the choice before the picture of a training."""
    from ambkit.fuzzy.rules_figure import with_choice, with_surface

    measured = result.measured
    if measured is None:
        return figure
    surface_figure = with_surface(figure, measured.surface, result.stiffness)
    return (
        surface_figure if measured.choice is None else with_choice(surface_figure, measured.choice)
    )


def _models_table(of: ModelChoice, chosen_name: str) -> Any:
    """Say how the models do at points left out; warn of a network that is worse than a law."""
    models, chosen = of.models, of.chosen
    if warning := of.against(chosen_name):
        printing.note(warning)
    rows = [
        [m.name, value(m.random, "N", 3), value(m.blocks, "N", 3),
         ", ".join(["best"] * (m == chosen) + ["taken"] * (m.name == chosen_name))]
        for m in models
    ]  # fmt: skip
    title = "Error at points left out, rms: here and there, and whole blocks of them"
    return printing.table(title, ["", "points", "blocks", ""], rows)


def _choice_table(choice: RuleChoice) -> list[Any]:
    """Say what cross-validation found."""
    marks = {choice.best.name: "best", choice.chosen.name: "chosen"}
    rows = [
        [c.name, str(c.rules), f"{c.error:.3g}", f"{c.standard_error:.2g}",
         marks.get(c.name, "")]
        for c in choice.candidates
    ]  # fmt: skip
    rows.append(["any number", "", f"{choice.surface_error:.3g}", "", ""])
    chosen_name, best, limit = choice.chosen.name, choice.best.name, f"{choice.limit:.3g}"
    if chosen_name == best:
        conclusion = (
            f"Chosen: {chosen_name}, the best; no smaller one is within a standard error ({limit})."
        )
    else:
        conclusion = (
            f"Chosen: {chosen_name}, the smallest within a standard error of {best} ({limit})."
        )
    title = "Error at points left out of the training; 1 is as good as can be"
    return [printing.table(title, ["rules", "", "error", "std. error", ""], rows), conclusion]


def _points_table(path: Path, measured: MeasuredForce, data: dict[str, Any]) -> Any:
    """Say what the points tell of the force, and how far off them law and expert are."""

    def off(name: str) -> str:
        error = value(data["error_at_points"][name], "N", 3)
        return (
            f"{error} rms, {data['error_at_points_in_standard_errors'][name]:.3g} standard errors"
        )

    surface, standard_error = measured.surface, data["force_standard_error"]
    length_scales = [value(size, unit, 2) for size, unit in zip(surface.reach, "Am", strict=True)]
    how = "given" if measured.law_error_given else "found"
    rows = [
        ["in the box of the expert", f"{data['points_in_box']} of {data['points']}"],
        [f"error of the bearing's law, {how}",
         f"{value(surface.law_error, 'N', 3)}, alike within {length_scales[0]} "
         f"and {length_scales[1]}"],
        ["standard error of the force over the box",
         f"{value(standard_error['rms'], 'N', 3)} rms, "
         f"{value(standard_error['largest'], 'N', 3)} at most"],
        ["off the points: the law", off("law")],
        ["off the points: the trained expert", off("trained")],
    ]  # fmt: skip
    if surface.scatter is not None:
        rows.insert(1, ["their scatter, found", f"{value(surface.scatter, 'N', 3)} rms"])
    return printing.table(f"{path.name}: {data['points']} points", ["", ""], rows)


def _say_what_is_hardly_measured(result: TrainedExpert) -> None:
    """Name the rules at which the points tell little, and what stays there."""
    from ambkit.base.units import engineering

    poor = result.hardly_measured
    if not poor:
        return
    nodes = [
        f"{engineering(iu, 'A', digits=3)} at {engineering(x, 'm', digits=3)}" for iu, x, _ in poor
    ]
    more = f" and {len(nodes) - 6} more" if len(nodes) > 6 else ""
    worst = engineering(max(error for *_, error in poor), "N", digits=2)
    printing.note(
        f"hardly measured at {len(nodes)} of {result.stiffness.k_i.size} rules: there the expert "
        f"stays near the bearing's law, its force known to {worst} at worst: "
        f"{', '.join(nodes[:6])}{more}"
    )
