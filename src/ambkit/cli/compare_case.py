"""``ambkit compare`` in a case: the same records for all, judged by all criteria."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import arguments_of_the_user, find_axis, find_machine

if TYPE_CHECKING:
    from ambkit.judge.comparison.score import Benches
    from ambkit.judge.comparison.study import Study
    from ambkit.machine.machine import Machine
    from ambkit.machine.magnets import MagnetModel


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
    verbose: bool


def in_case(name: str, case_name: str, chosen: str, request: Wanted) -> None:
    """Compare in a case, or in all of them, and deliver; see ``ambkit compare --help``."""
    from ambkit.cli import printing
    from ambkit.judge.comparison.candidates import expand, suited
    from ambkit.judge.comparison.study import pieces_of
    from ambkit.machine.forces.force_map import surface_in
    from ambkit.workflow.compare_steps import cases_called, compare_in_all, compare_in_case
    from ambkit.workflow.saved_filters import adequacy_of, save_filters

    bearing = find_machine(name)
    names = suited(expand(chosen), bearing)
    with arguments_of_the_user("--"):
        cases = cases_called(case_name, request.spread)
    options: dict[str, Any] = {
        "runs": request.runs,
        "budget": request.budget,
        "seed": request.seed,
        "spread": request.spread,
        "magnets": _magnets(bearing, names, request.expert),
        "plant": None
        if request.force_map is None
        else surface_in(request.force_map, find_axis(name)),
    }
    if len(cases) > 1:
        work = len(cases) * pieces_of(len(names), request.budget, whole=False)
        with printing.progress("learning", work) as done:
            all_of = compare_in_all(bearing, names, **options, done=done)
        _deliver(all_of, request)
        return
    with_report = request.report is not None
    with printing.progress("learning", pieces_of(len(names), request.budget, with_report)) as done:
        result = compare_in_case(bearing, case_name, names, **options, whole=with_report, done=done)
    more = {}
    if request.save_filters is not None:
        judged = adequacy_of(result)
        more = {"adequacy": {kind: printing.say_adequacy(of, kind) for kind, of in judged.items()}}
    _deliver(result, request, more)
    if request.save_filters is not None:
        left_out = save_filters(
            result, request.save_filters, bearing=name,
            magnets={} if request.expert is None else {"adaptive": request.expert},
        )  # fmt: skip
        for why in left_out.values():
            printing.note(f"note: {why}")
        printing.note(f"wrote {request.save_filters}")


def _magnets(bearing: Machine, names: Sequence[str], expert: Path | None) -> dict[str, MagnetModel]:
    from ambkit.estimate.experts import experts

    if expert is None:
        return {}
    if "adaptive" not in names:
        raise AmbkitError("--expert is for the estimator adaptive, which does not take part")
    return {"adaptive": experts(expert, bearing)}


def _deliver(result: Study | Benches, request: Wanted, more: dict[str, Any] | None = None) -> None:
    from ambkit.cli import printing

    printing.deliver_result(
        result,
        [(request.out, lambda path: _save(path, result))],
        as_json=request.as_json,
        verbose=request.verbose,
        plot=request.plot,
        report=request.report,
        more=more,
    )


def _save(path: Path, result: Study | Benches) -> None:
    """Write the figures of each run: a row for case and run, columns by estimator and criterion."""
    import numpy as np

    from ambkit.data.files.tables import Table, write_table
    from ambkit.judge.comparison.criteria import CRITERIA

    benches = result if isinstance(result, dict) else {result.bench.case.name: result.bench}
    gathered: dict[str, list[Any]] = {"case": [], "run": []}
    units = {"case": "1", "run": "1"}
    for place, bench in enumerate(benches.values()):
        count = bench.runs - bench.stopped
        gathered["case"].append(np.full(count, float(place)))
        gathered["run"].append(np.arange(count, dtype=float))
        for how, scores in (("default", bench.default), ("tuned", bench.tuned)):
            for name, score in scores.items():
                for criterion, values in score.figures.items():
                    key = f"{name}_{how}_{criterion}"
                    gathered.setdefault(key, []).append(values)
                    units[key] = CRITERIA[criterion].si
    first = next(iter(benches.values()))
    meta = {"bearing": first.bearing.name, "cases": list(benches), "seed": first.seed}
    columns = {key: np.concatenate(parts) for key, parts in gathered.items()}
    write_table(path, Table(columns, units, meta))
