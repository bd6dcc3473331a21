"""``ambkit torture``: estimators through faults, in the loop and beside it."""

from __future__ import annotations

import math
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
    file_option,
    find_machine,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ambkit.judge.faults.campaign import Torture
    from ambkit.judge.faults.flight import Outcome

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
    from ambkit.show import plots
    from ambkit.show.plots.torture import torture_figure

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
    output.deliver(
        found.to_dict() | {"seeds": [seed, seed + runs - 1]},
        [_of_estimators(found, runs), _of_faults(found), *_failed(found)],
        [
            (out, lambda path: _save(path, found)),
            (plot, lambda path: plots.save_figure(torture_figure(found), path)),
        ],
        as_json=json,
    )


def _of_estimators(found: Torture, runs: int) -> Any:
    """A row for each estimator, the controller alone at last."""
    from ambkit.cli.output import table, value
    from ambkit.judge.faults.campaign import BASELINE

    rows = []
    for name in [*found.estimators, BASELINE]:
        beside = found.select(estimator=name, setting="beside the loop")
        flown = found.select(estimator=name, setting="in the loop")
        lost = [each for each in flown if each.levitation == "lost"]
        back = sum(each.recovered for each in beside)
        rows.append([
            name,
            f"{back} of {len(beside)}" if beside else "–",
            _samples(found.slowest(name)) if beside else "–",
            *_worst(beside),
            f"{sum(each.levitation == 'kept' for each in flown)} of {len(flown)}",
            str(sum(each.levitation == "touched" for each in flown)),
            str(len(lost)),
            value(max(each.at_stop for each in flown), "s"),
        ])  # fmt: skip
    campaigns = "1 seed" if runs == 1 else f"{runs} seeds"
    return table(
        f"{found.bearing.name}, {campaigns}: beside the loop, and in it",
        ["", "back", "after samples", "off by x", "off by F_St", "stayed up", "touched", "lost",
         "longest at a stop"],
        rows,
    )  # fmt: skip


def _samples(count: float) -> str:
    return "never" if math.isinf(count) else "–" if math.isnan(count) else f"{count:.0f}"


def _worst(outcomes: Sequence[Outcome]) -> list[str]:
    """Greatest errors of position and force once the fault is over."""
    from ambkit.cli.output import value

    def greatest(name: str, unit: str) -> str:
        all_of = [getattr(each, name) for each in outcomes]
        if any(math.isinf(each) for each in all_of):
            return "∞"
        return value(max((e for e in all_of if not math.isnan(e)), default=math.nan), unit, 3)

    return [greatest("after_x", "m"), greatest("after_f_d", "N")]


def _of_faults(found: Torture) -> Any:
    """A row for each fault: who takes longest, and who goes down."""
    from ambkit.cli.output import table
    from ambkit.judge.faults.campaign import BASELINE, recovery_text
    from ambkit.judge.faults.declared import CLEAN, FAULTS

    def slowest(fault: str, setting: str) -> str:
        of = {
            name: recovery_text(found.select(fault=fault, estimator=name, setting=setting))
            for name in found.estimators
        }
        of = {name: text for name, text in of.items() if text}
        bad = [name for name, text in of.items() if not text.isdigit()]
        if not of:
            return "–"
        if bad:
            said = ", ".join(f"{name} {of[name]}" for name in bad)
            return said if len(bad) <= 2 else f"{of[bad[0]]}: {len(bad)} of {len(of)}"
        name = max(of, key=lambda each: int(of[each]))
        return of[name] if of[name] == "0" or len(of) == 1 else f"{of[name]} ({name})"

    about = {CLEAN.name: CLEAN.about, "mixture": "up to three of them at a time, at random"}
    about |= {name: fault.about for name, fault in FAULTS.items()}
    rows = []
    for fault in found.faults:
        alone = recovery_text(found.select(fault=fault, estimator=BASELINE)) or "–"
        settings = ("beside the loop", "in the loop")
        rows.append([fault, *(slowest(fault, s) for s in settings), alone, about[fault]])
    return table(
        "Samples until back, the slowest",
        ["fault", "beside the loop", "in the loop", "controller alone", "what happens"],
        rows,
        wide=True,
    )


def _failed(found: Torture) -> list[str]:
    """Say who lost the rotor, and who did not come back."""
    said = []
    for name in found.estimators:
        lost = {e.fault for e in found.select(estimator=name, levitation="lost")
                if e.setting == "in the loop"}  # fmt: skip
        failed = {each.fault for each in found.failures if each.estimator == name}
        if lost:
            said.append(f"{name}: the rotor was lost in {', '.join(sorted(lost))}")
        if failed:
            said.append(f"{name}: did not come back from {', '.join(sorted(failed))}")
    return said or ["no rotor was lost, and all came back"]


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
