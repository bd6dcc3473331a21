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
    from ambkit.workflow.sweeping import sweep

    sizes = read_quantities(amplitudes, "m", "--sweep")
    query.check_one("--sweep")
    with output.progress("sweeping"):
        found = sweep(
            query.machine, query.filters, query.controller, amplitudes=sizes, axis=axis,
            kind="stepped-sine" if stepped else "multisine", x=query.x, load=query.load,
            orbit=orbit,
        )  # fmt: skip
    output.deliver_result(found, as_json=json, plot=plot)
