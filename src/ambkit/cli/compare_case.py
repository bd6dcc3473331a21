"""``ambkit compare`` in a case: the same records for all, judged by all criteria."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import arguments_of_the_user, find_axis, find_machine

if TYPE_CHECKING:
    from ambkit.judge.comparison.bench import Bench, Standing
    from ambkit.judge.comparison.study import Study
    from ambkit.machine.machine import Machine
    from ambkit.machine.magnets import MagnetModel

SHOWN = ("x", "v", "f_d", "nees", "nis", "delay", "tracking", "effort", "lost", "cost")


class Wanted(NamedTuple):
    """What the user asked of a comparison."""

    runs: int
    budget: int
    seed: int
    spread: float | None
    expert: Path | None
    force_map: Path | None
    out: Path | None
    plot: Path | None
    report: Path | None
    save_filters: Path | None
    as_json: bool


def in_case(name: str, case_name: str, chosen: str, wanted: Wanted) -> None:
    """Compare in a case, or in all of them, and deliver; see ``ambkit compare --help``."""
    from ambkit.cli import output
    from ambkit.cli.kinds import surface_in
    from ambkit.judge.comparison.contenders import expand, suited
    from ambkit.judge.comparison.study import pieces_of
    from ambkit.workflow.comparing import cases_called, compare_in_all, compare_in_case
    from ambkit.workflow.saved_filters import save_filters

    bearing = find_machine(name)
    names = suited(expand(chosen), bearing)
    with arguments_of_the_user("--"):
        cases = cases_called(case_name, wanted.spread)
    options: dict[str, Any] = {
        "runs": wanted.runs,
        "budget": wanted.budget,
        "seed": wanted.seed,
        "spread": wanted.spread,
        "magnets": _magnets(bearing, names, wanted.expert),
        "plant": None
        if wanted.force_map is None
        else surface_in(wanted.force_map, find_axis(name)),
    }
    if len(cases) > 1:
        work = len(cases) * pieces_of(len(names), wanted.budget, whole=False)
        with output.progress("learning", work) as done:
            _deliver_all(bearing, compare_in_all(bearing, names, **options, done=done), wanted)
        return
    whole = wanted.report is not None
    with output.progress("learning", pieces_of(len(names), wanted.budget, whole)) as done:
        found = compare_in_case(bearing, case_name, names, **options, whole=whole, done=done)
    _deliver(found, wanted)
    if wanted.save_filters is not None:
        left_out = save_filters(
            found, wanted.save_filters, bearing=name,
            magnets={} if wanted.expert is None else {"adaptive": wanted.expert},
        )  # fmt: skip
        for why in left_out.values():
            output.note(f"note: {why}")
        output.note(f"wrote {wanted.save_filters}")


def _magnets(bearing: Machine, names: Sequence[str], expert: Path | None) -> dict[str, MagnetModel]:
    from ambkit.cli.kinds import experts

    if expert is None:
        return {}
    if "adaptive" not in names:
        raise AmbkitError("--expert is for the estimator adaptive, which does not take part")
    return {"adaptive": experts(expert, bearing)}


def _deliver(found: Study, wanted: Wanted) -> None:
    from ambkit.cli import output
    from ambkit.result.report.page import write_page
    from ambkit.show import plots
    from ambkit.show.pages.study import report_of
    from ambkit.show.plots.study import matrix_figure
    from ambkit.workflow.saved_filters import adequacy_of

    bench = found.bench
    tables = [_table(bench, bench.best, "tuned alike" if bench.tuned else "defaults")]
    if bench.tuned:
        tables.insert(0, _table(bench, bench.default, "defaults"))
    data = bench.to_dict()
    if wanted.save_filters is not None:
        judged = adequacy_of(found)
        data["adequacy"] = {kind: output.say_adequacy(of, kind) for kind, of in judged.items()}
    output.deliver(
        data,
        [*tables, *_notes(bench)],
        [
            (wanted.out, lambda path: _save(path, {bench.case.name: bench})),
            (wanted.plot, lambda path: plots.save_figure(matrix_figure(bench, alone=True), path)),
            (wanted.report, lambda path: write_page(report_of(found), path)),
        ],
        as_json=wanted.as_json,
    )


def _deliver_all(bearing: Machine, benches: Mapping[str, Bench], wanted: Wanted) -> None:
    from ambkit.cli import output
    from ambkit.result.report.page import write_page
    from ambkit.show import plots
    from ambkit.show.pages.study import report_of_cases
    from ambkit.show.plots.study import cases_figure

    first = next(iter(benches.values()))
    rows = [
        [name, *(f"{bench.best[name].mean('f_d'):.3g}" for bench in benches.values())]
        for name in first.best
    ]
    how = "tuned alike" if first.tuned else "defaults"
    title = f"{bearing.name}: error of F_St [N], {first.runs} runs in each case, {how}"
    output.deliver(
        {"bearing": bearing.name, "cases": {name: b.to_dict() for name, b in benches.items()}},
        [output.table(title, ["", *benches], rows)],
        [
            (wanted.out, lambda path: _save(path, benches)),
            (wanted.plot, lambda path: plots.save_figure(cases_figure(benches, alone=True), path)),
            (wanted.report, lambda path: write_page(report_of_cases(benches), path)),
        ],
        as_json=wanted.as_json,
    )


def _table(bench: Bench, standings: Mapping[str, Standing], how: str) -> Any:
    from ambkit.base.units import with_error
    from ambkit.cli.output import table
    from ambkit.judge.comparison.criteria import CRITERIA

    def entry(standing: Standing, name: str) -> str:
        import math

        value = CRITERIA[name].factor * standing.mean(name)
        half = CRITERIA[name].factor * standing.half_width(name)
        if not math.isfinite(value):
            return "–"
        if name in ("x", "v", "f_d") and math.isfinite(half):
            return with_error(value, half)
        return f"{value:.3g}"

    heads = [f"{c.label} [{c.unit}]" if c.unit else c.label for c in map(CRITERIA.get, SHOWN) if c]
    rows = [[name, *(entry(s, shown) for shown in SHOWN)] for name, s in standings.items()]
    title = f"{bench.bearing.name}, {bench.case.name}: {bench.case.title}; {bench.runs} runs, {how}"
    return table(title, ["", *heads], rows)


def _notes(bench: Bench) -> list[str]:
    from ambkit.cli.output import value

    notes = []
    if bench.stopped:
        notes.append(f"{bench.stopped} runs left out: the rotor met a stop")
    notes.append(f"the raw sensors err by {value(bench.raw, 'm')}")
    if bench.limit:
        x, v, f_d = (
            value(bench.limit[signal], unit)
            for signal, unit in (("x", "m"), ("v", "m/s"), ("f_d", "N"))
        )
        notes.append(f"no estimator can have smaller errors than: x {x}, v {v}, F_St {f_d}")
    return notes


SI = {"x": "m", "v": "m/s", "f_d": "N", "force": "N", "delay": "s", "tracking": "m", "effort": "A",
      "settling": "s", "cost": "s"}  # fmt: skip


def _save(path: Path, benches: Mapping[str, Bench]) -> None:
    """Write the figures of each run: a row for case and run, columns by estimator and criterion."""
    import numpy as np

    from ambkit.data.files.tables import Table, write_table

    gathered: dict[str, list[Any]] = {"case": [], "run": []}
    units = {"case": "1", "run": "1"}
    for place, bench in enumerate(benches.values()):
        count = bench.runs - bench.stopped
        gathered["case"].append(np.full(count, float(place)))
        gathered["run"].append(np.arange(count, dtype=float))
        for how, standings in (("default", bench.default), ("tuned", bench.tuned)):
            for name, standing in standings.items():
                for criterion, values in standing.figures.items():
                    key = f"{name}_{how}_{criterion}"
                    gathered.setdefault(key, []).append(values)
                    units[key] = SI.get(criterion, "1")
    first = next(iter(benches.values()))
    meta = {"bearing": first.bearing.name, "cases": list(benches), "seed": first.seed}
    columns = {key: np.concatenate(parts) for key, parts in gathered.items()}
    write_table(path, Table(columns, units, meta))
