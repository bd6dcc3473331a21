"""``ambkit train``: the expert system for k_i and k_s, from a force law or a measured force."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.options import BearingName, Json, Plot, file_option, find_bearing, quantity

if TYPE_CHECKING:
    from ambkit.fuzzy.choice import Shape
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.bearing import Bearing
    from ambkit.machine.stiffness import StiffnessMap

CLEAR = 0.2
"""The law's k_i or k_s is clearly positive from this part of its largest on."""


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
            help="Correct the bearing's law by a measured force: columns iu [A], x [m] and "
            "f_mag [N], a row for each point, on a grid or not; f_std [N], its standard error, "
            "weighs them. Where nothing was measured the law stays.",
        ),
    ] = None,
    law_error: Annotated[
        float | None,
        typer.Option(
            parser=quantity("N"),
            metavar="FORCE",
            help="With --map, by how much the law may be wrong where nothing was measured.",
            show_default="found from the points",
        ),
    ] = None,
    channels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="With --map, what its columns mean, where they have other names: [signals.iu], "
            "[signals.x] and [signals.f_mag], each with column and unit.",
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
    out: Annotated[
        Path | None,
        file_option(
            "Write the expert (.json); with --map, its points as a force map (.csv, .parquet), or "
            "the bearing with its law refitted to them (.toml).",
            (".json", ".csv", ".parquet", ".toml"),
            "--out",
        ),
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Train the expert for k_i and k_s.

    A fuzzy basis function network that the adaptive filter asks at every sample.

    For example:
      ambkit train zittau_axial --out expert.json --plot expert.png
      ambkit train found.toml --map force.csv --rules auto --out expert.json
    """
    from ambkit.cli import output
    from ambkit.cli.train_measured import Measured
    from ambkit.fuzzy import training
    from ambkit.show import plots

    shape = _shape(rules)
    for option, asked in (
        ("--rules auto", shape is None),
        ("--law-error", law_error is not None),
        ("--channels", channels is not None),
    ):
        if asked and force is None:
            raise typer.BadParameter(
                f"{option} needs points that were measured: --map FORCE.csv",
                param_hint=option.split()[0],
            )
    if law_error is not None and not law_error > 0:
        raise typer.BadParameter(
            f"must be greater than 0 N, is {law_error:g} N", param_hint="--law-error"
        )
    if force is None and out is not None and out.suffix.lower() != ".json":
        raise typer.BadParameter(
            "without --map there is an expert only: FILE.json", param_hint="--out"
        )
    model = find_bearing(bearing)
    options: dict[str, Any] = {
        "method": method.value,
        "weights": method is Method.least_squares if weights is None else weights,
        "normalised": not plain,
        "scaling": scaling.value,
    }
    measured = None
    with output.progress("training") as done:
        if force is None:
            assert shape is not None  # as auto needs --map
            stiff = _map(model, shape)
        else:
            measured = Measured.load(force, model, law_error, channels)
            if shape is None:
                shape = measured.choose_shape(options, done)
                done("training")
            stiff = measured.map(shape)
        expert = training.train(stiff, **options)
        if measured is not None and shape is not None:
            measured.choose_model(shape, options, done)
    data = _summary(expert, stiff, model)
    tables = [_table(data)]
    if measured is not None:
        told = measured.table(data, expert, stiff)
        tables = [*measured.choice_table(), *tables, told, *measured.models_table(data)]
    data["wrong_sign"] = _wrong_sign(expert, model)
    for name, wrong in data["wrong_sign"].items():
        output.note(_of_wrong_sign(name, wrong, measured is not None))

    def draw(path: Path) -> None:
        figure = plots.training_figure(expert, stiff)
        plots.save_figure(figure if measured is None else measured.figure(figure, stiff), path)

    def save(path: Path) -> None:
        if measured is None:
            expert.save(path)
        else:
            measured.save(path, expert)

    output.deliver(
        data,
        tables,
        [(out, save), (plot, draw)],
        as_json=json,
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


def _map(bearing: Bearing, shape: Shape) -> StiffnessMap:
    """Return the stiffnesses of the law, a node for each rule."""
    import numpy as np

    from ambkit.machine.stiffness import stiffness_map

    half = bearing.rotor.travel_limit / 2
    return stiffness_map(
        bearing,
        currents=np.linspace(bearing.current_min, bearing.current_max, shape[0]),
        displacements=np.linspace(-half, half, shape[1]),
    )


def _summary(expert: Expert, stiff: StiffnessMap, bearing: Bearing) -> dict[str, Any]:
    from ambkit.fuzzy.expert import Expert
    from ambkit.machine.magnets import ConstantStiffness

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


def _wrong_sign(expert: Expert, bearing: Bearing) -> dict[str, dict[str, float]]:
    """Where k_i or k_s is not positive though the bearing's law is clearly so, the worst place.

    Towards the ends of a one-sided magnet's box the law's own k_i and k_s, which share the force
    between them, go through zero; there a sign tells nothing.
    """
    import numpy as np

    from ambkit.machine.magnets import evaluate_stiffness, magnet_of

    box = np.meshgrid(
        np.linspace(*expert.current_range, 41), np.linspace(*expert.displacement_range, 41)
    )
    found = {}
    known = evaluate_stiffness(magnet_of(bearing), *box)
    for name, values, law in zip(("k_i", "k_s"), expert.stiffness(*box), known, strict=True):
        wrong = (values <= 0) & (law > CLEAR * law.max())
        if wrong.any():
            worst = np.unravel_index(np.argmin(np.where(wrong, values, np.inf)), values.shape)
            at = {"current": box[0], "displacement": box[1], "least": values, "law": law}
            found[name] = {"share": float(wrong.mean())} | {
                k: float(v[worst]) for k, v in at.items()
            }
    return found


def _of_wrong_sign(name: str, wrong: dict[str, float], measured: bool) -> str:
    from ambkit.cli.output import value

    unit = "N/A" if name == "k_i" else "N/m"
    hint = "more points there, a smaller --law-error" if measured else "other --rules, --weights"
    return (
        f"the trained {name} is not positive in {100 * wrong['share']:.2g} % of the box, down to "
        f"{value(wrong['least'], unit, 3)} at {value(wrong['current'], 'A', 3)}, "
        f"{value(wrong['displacement'], 'm', 3)}, where the bearing's law has "
        f"{value(wrong['law'], unit, 3)}: no magnet is so; {hint} or fewer rules may help"
    )


def _table(data: dict[str, Any]) -> Any:
    from ambkit.cli.output import table, value

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
