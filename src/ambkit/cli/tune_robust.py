"""``ambkit tune --robust``: controller and filter over the machines of a study."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def tune_robust(
    study: str,
    *,
    quantile: float,
    ceiling: float | None,
    free: str | None,
    storage: Path | None,
    evaluations: int,
    seed: int,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Search, and write filter, controller and picture."""
    from ambkit.cli import output
    from ambkit.judge.loop.loop_of import ZONE_A
    from ambkit.show import plots
    from ambkit.workflow.campaign import robust

    again = "nothing was kept: --storage FILE keeps what was tried"
    if storage is not None:
        again = f"what was tried is kept in {storage}, the same command goes on"
    with (
        output.interrupted_says(again),
        output.progress("tuning over the tolerances", evaluations, unit="evaluations") as done,
    ):
        found = robust.tune_robust(
            study, quantile=quantile, evaluations=evaluations, storage=storage, seed=seed,
            max_sensitivity=ZONE_A if ceiling is None else ceiling,
            free=None if free is None else free.replace(" ", "").split(","), done=done,
        )  # fmt: skip
    output.deliver(
        found.to_dict(),
        _tables(found),
        [
            (out, found.save),
            (plot, lambda path: plots.save_figure(found.figure(), path)),
        ],
        as_json=json,
    )
    output.say_adequacy(found.adequacy)
    if out is not None and found.controller is not None:
        output.note(f"wrote {found.beside(out)}: the controller, for --scenario")


def _tables(found: Any) -> list[Any]:
    from ambkit.cli.output import table, value

    before, after = found.tried[0], found.tried[found.taken]
    rows = [
        [each.name, value(each.default, each.unit), value(after.values[each.name], each.unit)]
        for each in found.free
    ]
    rows += [
        ["error of f_d", value(before.error, "N"), value(after.error, "N")],
        ["peak of |S|", f"{before.peak:.3f}", f"{after.peak:.3f}"],
    ]
    title = f"{found.kind} for {found.plan.study.name}: {100 * found.quantile:g} % are no worse"
    front = [
        [f"{each.peak:.3f}", value(each.error, "N"), "yes" if each.allowed else "no"]
        for each, on in sorted(zip(found.tried, found.front, strict=True), key=lambda e: e[0].peak)
        if on
    ]
    return [
        table(title, ["", "untuned", "tuned"], rows),
        table("Nothing is better in both", ["peak of |S|", "error of f_d", "allowed"], front),
    ]
