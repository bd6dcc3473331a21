"""The part of ``ambkit identify`` that fits the force law to points at which a rotor lifts off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    import numpy as np

    from ambkit.cli import output
    from ambkit.cli.output import value
    from ambkit.data.reading import load
    from ambkit.identification.forces.lift_off import find_lift_off, load_points
    from ambkit.identification.forces.lift_off_fit import fit_lift_off
    from ambkit.show import plots

    if out is not None and working_point is None:
        raise AmbkitError("--out needs --working-point: which distance is x = 0?")
    if known.magnet.type != "one-sided":
        raise AmbkitError(
            f"lift-off points tell of a one-sided magnet; that of {known.name} is two-sided"
        )
    low, high = read_quantities(gap_range or "0 m,1 m", "m", "--gap-range", count=2)
    if recorded:
        with output.progress("reading", len(paths)) as done:
            points = []
            for run, path in enumerate(paths, 1):
                points.append(find_lift_off(load(path, channel_map), run))
                done()
    else:
        points = load_points(paths[0])
    fit = fit_lift_off(
        points,
        known.rotor.mass,
        gap_range=(low, high if gap_range else math.inf),
    )
    errors = fit.standard_errors
    rms = np.sqrt(np.mean(fit.residuals**2))
    data: dict[str, Any] = {
        "magnet_constant": fit.magnet_constant,
        "gap_offset": fit.gap_offset,
        "standard_errors": dict(errors),
        "residual_rms": rms,
        "points": len(fit.points),
        "left_out": dict(fit.left_out),
    }
    rows = [
        ["magnet constant k", value(fit.magnet_constant, CONSTANT)],
        [
            "  standard error",
            value(errors["magnet_constant"], CONSTANT, 2, like=fit.magnet_constant),
        ],
        ["gap offset z_off", value(fit.gap_offset, "m")],
        ["  standard error", value(errors["gap_offset"], "m", 2, like=fit.gap_offset)],
        ["current left unexplained", f"{value(rms, 'A')} rms"],
        ["points", f"{len(fit.points)} used, {len(fit.left_out)} left out"],
    ]
    found = known
    if working_point is not None:
        gap, bias = fit.working_point(working_point)
        found = known.replace(
            **known.magnet.with_constant(fit.magnet_constant),
            magnet__air_gap=gap,
            magnet__bias_current=bias,
        )
        data |= {"air_gap": gap, "bias_current": bias}
        rows += [
            [f"air gap at {value(working_point, 'm')}", value(gap, "m")],
            ["bias current there", value(bias, "A")],
        ]
    left = [
        [paths[run - 1].name if recorded else f"run {run}", why]
        for run, why in sorted(fit.left_out.items())
    ]
    shown = [output.table("F = k (i / (z + z_off))²", ["", ""], rows)]
    if left:
        shown.append(output.table("Points left out", ["", ""], left, wide=True))
    output.deliver(
        data,
        shown,
        [
            (out, found.save),
            (plot, lambda path: plots.save_figure(plots.lift_off_figure(fit), path)),
        ],
        as_json=json,
    )
