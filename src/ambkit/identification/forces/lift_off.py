"""Lift-off point of a rotor in a recording with rising current.

The rotor lies at a distance z below a one-sided magnet while the current rises, until the magnet
carries its weight.
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
"""Window of the parabola for the acceleration [s]."""

RESTING_TIME = 0.5  #: Initial time during which the rotor rests [s].

FLIGHT = 0.05
"""Upward acceleration, over gravity, above which the rotor has lifted off."""


@dataclass(frozen=True)
class LiftOff:
    """A lift-off: the last instant near equilibrium."""

    run: int  #: Number of the recording.
    gap: float  #: Distance z from the magnet [m].
    current: float  #: Coil current [A].
    acceleration: float  #: Acceleration along z, away from the magnet [m/s^2].
    resting_gap: float  #: Distance before it moved [m].
    #: Variance of the measured distance at rest [m^2]; NaN if unknown.
    noise_variance: float
    problem: str = ""  #: Reason why it is unusable; else empty.


def find_lift_off(record: Record, run: int = 0) -> LiftOff:
    """Return the lift-off point in a recording with rising current."""
    # The rotor often creeps before it lifts off, so the distance at rest is not the one at
    # lift-off. The point is the last sample in the first half of the travel with an acceleration
    # towards the magnet below 5 % of gravity; acceleration, distance and current are those of a
    # parabola through the samples around it (Savitzky and Golay, 1964).
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
    """Read a file written by `save_points`."""
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
    #: Of ``magnet_constant`` and ``gap_offset``, in their units, for independent residuals; if the
    #: law is wrong they are too small.
    standard_errors: Mapping[str, float]
    residuals: Array  #: (n,) Measured current minus that of the law [A], at `points`.
    weights: Array  #: (n,) Weight of each point, below 1 for outliers.
    points: tuple[LiftOff, ...]  #: Points in the fit.
    left_out: Mapping[int, str]  #: Numbers of unused recordings, with reasons.
    mass: float  #: Mass of the rotor [kg].

    @property
    def residual_rms(self) -> float:
        """Root mean square residual of the current [A]."""
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
    # Outliers have less weight, by Huber's function with 1.345 standard deviations, from the median
    # of the residuals (Huber, 1981, chapter 7, also for the standard errors).
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
    """Plot lift-off points, the fitted law, and the residuals."""
    gap = Axis("distance $z$ at lift-off", "mm", 1e3)
    points = np.array([(p.gap, p.current, p.acceleration) for p in fit.points])
    at = np.linspace(0.0, 1.05 * points[:, 0].max(), 200)
    law = fit.current(at)
    # A point deviates from the law by its own acceleration; the residuals include that.
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
