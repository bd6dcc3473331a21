"""The part of ``ambkit identify`` that fits the force law to points at which a rotor lifts off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.cli.parameters import read_quantities

if TYPE_CHECKING:
    from ambkit.machine.machine import Bearing


def by_lift_off(
    paths: Sequence[Path],
    recorded: bool,
    channel_map: Path | None,
    known: Bearing,
    gap_range: str | None,
    operating_point: float | None,
    out: Path | None,
    plot: Path | None,
    json: bool,
) -> None:
    """Fit the law to points of a table, or to those found in recordings, one each."""
    from ambkit.cli import printing
    from ambkit.data.reading import load
    from ambkit.identification.forces.lift_off import find_lift_off, load_points
    from ambkit.workflow.identify import check_lifts_off, identify_by_lift_off

    if out is not None and operating_point is None:
        raise AmbkitError("--out needs --operating-point: which distance is x = 0?")
    check_lifts_off(known)
    low, high = read_quantities(gap_range or "0 m,1 m", "m", "--gap-range", count=2)
    if recorded:
        with printing.progress("reading", len(paths)) as done:
            points = []
            for run, path in enumerate(paths, 1):
                points.append(find_lift_off(load(path, channel_map), run))
                done()
    else:
        points = load_points(paths[0])
    result = identify_by_lift_off(
        known,
        points,
        gap_range=(low, high if gap_range else math.inf),
        operating_point=operating_point,
        names=[path.name for path in paths] if recorded else (),
    )
    printing.deliver_result(result, [(out, result.bearing.save)], as_json=json, plot=plot)
