"""``ambkit train``: the expert system for k_i and k_s, from a force law or a measured force."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.commands.options import BearingName, Json, Plot, file_option, find_bearing

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.fuzzy import Expert
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
            "f_mag [N], a row for each node of a grid.",
        ),
    ] = None,
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
    from ambkit.identification.force_file import load_force_table
    from ambkit.identification.stiffness import stiffness_map

    model = find_bearing(bearing)
    if weights is None:
        weights = method is Method.least_squares
    stiff = stiffness_map(model) if force is None else _map_of(load_force_table(force), model)
    with output.progress("training"):
        expert = training.train(
            stiff,
            method=method.value,
            weights=weights,
            normalised=not plain,
            scaling=scaling.value,
        )
    data = _summary(expert, stiff, model)
    output.deliver(
        data,
        [_table(data)],
        [
            (out, expert.save),
            (plot, lambda path: plots.save_figure(plots.training_figure(expert, stiff), path)),
        ],
        as_json=json,
    )


def _map_of(table: ForceTable, bearing: Bearing) -> StiffnessMap:
    """Return the stiffnesses of a force table, where table and the bearing's box overlap."""
    import numpy as np

    from ambkit.identification.stiffness import stiffness_map

    half = bearing.rotor.travel_limit / 2
    first, last = np.clip(table.current[[0, -1]], bearing.current_min, bearing.current_max)
    left, right = np.clip(table.displacement[[0, -1]], -half, half)
    return stiffness_map(
        bearing,
        currents=np.linspace(first, last, 5),
        displacements=np.linspace(left, right, 5),
        force=table,
    )


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
    }


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
    how = f"{trained} by {data['method']}, {data['steps']} steps"
    return table(f"{data['source']}: {data['rules']} rules, {how}", ["", ""], rows)
