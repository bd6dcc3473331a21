"""``ambkit train``: the expert system for k_i and k_s, from a force law or a measured force."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.base.errors import AmbkitError
from ambkit.base.units import percent
from ambkit.cli.parameters import (
    AxisName,
    BearingName,
    Json,
    Plot,
    arguments_of_the_user,
    file_option,
    find_machine,
    isolated,
    quantity,
)

if TYPE_CHECKING:
    from ambkit.fuzzy.rule_selection import Shape
    from ambkit.workflow.training import WrongSign


class Method(StrEnum):
    """How the network is trained."""

    least_squares = "least-squares"
    steepest_gradient = "steepest-gradient"


class Take(StrEnum):
    """Which model of the magnet is taken."""

    network = "network"
    surface = "surface"
    law = "law"


class Scaling(StrEnum):
    """How an ampere and a millimetre compare."""

    grid = "grid"
    unit = "unit"


def train(
    bearing: BearingName,
    force: Annotated[
        Path | None,
        typer.Option(
            "--force-map",
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
            help="With --force-map, by how much the law may be wrong where nothing was measured.",
            show_default="found from the points",
        ),
    ] = None,
    channels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="With --force-map, what its columns mean, where they have other names: "
            "[signals.iu], [signals.x] and [signals.f_mag], each with column and unit.",
        ),
    ] = None,
    rules: Annotated[
        str,
        typer.Option(
            metavar="NxM|auto",
            help="Rules along current and displacement; auto: as many as the points of --force-map "
            "carry, by cross-validation.",
        ),
    ] = "5x5",
    reach: Annotated[
        float | None,
        typer.Option(
            parser=quantity("m"),
            metavar="LENGTH",
            help="How far out the bearing's law is learned, either way; half of the travel without "
            "it. With --force-map as far as there are points.",
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
    take: Annotated[
        Take | None,
        typer.Option(
            "--as",
            help="With --force-map, the model that is taken, whatever points left out prefer: the "
            "network, the surface through the points, or the law, refitted where that is better.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        file_option(
            "Write the expert (.json); with --force-map, its points as a force map (.csv, "
            ".parquet), or the bearing with its law refitted to them (.toml).",
            (".json", ".csv", ".parquet", ".toml"),
            "--out",
        ),
    ] = None,
    save_filter: Annotated[
        Path | None,
        file_option(
            "Write the filter that knows what is taken (.toml), for 'ambkit filter', 'export' ...: "
            "the expert, or what points left out prefer to it, or what --as says.",
            (".toml",),
            "--save-filter",
        ),
    ] = None,
    axis: AxisName = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Train the fuzzy expert for k_i and k_s.

    A fuzzy basis function network that the adaptive filter asks at every sample.

    For example:
      ambkit train zittau_axial --out expert.json --plot expert.png
      ambkit train found.toml --force-map force.csv --rules auto --save-filter filter.toml
    """
    from ambkit.cli import printing, train_measured
    from ambkit.fuzzy.expert_card import training_figure
    from ambkit.judge.adequacy import judge_adequacy
    from ambkit.machine.forces.force_file import load_force_points
    from ambkit.result.saving import save_figure
    from ambkit.workflow.expert import FORMS, filter_of
    from ambkit.workflow.expert import save_filter as saved
    from ambkit.workflow.training import RULES, check_within_gap, how_to_train, measured_force
    from ambkit.workflow.training import train_expert as trained

    shape = _shape(rules)
    for option, is_set in (
        ("--rules auto", shape is None),
        ("--law-error", law_error is not None),
        ("--as", take is not None),
        ("--channels", channels is not None),
    ):
        if is_set and force is None:
            raise typer.BadParameter(
                f"{option} needs points that were measured: --force-map FORCE.csv",
                param_hint=option.split()[0],
            )
    if reach is not None and force is not None:
        raise typer.BadParameter(
            "a force map reaches as far as it has points", param_hint="--reach"
        )
    if law_error is not None and not law_error > 0:
        raise typer.BadParameter(
            f"must be greater than 0 N, is {law_error:g} N", param_hint="--law-error"
        )
    if force is None and out is not None and out.suffix.lower() != ".json":
        raise typer.BadParameter(
            "without --force-map there is an expert only: FILE.json", param_hint="--out"
        )
    if take is not None and out is not None and out.suffix.lower() not in FORMS[f"the {take}"]:
        raise typer.BadParameter(
            f"--as {take} is written as {' or '.join(FORMS[f'the {take}'])}, --out is {out.name}",
            param_hint="--as",
        )
    output_kind = "best" if take is None else take.value
    if take is None and out is not None:  # points and bearings are asked for by no one by chance
        output_kind = {".json": "best", ".toml": "law"}.get(out.suffix.lower(), "surface")
    model = isolated(find_machine(bearing), axis)
    options = how_to_train(method.value, weights, normalised=not plain, scaling=scaling.value)
    measured = None
    with printing.progress("training") as done:
        if force is not None:
            points = load_force_points(force, channels)
            with arguments_of_the_user("--force-map: "):
                check_within_gap(model, points)
            try:
                measured = measured_force(
                    model, points, shape, law_error=law_error, note=done, **options
                )
            except AmbkitError as error:
                raise AmbkitError(f"{force}: {error}") from None
        with arguments_of_the_user("--"):
            result = trained(
                model, shape or RULES, reach=reach, measured=measured,
                take=output_kind, note=done, **options,
            )  # fmt: skip
    data = result.to_dict()
    tables = [_table(data)]
    if force is not None:
        tables = train_measured.tables(force, result, data, tables)
    for name, wrong in result.wrong_signs.items():
        printing.note(_of_wrong_sign(name, wrong, measured is not None))

    # What --out holds is what the filter asks only if it is what is taken.
    holds = out if out is not None and out.suffix.lower() in FORMS[result.taken] else None
    if measured is not None:
        train_measured.say_what_is_taken(result, out, save_filter)

    if save_filter is not None:
        data["adequacy"] = printing.say_adequacy(judge_adequacy(filter_of(result)))

    def draw(path: Path) -> None:
        figure = training_figure(result.expert, result.stiffness)
        save_figure(train_measured.with_points(figure, result), path)

    printing.deliver(
        data,
        tables,
        [
            (out, lambda path: train_measured.save(path, result)),
            (save_filter, lambda path: saved(result, path, bearing=bearing, written=holds)),
            (plot, draw),
        ],
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


def _of_wrong_sign(name: str, wrong: WrongSign, measured: bool) -> str:
    from ambkit.cli.printing import value

    unit = "N/A" if name == "k_i" else "N/m"
    hint = "more points there, a smaller --law-error" if measured else "other --rules, --weights"
    return (
        f"the trained {name} is not positive in {percent(wrong.share)} of the box, down to "
        f"{value(wrong.least, unit, 3)} at {value(wrong.current, 'A', 3)}, "
        f"{value(wrong.displacement, 'm', 3)}, where the bearing's law has "
        f"{value(wrong.law, unit, 3)}: no magnet is so; {hint} or fewer rules may help"
    )


def _table(data: dict[str, Any]) -> Any:
    from ambkit.cli.printing import table, value

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
