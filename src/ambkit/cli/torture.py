"""``ambkit torture``: estimators through faults, in the loop and beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.cli.kinds import NAMES, known, names
from ambkit.cli.options import (
    RECORDS,
    BearingName,
    ExpertFile,
    Json,
    Plot,
    Verbose,
    file_option,
    find_machine,
)

if TYPE_CHECKING:
    from ambkit.judge.faults.campaign import Torture

PRECISIONS = ("float64", "float32", "both")


def _known_each(chosen: list[str] | None) -> list[str] | None:
    return None if chosen is None else [known(text) for text in chosen]


def _known_precision(name: str) -> str:
    if name not in PRECISIONS:
        raise typer.BadParameter(f'"{name}" is none of {", ".join(PRECISIONS)}')
    return name


def torture(
    bearing: BearingName,
    estimators: Annotated[
        list[str] | None,
        typer.Option(
            "--estimator",
            "--estimators",
            callback=_known_each,
            metavar="NAME",
            help=f"Who is put through it; again for more, or with commas: {', '.join(NAMES)}. "
            "Default all.",
        ),
    ] = None,
    reading: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="Of several readings the one with the faults; else the first."
        ),
    ] = None,
    faults: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Some of the faults, as the table names them."),
    ] = None,
    runs: Annotated[
        int, typer.Option("--runs", "--seeds", min=1, metavar="N", help="How many campaigns.")
    ] = 1,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Of the first of them.")] = 0,
    steps: Annotated[
        int,
        typer.Option(
            min=0, metavar="N", help="Samples of a flight through random mixtures; 0: none."
        ),
    ] = 50_000,
    precision: Annotated[
        str,
        typer.Option(callback=_known_precision, metavar="NAME", help=f"{', '.join(PRECISIONS)}."),
    ] = "float64",
    expert: ExpertFile = None,
    out: Annotated[
        Path | None,
        file_option("Write the figures of each flight: .csv or .parquet.", RECORDS, "--out"),
    ] = None,
    plot: Plot = None,
    verbose: Verbose = False,
    json: Json = False,
) -> None:
    """Put estimators through faults, and say who comes back.

    Outages, stuck, late and mad sensors, spikes, touchdown, saturation, NaN and huge values, and
    mixtures drawn at random. Each is flown beside the loop, where the controller gets the true
    measurement and every estimator must come back, and in the loop, where it gets the estimate.

    For example:
      ambkit torture zittau_axial --estimator linear --estimator extended --plot faults.png
      ambkit torture tum_mlps --estimator linear --reading Lb1
    """
    from ambkit.cli import output
    from ambkit.cli.kinds import factories
    from ambkit.judge.comparison.contenders import suited
    from ambkit.judge.faults.campaign import chosen_faults, flights_of
    from ambkit.judge.faults.campaign import torture as through

    plant = find_machine(bearing)
    chosen = suited(names(",".join(estimators or NAMES)), plant)
    named = chosen_faults(None if faults is None else names(faults))
    precisions: Any = ("float64", "float32") if precision == "both" else (precision,)
    built = factories(chosen, plant, expert)
    work = len(precisions) * flights_of(len(built), named, runs, steps=steps)
    with output.progress("flying", work) as done:
        found = through(
            plant, built, reading=reading, faults=named, steps=steps,
            seeds=range(seed, seed + runs), precisions=precisions, done=done,
        )  # fmt: skip
    rows = (out, lambda path: _save(path, found))
    output.deliver_result(found, [rows], as_json=json, verbose=verbose, plot=plot)


def _save(path: Path, found: Torture) -> None:
    """Write the figures: a row for each flight; names are places in lists of the file's head."""
    import numpy as np

    from ambkit.data.files.tables import Table, write_table

    texts = ("fault", "estimator", "precision", "setting", "levitation")
    units = {"at_stop": "s", "worst_x": "m", "worst_f_d": "N", "after_x": "m", "after_f_d": "N"}
    columns, lists = {}, {}
    for name in [*vars(found.outcomes[0]), "recovered"]:
        values = [getattr(each, name) for each in found.outcomes]
        if name in texts:
            lists[f"{name}s"] = list(dict.fromkeys(values))
            values = [lists[f"{name}s"].index(value) for value in values]
        columns[name] = np.array(values, dtype=float)
    write_table(
        path,
        Table(
            columns,
            {name: units.get(name, "1") for name in columns},
            {"bearing": found.bearing.name} | lists,
        ),
    )
