"""The part of ``ambkit identify`` that fits the force law to points at which a rotor lifts off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.cli.options import CONSTANT, read_quantities

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing


def by_lift_off(
    paths: Sequence[Path],
    recorded: bool,
    channel_map: Path | None,
    known: Bearing,
    gap_range: str | None,
    working_point: float | None,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Fit the law to points of a table, or to those found in recordings, one each."""
    from ambkit.cli import output
    from ambkit.cli.output import value
    from ambkit.data.reading import load
    from ambkit.identification.forces.lift_off import find_lift_off, load_points
    from ambkit.show import plots
    from ambkit.workflow.identifying import check_lifts_off, identify_by_lift_off

    if out is not None and working_point is None:
        raise AmbkitError("--out needs --working-point: which distance is x = 0?")
    check_lifts_off(known)
    low, high = read_quantities(gap_range or "0 m,1 m", "m", "--gap-range", count=2)
    if recorded:
        with output.progress("reading", len(paths)) as done:
            points = []
            for run, path in enumerate(paths, 1):
                points.append(find_lift_off(load(path, channel_map), run))
                done()
    else:
        points = load_points(paths[0])
    found = identify_by_lift_off(
        known,
        points,
        gap_range=(low, high if gap_range else math.inf),
        working_point=working_point,
    )
    fit, magnet = found.fit, found.bearing.magnet
    errors = fit.standard_errors
    rows = [
        ["magnet constant k", value(fit.magnet_constant, CONSTANT)],
        [
            "  standard error",
            value(errors["magnet_constant"], CONSTANT, 2, like=fit.magnet_constant),
        ],
        ["gap offset z_off", value(fit.gap_offset, "m")],
        ["  standard error", value(errors["gap_offset"], "m", 2, like=fit.gap_offset)],
        ["current left unexplained", f"{value(fit.residual_rms, 'A')} rms"],
        ["points", f"{len(fit.points)} used, {len(fit.left_out)} left out"],
    ]
    if working_point is not None:
        rows += [
            [f"air gap at {value(working_point, 'm')}", value(magnet.air_gap, "m")],
            ["bias current there", value(magnet.bias_current, "A")],
        ]
    left = [
        [paths[run - 1].name if recorded else f"run {run}", why]
        for run, why in sorted(fit.left_out.items())
    ]
    shown = [output.table("F = k (i / (z + z_off))²", ["", ""], rows)]
    if left:
        shown.append(output.table("Points left out", ["", ""], left, wide=True))
    output.deliver(
        found.to_dict(),
        shown,
        [
            (out, found.bearing.save),
            (plot, lambda path: plots.save_figure(plots.lift_off_figure(fit), path)),
        ],
        as_json=json,
    )
