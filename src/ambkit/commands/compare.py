"""``ambkit compare``: estimators in the loop against the same noise, over many seeds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambkit.commands.family import NAMES, known, names
from ambkit.commands.options import (
    RECORDS,
    BearingName,
    ExpertFile,
    Json,
    Plot,
    file_option,
    find_bearing,
    quantity,
    read_quantities,
)

if TYPE_CHECKING:
    from ambkit.comparison import Score

LABELS = {"x": "x", "v": "v", "f_d": "F_St"}


def compare(
    bearing: BearingName,
    scenario: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="What happens, besides step and load.")
    ] = None,
    estimator: Annotated[
        str, typer.Option(callback=known, metavar="NAMES", help=f"Some of {', '.join(NAMES)}.")
    ] = "linear,adaptive,closed-law",
    expert: ExpertFile = None,
    steps: Annotated[
        str | None,
        typer.Option(
            metavar="LENGTHS",
            help='Steps of the reference, such as "0.1 mm,0.3 mm"; default a tenth, three tenths '
            "and half of the travel, or what the scenario says.",
        ),
    ] = None,
    load: Annotated[
        float | None,
        typer.Option(parser=quantity("N"), metavar="FORCE", help="Load after half of the run."),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(parser=quantity("s"), metavar="TIME", help='Such as "0.5 s".')
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, metavar="N", help="How many seeds.")] = 20,
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="The first of them.")] = 0,
    out: Annotated[
        Path | None,
        file_option("Write the errors of each run: .csv or .parquet.", RECORDS, "--out"),
    ] = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Compare estimators over many seeds.

    Each closes its own loop, against the same noise, with the same Q and R.

    For example:
      ambkit compare zittau_axial --steps "0.1 mm,0.3 mm,0.5 mm" --load "3 N" --plot bars.png
    """
    from ambkit import comparison, plots
    from ambkit.commands import output
    from ambkit.commands.family import factories, scenario_of

    chosen = names(estimator)
    plant = find_bearing(bearing)
    heights: list[float | None] = [None]
    if steps is not None:
        heights = list(read_quantities(steps, "m", "--steps"))
    elif scenario is None:
        heights = [share * plant.rotor.travel_limit for share in (0.1, 0.3, 0.5)]
    happening = {
        output.value(height, "m") if height is not None else str(scenario): scenario_of(
            plant, scenario, duration=duration, step=height, load=load, seed=None
        )
        for height in heights
    }
    built = factories(chosen, plant, expert)
    runs = len(happening) * len(built) * seeds
    with output.progress("comparing", runs) as done:
        scores = {
            case: comparison.compare(plant, each, built, range(seed, seed + seeds), done=done)
            for case, each in happening.items()
        }
    what = "scenario" if heights == [None] else "step"
    data = {
        "bearing": plant.name,
        "seeds": [seed, seed + seeds - 1],
        "load": load,
        "cases": {case: {n: _figures(s) for n, s in of.items()} for case, of in scores.items()},
    }
    figure = plots.comparison_figure
    output.deliver(
        data,
        [_table(scores, what, f"{plant.name}, {seeds} seeds")],
        [
            (out, lambda path: _save(path, scores, heights, seed)),
            (plot, lambda path: plots.save_figure(figure(scores, what), path)),
        ],
        as_json=json,
    )


def _figures(score: Score) -> dict[str, Any]:
    return {
        "rmse": {name: score.mean(name) for name in score.rmse},
        "spread": {name: score.spread(name) for name in score.rmse},
        "nis": score.nis.mean(),
    }


def _table(scores: Mapping[str, Mapping[str, Score]], what: str, title: str) -> Any:
    from ambkit.commands.output import table, value
    from ambkit.comparison import JUDGED
    from ambkit.units import factor

    def shown_in(signal: str) -> str:
        largest = max(
            score.mean(signal) for of_case in scores.values() for score in of_case.values()
        )
        return value(largest, JUDGED[signal]).split(" ", 1)[-1]

    def entry(score: Score, signal: str) -> str:
        scale = factor(JUDGED[signal], units[signal])
        return f"{scale * score.mean(signal):.3f} ± {scale * score.spread(signal):.3f}"

    units = {signal: shown_in(signal) for signal in JUDGED}
    headers = [what, *(f"{LABELS[signal]} [{unit}]" for signal, unit in units.items()), "mean NIS"]
    rows = [
        [f"{case}, {name}", *(entry(score, signal) for signal in JUDGED), f"{score.nis.mean():.3f}"]
        for case, of_case in scores.items()
        for name, score in of_case.items()
    ]
    return table(f"{title}: root mean square errors", headers, rows)


def _save(
    path: Path,
    scores: Mapping[str, Mapping[str, Score]],
    heights: list[float | None],
    first: int,
) -> None:
    """Write the error of each run: a row for each case and seed."""
    import numpy as np

    from ambkit.comparison import JUDGED
    from ambkit.files.tables import Table, write_table

    columns: dict[str, Any] = {}
    units = {"case": "1", "step": "m", "seed": "1"}
    count = len(next(iter(next(iter(scores.values())).values())).nis)
    columns["case"] = np.repeat(np.arange(len(scores), dtype=float), count)
    if None not in heights:
        columns["step"] = np.repeat(np.array(heights, dtype=float), count)
    columns["seed"] = np.tile(np.arange(first, first + count, dtype=float), len(scores))
    for name in next(iter(scores.values())):
        for signal, unit in JUDGED.items():
            key = f"{name}_{signal}"
            units[key] = unit
            columns[key] = np.concatenate([case[name].rmse[signal] for case in scores.values()])
        units[f"{name}_nis"] = "1"
        columns[f"{name}_nis"] = np.concatenate([case[name].nis for case in scores.values()])
    write_table(path, Table(columns, {k: units[k] for k in columns}, {"cases": list(scores)}))
