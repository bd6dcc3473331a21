"""``ambkit assess --sweep``: a machine's loop, simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambkit.cli.options import read_quantities

if TYPE_CHECKING:
    from pathlib import Path

    from ambkit.cli.loop_query import LoopQuery


def deliver_sweep(
    query: LoopQuery,
    amplitudes: str,
    stepped: bool,
    plot: Path | None,
    json: bool,
    *,
    axis: str | None = None,
    orbit: bool | float = False,
) -> None:
    """Sweep the simulated loop, and print how far it is from the linear one."""
    from ambkit.cli import output
    from ambkit.judge.loop.loop_of import zone_of
    from ambkit.show import plots
    from ambkit.workflow.sweeping import sweep

    sizes = read_quantities(amplitudes, "m", "--sweep")
    query.check_one("--sweep")
    with output.progress("sweeping"):
        found = sweep(
            query.machine, query.filters, query.controller, amplitudes=sizes, axis=axis,
            kind="stepped-sine" if stepped else "multisine", x=query.x, load=query.load,
            orbit=orbit,
        )  # fmt: skip
    rows = [
        [output.value(each.amplitude, "m"), f"{each.peak:.3f}", zone_of(each.peak),
         f"{100 * each.deviation:.2g} %", "yes" if each.limited else "no"]
        for each in found.swept
    ]  # fmt: skip
    model = found.model
    rows.append(["linear model", f"{model.peak:.3f}", model.zone, "–", "–"])
    heads = ["amplitude", "peak of |S|", "zone", "from the model, at most", "at a limit"]
    title = f"{found.name}, controller fed by {found.loop.name}: {found.kind} of the simulated loop"
    output.deliver(
        found.to_dict(),
        [output.table(title, heads, rows)],
        [(plot, lambda path: plots.save_figure(found.figure(), path))],
        as_json=json,
    )
