"""The point at which a rotor lifts off, found in a recording with rising current.

The rotor lies at a distance z below a one-sided magnet while the current rises, until the magnet
carries the weight and the rotor flies up.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass

import numpy as np

from ambkit.base.arrays import Array, rms
from ambkit.base.errors import RecordError
from ambkit.data.files.tables import Table, read_table
from ambkit.data.record import Record
from ambkit.identification.noise import measurement_noise
from ambkit.machine.parts import GRAVITY
from ambkit.result.report import Axis, Figure, Line, Panel, Points, Rule

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
    problem = ""
    if np.isnan(z).any() or np.isnan(current).any():
        problem = "samples are missing"
    elif contact == 0:
        problem = "it does not fly up"
    elif contact < 2 * width:
        problem = "the recording does not show it at rest"
    if problem:
        return LiftOff(run, *(math.nan,) * 5, problem)
    z, current = z[:contact], current[:contact]
    acceleration = savgol_filter(z, width, 2, deriv=2, delta=T)
    resting_still = np.flatnonzero(acceleration > -FLIGHT * GRAVITY)
    at = int(resting_still[-1]) if resting_still.size else 0
    if z[0] == z.max() and (z == z[0]).mean() > 0.5:
        problem = "it rests beyond the range of the sensor"
    elif at >= z.size - 2:
        problem = "samples are missing where it takes off"
    try:
        noise_variance = measurement_noise(record.between(None, record.t[at]), "z").variance
    except RecordError:
        noise_variance = math.nan
    return LiftOff(
        run=run,
        gap=float(savgol_filter(z, width, 2)[at]),
        current=float(savgol_filter(current, width, 2)[at]),
        acceleration=float(acceleration[at]),
        resting_gap=resting,
        noise_variance=noise_variance,
        problem=problem,
    )


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
    Table(columns, COLUMNS, {"problems": problems}).save(path)


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


@dataclass(frozen=True, eq=False)
class LiftOffFit:
    """The law ``F = k (i / (z + z_off))^2`` through n lift-off points."""

    magnet_constant: float  #: k [N m^2/A^2].
    gap_offset: float  #: z_off [m].
    #: Of ``magnet_constant`` and ``gap_offset``, in their units. They take the residuals for
    #: independent; where the law is not the right one they are too small.
    standard_errors: Mapping[str, float]
    residuals: Array  #: (n,) Measured current less that of the law [A], at `points`.
    weights: Array  #: (n,) Weight of each point, 1 or less for those far off the law.
    points: tuple[LiftOff, ...]  #: The points that were used.
    left_out: Mapping[int, str]  #: Number of the recordings that were not used, and why.
    mass: float  #: Mass of the rotor [kg].

    @property
    def residual_rms(self) -> float:
        """Current that the law leaves unexplained, root mean square [A]."""
        return rms(self.residuals)

    def current(self, gap: Array | float, acceleration: Array | float = 0.0) -> Array:
        """Return the current [A] that carries the rotor at the distances `gap` [m]."""
        force = self.mass * (GRAVITY - np.asarray(acceleration))
        return np.sqrt(force / self.magnet_constant) * (np.asarray(gap) + self.gap_offset)

    def operating_point(self, gap: float) -> tuple[float, float]:
        """Return effective air gap s0 [m] and bias current i0 [A] of a bearing at z = `gap` [m]."""
        return gap + self.gap_offset, float(self.current(gap))


def fit_lift_off(
    points: Iterable[LiftOff], mass: float, *, gap_range: tuple[float, float] = (0.0, math.inf)
) -> LiftOffFit:
    """Fit magnet constant and gap offset to lift-off points, by robust linear least squares."""
    # Points off the line weigh less, by Huber's function with 1.345 standard deviations, these from
    # the median of the residuals (Huber, 1981, chapter 7, for the standard errors too).
    low, high = gap_range
    outside = f"outside of {1e3 * low:g} to {1e3 * high:g} mm"
    points = list(points)
    used = [p for p in points if not p.problem and low <= p.gap <= high]
    left_out = {p.run: p.problem or outside for p in points if p not in used}
    if len(used) < 3:
        raise RecordError(
            f"{len(used)} lift-off points are left, at least 3 are needed: {left_out}"
        )
    gap, current, acceleration = np.array([(p.gap, p.current, p.acceleration) for p in used]).T
    root_force = np.sqrt(mass * (GRAVITY - acceleration))
    design = np.column_stack([gap, np.ones_like(gap)])
    line, covariance, weights = _robust_line(design, current / root_force)
    slope, intercept = line
    if slope <= 0:
        raise RecordError("the current at lift-off does not grow with the distance")
    constant, offset = slope**-2, intercept / slope
    gradient = np.array([[-2 * slope**-3, 0.0], [-intercept / slope**2, 1 / slope]])
    errors = np.sqrt(np.diag(gradient @ covariance @ gradient.T))
    return LiftOffFit(
        magnet_constant=float(constant),
        gap_offset=float(offset),
        standard_errors={"magnet_constant": float(errors[0]), "gap_offset": float(errors[1])},
        residuals=current - root_force * (design @ line),
        weights=weights,
        points=tuple(used),
        left_out=left_out,
        mass=mass,
    )


def _robust_line(design: Array, observed: Array) -> tuple[Array, Array, Array]:
    """Return coefficients (p,), their covariance (p, p), weights (n,) of Huber's estimate."""
    n, p = design.shape
    weights, line, residuals = np.ones(n), np.zeros(p), observed
    for _ in range(50):
        root = np.sqrt(weights)
        line = np.asarray(np.linalg.lstsq(root[:, None] * design, root * observed)[0])
        residuals = observed - design @ line
        size = np.maximum(np.abs(residuals), 1e-15 * np.abs(observed).max())
        limit = 1.345 * np.median(size) / 0.6745
        before, weights = weights, np.minimum(1.0, limit / size)
        if np.allclose(weights, before, rtol=1e-12, atol=0.0):
            break
    inside = float((weights == 1.0).mean())
    correction = 1 + p / n * (1 - inside) / inside
    variance = correction**2 * ((weights * residuals) ** 2).sum() / (n - p) / inside**2
    return line, np.asarray(variance * np.linalg.inv(design.T @ design)), weights


def lift_off_figure(fit: LiftOffFit) -> Figure:
    """Show lift-off points, the law through them, and what it leaves."""
    gap = Axis("distance $z$ at lift-off", "mm", 1e3)
    points = np.array([(p.gap, p.current, p.acceleration) for p in fit.points])
    at = np.linspace(0.0, 1.05 * points[:, 0].max(), 200)
    law = fit.current(at)
    # A point lies off the law for its own acceleration; that is how the residuals count.
    measured = fit.current(points[:, 0]) + fit.residuals
    return Figure(
        id="lift_off",
        title="Lift-off points and the law fitted to them",
        caption="Points as they would be without the acceleration that they were measured at.",
        panels=[
            Panel(gap, Axis("coil current $i$", "A"), [
                Line(at, law, signal="fit", label="F = k (i / (z + z_off))²"),
                Points(points[:, 0], measured, signal="measurement"),
            ]),
            Panel(gap, Axis("residual", "mA", 1e3), [
                Rule(0.0, signal="bound", label=""),
                Points(points[:, 0], fit.residuals, signal="measurement"),
            ]),
        ],
    )  # fmt: skip
