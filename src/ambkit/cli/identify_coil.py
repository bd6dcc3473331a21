"""The part of ``ambkit identify`` that finds a coil from steps of its control signal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.machine.machine import Bearing

WORDS = {
    "gain": ("gain G", "A/V"),
    "dead_zone": ("dead zone u0", "V"),
    "far_time": ("time constant far away, a", "s"),
    "near_time": ("more at the magnet, b", "s"),
    "length": ("falls within, c", "m"),
    "delay": ("delay", "s"),
    "zero": ("current's sensor shows at none", "A"),
}
"""What the figures of a coil are called, and their units."""


def by_coil(
    paths: Sequence[Path],
    channel_map: Path | None,
    begin: float | None,
    end: float | None,
    known: Bearing,
    working_point: float | None,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Find a coil, and write the bearing that is driven through it."""
    from ambkit.base import files
    from ambkit.base.units import engineering
    from ambkit.cli import output
    from ambkit.cli.logs import load_log
    from ambkit.cli.output import value
    from ambkit.identification.coil import fit_coil
    from ambkit.show import plots
    from ambkit.show.plots.coil import coil_figure

    if out is not None and working_point is None:
        raise AmbkitError("--out needs --working-point: the lag depends on where the rotor is")
    records = [load_log(path, channel_map, begin, end) for path in paths]
    names = [path.name for path in paths]
    with output.progress("fitting") as done:
        fit = fit_coil(records, names, note=done)
    rows = [
        [
            words,
            value(getattr(fit.coil, name), unit),
            value(fit.standard_errors[name], unit, 2, like=getattr(fit.coil, name)),
        ]
        for name, (words, unit) in WORDS.items()
    ]
    if working_point is not None:
        tau = float(fit.coil.time_constant(working_point))
        rows.append([f"time constant at {value(working_point, 'm')}", value(tau, "s"), ""])
    logs = [
        [name, value(fit.distance[name], "m"), value(fit.each[name], "A", 3),
         value(fit.left_out.get(name), "A", 3)]
        for name in sorted(names, key=lambda name: fit.distance[name])
    ]  # fmt: skip
    shown: list[Any] = [
        output.table("tau di/dt = G (u - u0) - i, i >= 0", ["", "found", "std. error"], rows),
        output.table("Current left unexplained, rms",
                     ["log", "distance", "found from it", "found without it"], logs),
        f"In all {value(fit.residual_rms, 'A', 3)} rms; noise of the current "
        f"{value(fit.noise, 'A', 3)} rms. Resistance and voltage go together in G, resistance "
        "and inductance in the time constant: control and current do not tell them apart.",
    ]  # fmt: skip
    bearing = None if working_point is None else fit.bearing(known, working_point)
    zero = fit.offset(known)
    data = fit.to_dict() | {"control_offset": zero}

    def write(path: Path) -> None:
        if bearing is not None:
            offset = engineering(zero, "V", digits=6)
            said = (
                "# Driven by the control signal, through a coil that was identified. In its map:\n"
                f'# [signals.u] offset = "{offset}", so that 0 is the bias current.\n'
            )
            files.write_text(path, said + bearing.to_toml(path.parent))

    output.deliver(
        data,
        shown,
        [(out, write),
         (plot, lambda path: plots.save_figure(coil_figure(fit, records, names), path))],
        as_json=json,
    )  # fmt: skip
