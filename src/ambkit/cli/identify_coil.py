"""The part of ``ambkit identify`` that finds a coil from steps of its control signal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError

if TYPE_CHECKING:
    from ambkit.machine.machine import Bearing


def by_coil(
    paths: Sequence[Path],
    channel_map: Path | None,
    begin: float | None,
    end: float | None,
    known: Bearing,
    operating_point: float | None,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Find a coil, and write the bearing that is driven through it."""
    from dataclasses import replace

    from ambkit.base import files
    from ambkit.base.units import engineering
    from ambkit.cli import printing
    from ambkit.cli.record_arguments import load_log
    from ambkit.identification.coil import fit_coil

    if out is not None and operating_point is None:
        raise AmbkitError("--out needs --operating-point: the lag depends on where the rotor is")
    records = [load_log(path, channel_map, begin, end) for path in paths]
    names = [path.name for path in paths]
    with printing.progress("fitting") as done:
        fit = replace(
            fit_coil(records, names, note=done), known=known, operating_point=operating_point
        )
    bearing = None if operating_point is None else fit.bearing(known, operating_point)

    def write(path: Path) -> None:
        if bearing is not None:
            offset = engineering(fit.offset(known), "V", digits=6)
            header = (
                "# Driven by the control signal, through a coil that was identified. In its map:\n"
                f'# [signals.u] offset = "{offset}", so that 0 is the bias current.\n'
            )
            files.write_text(path, header + bearing.to_toml(path.parent))

    printing.deliver_result(fit, [(out, write)], as_json=json, plot=plot)
