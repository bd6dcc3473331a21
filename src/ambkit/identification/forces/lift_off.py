"""The point at which a rotor lifts off, found in a recording with rising current.

The rotor lies at a distance z below a one-sided magnet while the current rises, until the magnet
carries the weight and the rotor flies up.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.data.files.tables import Table, read_table, write_table
from ambkit.identification.noise import measurement_noise
from ambkit.machine.bearing import GRAVITY

if TYPE_CHECKING:
    from ambkit.data.record import Record


SMOOTHING_TIME = 0.05
"""Time over which a parabola is laid through the positions to find the acceleration [s]."""

RESTING_TIME = 0.5  #: Time in the beginning during which it surely rests [s].

FLIGHT = 0.05
"""The rotor counts as flying where it accelerates upwards by more than this part of gravity."""


@dataclass(frozen=True)
class LiftOff:
    """One lift-off: the last instant at which the rotor was nearly at rest."""

    run: int  #: Number of the recording.
    gap: float  #: Distance z from the magnet [m].
    current: float  #: Coil current [A].
    acceleration: float  #: Acceleration along z, away from the magnet [m/s^2].
    resting_gap: float  #: Distance before it moved [m].
    #: Variance of the measured distance at rest [m^2]; NaN where it could not be seen.
    noise_variance: float
    problem: str = ""  #: Why it cannot be used; empty where it can.


def find_lift_off(record: Record, run: int = 0) -> LiftOff:
    """Find where the rotor lifts off in a recording with rising current."""
    # The rotor often creeps before it flies, so the distance at rest is not the one at which it
    # lifts off. Looked for is the last sample, before it has flown half the way, at which its
    # acceleration towards the magnet is below 5 % of gravity; acceleration, distance and current
    # are those of a parabola through the samples around (Savitzky and Golay, 1964).
    from scipy.signal import savgol_filter

    z, current, T = record["z"], record["i"], record.sampling_time
    width = max(5, 2 * round(SMOOTHING_TIME / T / 2) + 1)
    resting = float(np.median(z[: max(width, round(RESTING_TIME / T))]))
    contact = int(np.argmax(z < 0.5 * resting))
    if np.isnan(z).any() or np.isnan(current).any():
        return _unusable(run, "samples are missing")
    if contact == 0:
        return _unusable(run, "it does not fly up")
    if contact < 2 * width:
        return _unusable(run, "the recording does not show it at rest")
    z, current = z[:contact], current[:contact]
    acceleration = savgol_filter(z, width, 2, deriv=2, delta=T)
    resting_still = np.flatnonzero(acceleration > -FLIGHT * GRAVITY)
    at = int(resting_still[-1]) if resting_still.size else 0
    return LiftOff(
        run=run,
        gap=float(savgol_filter(z, width, 2)[at]),
        current=float(savgol_filter(current, width, 2)[at]),
        acceleration=float(acceleration[at]),
        resting_gap=resting,
        noise_variance=_noise(record.between(None, record.t[at])),
        problem=_problem(z, at),
    )


def _unusable(run: int, problem: str) -> LiftOff:
    return LiftOff(run, math.nan, math.nan, math.nan, math.nan, math.nan, problem)


def _noise(standstill: Record) -> float:
    try:
        return measurement_noise(standstill, "z").variance
    except RecordError:
        return math.nan


def _problem(z: Array, at: int) -> str:
    if z[0] == z.max() and (z == z[0]).mean() > 0.5:
        return "it rests beyond the range of the sensor"
    if at >= z.size - 2:
        return "samples are missing where it takes off"
    return ""


COLUMNS = {
    "run": "1", "z": "m", "i": "A", "a": "m/s^2", "z_rest": "m", "noise": "m^2",
}  # fmt: skip
"""Columns of a table of lift-off points: the numbers of `LiftOff`, in its order."""


def save_points(path: str | os.PathLike[str], points: Iterable[LiftOff]) -> None:
    """Write lift-off points as ``.csv`` or ``.parquet``."""
    points = list(points)
    numbers = np.array([astuple(p)[:-1] for p in points], dtype=np.float64)
    columns = {name: numbers[:, k] for k, name in enumerate(COLUMNS)}
    problems = {str(p.run): p.problem for p in points if p.problem}
    write_table(path, Table(columns, COLUMNS, {"problems": problems}))


def load_points(path: str | os.PathLike[str]) -> list[LiftOff]:
    """Read what `save_points` wrote."""
    table = read_table(path)
    lacking = [name for name in COLUMNS if name not in table.columns]
    if lacking:
        raise RecordError(f"{path}: has no column {lacking[0]}; it has {', '.join(table.columns)}")
    problems = table.meta.get("problems", {})
    rows = zip(*(table.columns[name].tolist() for name in COLUMNS), strict=True)
    return [
        LiftOff(int(run), gap, current, acceleration, resting, noise, problems.get(f"{run:g}", ""))
        for run, gap, current, acceleration, resting, noise in rows
    ]
