"""Identification of a one-sided magnet from lift-off points."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ambkit.arguments import machine_argument, pair_argument
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si, names_in
from ambkit.base.units import engineering
from ambkit.data.reading import load
from ambkit.identification.forces.lift_off import (
    LiftOffFit,
    find_lift_off,
    fit_lift_off,
    lift_off_figure,
    load_points,
)
from ambkit.machine.axes import isolated
from ambkit.machine.machine import Machine
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section


@dataclass(frozen=True, eq=False, repr=False)
class LiftedOff(Result):
    """A machine identified from lift-off points."""

    #: Machine with the identified constant, and the air gap and bias current of the operating
    #: point, if there is one.
    machine: Machine
    fit: LiftOffFit  #: Fit of the force law.
    operating_point: float | None  #: Distance at x = 0 [m].
    names: Sequence[str] = ()  #: Names of the recordings; empty for a table of points.

    TITLE = "Lift-off of {0.machine.name}"

    @property
    def finding(self) -> str:
        return f"{self.machine.name}: magnet constant {self.rows[0].text()}."

    @property
    def rows(self) -> list[Row]:
        fit, magnet, errors = self.fit, self.machine.magnet, self.fit.standard_errors
        results = [
            Row("magnet_constant", "magnet constant k", fit.magnet_constant, "N m^2/A^2",
                error=errors["magnet_constant"], symbol="k"),
            Row("gap_offset", "gap offset z_off", fit.gap_offset, "m", error=errors["gap_offset"],
                symbol="z_off"),
            Row("residual_rms", "residual current, rms", fit.residual_rms, "A"),
            Row("points", "points", len(fit.points)),
            Row("points_left_out", "points left out", len(fit.left_out)),
        ]  # fmt: skip
        if self.operating_point is not None:
            at = engineering(self.operating_point, "m", 4)
            results += [
                Row("air_gap", f"air gap at {at}", magnet.air_gap, "m"),
                Row("bias_current", "bias current there", magnet.bias_current, "A"),
            ]
        return results

    SECTIONS = {(): Section("F = k (i / (z + z_off))²")}

    @property
    def notes(self) -> list[str]:
        return [
            f"{self.names[run - 1] if self.names else f'run {run}'}: {why}"
            for run, why in sorted(self.fit.left_out.items())
        ]

    @property
    def series(self) -> dict[str, Any]:
        return {"left_out": dict(self.fit.left_out)}

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        if self.operating_point is None:
            raise AmbkitError("operating_point is missing: which distance is x = 0?")
        self.machine.save(path)

    def figures(self) -> list[Figure]:
        return [lift_off_figure(self.fit)]


def check_lifts_off(machine: Machine) -> None:
    """Reject a machine whose magnet lift-off points cannot identify."""
    if machine.magnet.type != "one-sided":
        raise AmbkitError(
            f"lift-off points need a one-sided magnet; that of {machine.name} is two-sided"
        )
    if machine.rotor.gravity != "-x":
        raise AmbkitError(
            f"lift-off points need a rotor that gravity pulls straight away from the magnet; "
            f"that of {machine.name} is inclined"
        )


def lift_off(
    machine: Any, records: Any, axis: str | None, channels: Any, *, gap: Any, operating_point: Any,
    note: Callable[[str], None],
) -> LiftedOff:  # fmt: skip
    """Fit the law to points of a table, or to one from each recording."""
    known = isolated(machine_argument(machine), axis)
    check_lifts_off(known)
    paths = [Path(path) for path in names_in(records=records)]
    ends = 0.0, math.inf
    if gap is not None:
        ends = tuple(pair_argument("gap", gap, 'lengths such as "4 mm,16 mm"'))
    if channels is None:
        if len(paths) > 1:
            raise AmbkitError("points are one table; recordings need a channel map")
        points = load_points(paths[0])
    else:
        points = []
        for run, path in enumerate(paths, 1):
            note(f"reading {path.name}")
            points.append(find_lift_off(load(path, channels), run))
    near, far = (in_si("gap", end, "m") for end in ends)
    distance = in_si("operating_point", operating_point, "m")
    fit = fit_lift_off(points, known.rotor.mass, gap_range=(near, far))
    names = () if channels is None else [path.name for path in paths]
    if distance is None:
        return LiftedOff(known, fit, None, names)
    air_gap, bias = fit.operating_point(distance)
    result = known.replace(
        **known.magnet.with_constant(fit.magnet_constant),
        magnet__air_gap=air_gap, magnet__bias_current=bias,
    )  # fmt: skip
    return LiftedOff(result, fit, distance, names)
