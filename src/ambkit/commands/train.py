"""``ambkit train``: the expert system for k_i and k_s, from a force law or a measured force."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.commands.options import BearingName, Json, Plot, file_option, find_bearing
from ambkit.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.fuzzy import Expert
    from ambkit.fuzzy.choice import RuleChoice, Shape
    from ambkit.identification.force_table import ForceTable
    from ambkit.identification.stiffness import StiffnessMap


class Method(StrEnum):
    """How the network is trained."""

    least_squares = "least-squares"
    steepest_gradient = "steepest-gradient"


class Scaling(StrEnum):
    """How an ampere and a millimetre compare."""

    grid = "grid"
    unit = "unit"


def train(
    bearing: BearingName,
    force: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FORCE.csv",
            help="Learn this force instead of the bearing's law: columns iu [A], x [m] and "
            "f_mag [N], a row for each node of a grid; f_std [N], its standard error, weighs them.",
        ),
    ] = None,
    rules: Annotated[
        str,
        typer.Option(
            metavar="NxM|auto",
            help="Rules along current and displacement; auto: as many as the points of --map "
            "carry, by cross-validation.",
        ),
    ] = "5x5",
    method: Annotated[
        Method, typer.Option(help="As the paper does it, or better.")
    ] = Method.least_squares,
    weights: Annotated[
        bool | None,
        typer.Option(
            "--weights/--no-weights",
            help="Train the rules' conclusions as well as their widths (least squares only).",
            show_default="with least squares",
        ),
    ] = None,
    plain: Annotated[
        bool, typer.Option("--plain", help="Eq. 33 as printed, not normalised.")
    ] = False,
    scaling: Annotated[
        Scaling,
        typer.Option(help="grid: a step of the grid weighs alike; unit: 1 A weighs as 1 mm."),
    ] = Scaling.grid,
    out: Annotated[Path | None, file_option("Write the expert.", (".json",), "--out")] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Train the expert for k_i and k_s.

    A fuzzy basis function network that the adaptive filter asks at every sample.

    For example:
      ambkit train zittau_axial --out expert.json --plot expert.png
    """
    from ambkit import plots
    from ambkit.commands import output
    from ambkit.fuzzy import training
    from ambkit.fuzzy.choice import choose_rules
    from ambkit.fuzzy.figures import with_choice
    from ambkit.identification.force_file import load_force_table

    shape = _shape(rules)
    if shape is None and force is None:
        raise typer.BadParameter(
            "auto needs points that were measured: --map FORCE.csv", param_hint="--rules"
        )
    model = find_bearing(bearing)
    table = None if force is None else load_force_table(force)
    if table is not None:
        _check_gap(table, model)
    options: dict[str, Any] = {
        "method": method.value,
        "weights": method is Method.least_squares if weights is None else weights,
        "normalised": not plain,
        "scaling": scaling.value,
    }
    choice = None
    with output.progress("training") as done:
        if table is not None and shape is None:
            try:
                choice = choose_rules(model, table, note=done, **options)
            except AmbkitError as error:
                raise AmbkitError(f"{force}: {error}") from None
            shape = choice.chosen.shape
            done("training")
        assert shape is not None  # given, or chosen
        stiff = _map(model, table, shape)
        expert = training.train(stiff, **options)
    data = _summary(expert, stiff, model)
    if table is not None:
        _warn(data, table)
    tables = [_table(data)]
    if choice is not None:
        data["choice"] = _choice(choice)
        tables = [*_choice_table(choice), *tables]

    def draw(path: Path) -> None:
        figure = plots.training_figure(expert, stiff)
        if choice is not None and table is not None:
            figure = with_choice(figure, choice, table)
        plots.save_figure(figure, path)

    output.deliver(
        data,
        tables,
        [(out, expert.save), (plot, draw)],
        as_json=json,
    )


def _check_gap(table: ForceTable, bearing: Bearing) -> None:
    """Raise AmbkitError where a force table has displacements that no rotor reaches."""
    from ambkit.units import engineering

    gap, farthest = bearing.magnet.air_gap, max(table.displacement.tolist(), key=abs)
    if abs(farthest) >= gap:
        raise AmbkitError(
            f"--map: x must stay within the air gap, {engineering(gap, 'm')}, reaches "
            f"{engineering(farthest, 'm')}: is a unit, scale or offset wrong?"
        )


def _shape(text: str) -> Shape | None:
    """Rules along current and displacement; None where they are to be chosen."""
    from ambkit._core import MAX_RULES

    if text == "auto":
        return None
    sides = text.lower().split("x")
    if len(sides) != 2 or not all(side.isdecimal() for side in sides):
        raise typer.BadParameter(
            f"must be auto, or rules along current and displacement such as 7x5, is {text!r}",
            param_hint="--rules",
        )
    across, along = map(int, sides)
    if min(across, along) < 2 or across * along > MAX_RULES:
        raise typer.BadParameter(
            f"must be 2 or more in each direction, and {MAX_RULES} or less in total, is {text}",
            param_hint="--rules",
        )
    return across, along


def _map(bearing: Bearing, table: ForceTable | None, shape: Shape) -> StiffnessMap:
    """Return the stiffnesses of the measured force or else of the law, a node for each rule."""
    import numpy as np

    from ambkit.fuzzy.choice import measured_map
    from ambkit.identification.stiffness import stiffness_map

    if table is not None:
        return measured_map(bearing, table, shape)
    half = bearing.rotor.travel_limit / 2
    return stiffness_map(
        bearing,
        currents=np.linspace(bearing.current_min, bearing.current_max, shape[0]),
        displacements=np.linspace(-half, half, shape[1]),
    )


def _choice(choice: RuleChoice) -> dict[str, Any]:
    return {
        "chosen": choice.chosen.name,
        "best": choice.best.name,
        "limit": choice.limit,
        "unit": "standard errors" if choice.weighted else "N",
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


def _choice_table(choice: RuleChoice) -> list[Any]:
    from ambkit.commands.output import table, value

    def shown(number: float) -> str:
        return f"{number:.3g}" if choice.weighted else value(number, "N", 3)

    marks = {choice.best.name: "best", choice.chosen.name: "chosen"}
    rows = [
        [c.name, str(c.rules), shown(c.error), shown(c.standard_error), marks.get(c.name, "")]
        for c in choice.candidates
    ]
    unit = "in standard errors of the points" if choice.weighted else "rms"
    taken, best, limit = choice.chosen.name, choice.best.name, shown(choice.limit)
    if taken == best:
        said = f"Chosen: {taken}, the best; no smaller one is within a standard error ({limit})."
    else:
        said = f"Chosen: {taken}, the smallest within a standard error of {best} ({limit})."
    title = f"Error at points left out of the training, {unit}"
    return [table(title, ["rules", "", "error", "std. error", ""], rows), said]


def _summary(expert: Expert, stiff: StiffnessMap, bearing: Bearing) -> dict[str, Any]:
    from ambkit.fuzzy import Expert
    from ambkit.magnets import ConstantStiffness

    constant = ConstantStiffness.of(bearing)
    training = expert.training
    assert training is not None  # it was just trained
    models = {
        "constant": lambda iu, x: constant.k_i * iu + constant.k_s * x + stiff.force_bias,
        "untrained": Expert.from_map(
            stiff,
            normalised=expert.normalised,
            scaling=(expert.per_ampere, expert.per_metre),
        ).force,
        "trained": expert.force,
    }
    return {
        "source": expert.source,
        "rules": len(expert.rules),
        "method": training.method,
        "weights": training.weights,
        "normalised": expert.normalised,
        "steps": len(training.force_rms) - 1,
        "current_range": expert.current_range,
        "displacement_range": expert.displacement_range,
        "force_rms": stiff.force_rms(),
        "force_error_rms": {name: stiff.force_rms(model) for name, model in models.items()},
        "force_error_weighted": _weighted(models, expert, stiff),
    }


def _weighted(
    models: dict[str, Any], expert: Expert, stiff: StiffnessMap
) -> dict[str, float] | None:
    """RMS errors in standard errors of the measured force; None where those are not known."""
    import numpy as np

    from ambkit.fuzzy.lesson import rms
    from ambkit.identification.force_table import ForceTable

    if not isinstance(stiff.force, ForceTable) or stiff.force.standard_error is None:
        return None
    iu, x = np.meshgrid(
        np.linspace(*expert.current_range, 21), np.linspace(*expert.displacement_range, 21)
    )
    force, std = stiff.force(iu, x), stiff.force.uncertainty(iu, x)
    assert std is not None  # asked above
    return {name: rms((np.asarray(model(iu, x)) - force) / std) for name, model in models.items()}


def _warn(data: dict[str, Any], table: ForceTable) -> None:
    """Name the nodes that were hardly measured, and say where the training made things worse."""
    import numpy as np

    from ambkit.commands import output
    from ambkit.units import engineering

    std = table.standard_error
    if std is None:
        return
    spread = float(np.std(table.values))
    nodes = [
        f"{engineering(table.current[i], 'A', digits=3)} at "
        f"{engineering(table.displacement[k], 'm', digits=3)}"
        for k, i in np.argwhere(2 * std > spread)
    ]
    if nodes:
        more = f" and {len(nodes) - 6} more" if len(nodes) > 6 else ""
        output.note(
            f"{len(nodes)} of {std.size} nodes were hardly measured, 2 f_std is larger than the "
            f"spread of the force, {engineering(spread, 'N', digits=3)}: {', '.join(nodes[:6])}"
            f"{more}; do not trust the expert there"
        )
    for errors in (data["force_error_weighted"], data["force_error_rms"]):
        if errors["trained"] > errors["untrained"]:
            how = "in standard errors" if errors is data["force_error_weighted"] else "unweighted"
            output.note(f"the trained expert's error, {how}, is larger than the untrained one's")


def _table(data: dict[str, Any]) -> Any:
    from ambkit.commands.output import table, value

    errors = data["force_error_rms"]
    trained = "widths and weights" if data["weights"] else "widths"
    (low, high), (left, right) = data["current_range"], data["displacement_range"]
    rows = [
        ["box", f"{value(low, 'A')} to {value(high, 'A')}, {value(left, 'm')} to "
                f"{value(right, 'm')}"],
        ["force, without that at the origin", f"{value(data['force_rms'], 'N')} rms"],
        ["error with constant stiffnesses", f"{value(errors['constant'], 'N')} rms"],
        ["error of the untrained expert", f"{value(errors['untrained'], 'N')} rms"],
        ["error of the trained expert", f"{value(errors['trained'], 'N')} rms"],
    ]  # fmt: skip
    weighted = data["force_error_weighted"]
    if weighted is not None:
        rows += [
            [f"  of the {name} expert, in standard errors", f"{weighted[name]:.3g}"]
            for name in ("untrained", "trained")
        ]
    how = f"{trained} by {data['method']}, {data['steps']} steps"
    return table(f"{data['source']}: {data['rules']} rules, {how}", ["", ""], rows)
