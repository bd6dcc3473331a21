"""``ambkit compare`` in a case: the same records for all, judged by all criteria."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.bearing import Bearing
    from ambkit.comparison.bench import Bench, Standing
    from ambkit.comparison.study import Study
    from ambkit.magnets import StiffnessSource

SHOWN = ("x", "v", "f_d", "nees", "nis", "delay", "tracking", "effort", "lost", "cost")


def in_case(
    bearing: Bearing,
    case_name: str,
    chosen: str,
    *,
    runs: int,
    budget: int,
    seed: int,
    spread: float | None,
    expert: Path | None,
    out: Path | None,
    plot: Path | None,
    report: Path | None,
    as_json: bool,
) -> None:
    """Compare in a case, and deliver; see ``ambkit compare --help``."""
    from ambkit import plots
    from ambkit.commands import output
    from ambkit.commands.family import read_expert
    from ambkit.comparison import figures
    from ambkit.comparison.cases import CASES
    from ambkit.comparison.contenders import expand
    from ambkit.comparison.spread import Spread
    from ambkit.comparison.study import pieces_of, study

    names = expand(chosen)
    case = CASES[case_name]
    if spread is not None:
        if not 0 <= spread < 1:
            raise AmbkitError(f"--spread must be from 0 to below 100 %, is {100 * spread:g} %")
        case = replace(case, spread=Spread.all(spread))
    sources: dict[str, StiffnessSource] = {}
    if expert is not None:
        if "adaptive" not in names:
            raise AmbkitError("--expert is for the estimator adaptive, which does not take part")
        sources["adaptive"] = read_expert(expert, bearing)
    whole = report is not None
    with output.progress("learning", pieces_of(len(names), budget, whole)) as done:
        found = study(
            bearing, case, names, runs=runs, budget=budget, seed=seed, sources=sources,
            whole=whole, done=done,
        )  # fmt: skip
    bench = found.bench
    tables = [_table(bench, bench.best, "tuned alike" if bench.tuned else "defaults")]
    if bench.tuned:
        tables.insert(0, _table(bench, bench.default, "defaults"))
    output.deliver(
        _data(bench),
        [*tables, *_notes(bench)],
        [
            (out, lambda path: _save(path, bench)),
            (plot, lambda path: plots.save_figure(figures.matrix_figure(bench), path)),
            (report, lambda path: _write_report(path, found)),
        ],
        as_json=as_json,
    )


def _table(bench: Bench, standings: Mapping[str, Standing], how: str) -> Any:
    from ambkit.commands.output import table
    from ambkit.comparison.criteria import CRITERIA

    def entry(standing: Standing, name: str) -> str:
        import math

        value = CRITERIA[name].factor * standing.mean(name)
        half = CRITERIA[name].factor * standing.half_width(name)
        if not math.isfinite(value):
            return "–"
        if name in ("x", "v", "f_d") and math.isfinite(half):
            return f"{value:.3g} ± {half:.1g}"
        return f"{value:.3g}"

    heads = [f"{c.label} [{c.unit}]" if c.unit else c.label for c in map(CRITERIA.get, SHOWN) if c]
    rows = [[name, *(entry(s, shown) for shown in SHOWN)] for name, s in standings.items()]
    title = f"{bench.bearing.name}, {bench.case.name}: {bench.case.title}; {bench.runs} runs, {how}"
    return table(title, ["", *heads], rows)


def _notes(bench: Bench) -> list[str]:
    from ambkit.commands.output import value

    notes = []
    if bench.stopped:
        notes.append(f"{bench.stopped} runs left out: the rotor met a stop")
    if bench.limit:
        x, v, f_d = (
            value(bench.limit[signal], unit)
            for signal, unit in (("x", "m"), ("v", "m/s"), ("f_d", "N"))
        )
        notes.append(f"no estimator can have smaller errors than: x {x}, v {v}, F_St {f_d}")
    return notes


def _data(bench: Bench) -> dict[str, Any]:
    def figures(standing: Standing) -> dict[str, Any]:
        data: dict[str, Any] = {
            name: {"mean": standing.mean(name), "half_width": standing.half_width(name)}
            for name in standing.figures
        }
        data["values"] = dict(standing.values)
        if standing.tuning is not None:
            data["objective"] = {
                "default": standing.tuning.default,
                "tuned": standing.tuning.objective,
                "evaluations": standing.tuning.evaluations,
            }
        return data

    return {
        "bearing": bench.bearing.name,
        "case": bench.case.name,
        "runs": bench.runs,
        "stopped": bench.stopped,
        "seed": bench.seed,
        "budget": bench.budget,
        "limit": dict(bench.limit),
        "estimators": {
            name: {
                "label": standing.label,
                "default": figures(standing),
                "tuned": figures(bench.tuned[name]) if bench.tuned else None,
            }
            for name, standing in bench.default.items()
        },
    }


SI = {"x": "m", "v": "m/s", "f_d": "N", "force": "N", "delay": "s", "tracking": "m", "effort": "A",
      "settling": "s", "cost": "s"}  # fmt: skip


def _save(path: Path, bench: Bench) -> None:
    """Write the figures of each run: a row for each run, a column for estimator and criterion."""
    import numpy as np

    from ambkit.files.tables import Table, write_table

    count = len(next(iter(next(iter(bench.default.values())).figures.values())))
    columns: dict[str, Any] = {"run": np.arange(count, dtype=float)}
    units = {"run": "1"}
    for how, standings in (("default", bench.default), ("tuned", bench.tuned)):
        for name, standing in standings.items():
            for criterion, values in standing.figures.items():
                key = f"{name}_{how}_{criterion}"
                columns[key], units[key] = values, SI.get(criterion, "1")
    meta = {"bearing": bench.bearing.name, "case": bench.case.name, "seed": bench.seed}
    write_table(path, Table(columns, units, meta))


def _write_report(path: Path, found: Study) -> None:
    from ambkit import files
    from ambkit.comparison.report import report_of
    from ambkit.report import static
    from ambkit.report.page import render_page

    whole = report_of(found)
    pictures = {figure.id: static.render(figure) for figure in whole.figures}
    files.write_text(path, render_page(whole, pictures))
