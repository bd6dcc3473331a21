"""``ambkit assess --sweep``: a bearing's or a machine's loop, simulated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import read_quantities

if TYPE_CHECKING:
    from collections.abc import Collection
    from pathlib import Path

    from ambkit.machine.bearing import Bearing
    from ambkit.machine.machine import Machine
    from ambkit.simulation.controllers import Control
    from ambkit.simulation.scenario import PID


def deliver_sweep(
    plant: Bearing | Machine,
    filters: Collection[Any],
    controller: PID | Control | None,
    amplitudes: str,
    stepped: bool,
    plot: Path | None,
    json: bool,
    *,
    x: float | None = None,
    load: Any = None,
    axis: str | None = None,
    orbit: bool | float = False,
) -> None:
    """Sweep the simulated loop, and print how far it is from the linear one."""
    from ambkit.cli import output
    from ambkit.judge.loop.loop_of import zone_of
    from ambkit.show import plots
    from ambkit.workflow.sweeping import sweep

    sizes = read_quantities(amplitudes, "m", "--sweep")
    if len(filters) > 1:
        raise AmbkitError(f"--sweep is of one loop: give one --filter, not {len(filters)}")
    with output.progress("sweeping"):
        found = sweep(
            plant, filters, controller, amplitudes=sizes, axis=axis,
            kind="stepped-sine" if stepped else "multisine", x=x or 0.0, load=load or 0.0,
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
