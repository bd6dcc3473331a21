"""``ambkit tune --robust``: controller and filter over the machines of a study."""

from __future__ import annotations

from pathlib import Path


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
    output.deliver_result(found, [(out, found.save)], as_json=json, plot=plot)
    output.say_adequacy(found.adequacy)
    if out is not None and found.controller is not None:
        output.note(f"wrote {found.beside(out)}: the controller, for --scenario")
