"""Magnet constant and effective gap of a one-sided magnet, from where a rotor lifts off.

From lift-off on nothing but gravity and the magnet acts: ``m (g - a) = k (i / (z + z_off))^2``,
with a, the acceleration away from the magnet, still small. So ``i / sqrt(m (g - a)) =
(z + z_off) / sqrt(k)`` is a straight line over the distance z, and its slope and intercept give
the magnet constant k and z_off, by which the effective gap is larger than z.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import RecordError
from ambkit.identification.forces.lift_off import LiftOff
from ambkit.machine.bearing import GRAVITY
from ambkit.result.report.figure import Figure, Panel
from ambkit.result.report.items import Axis, Line, Points, Rule


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
        return float(np.sqrt(np.mean(self.residuals**2)))

    def current(self, gap: Array | float, acceleration: Array | float = 0.0) -> Array:
        """Return the current [A] that carries the rotor at the distances `gap` [m]."""
        force = self.mass * (GRAVITY - np.asarray(acceleration))
        return np.sqrt(force / self.magnet_constant) * (np.asarray(gap) + self.gap_offset)

    def operating_point(self, gap: float) -> tuple[float, float]:
        """Return effective air gap s0 [m] and bias current i0 [A] of a bearing at z = `gap` [m]."""
        return gap + self.gap_offset, float(self.current(gap))


def fit_lift_off(
    points: Iterable[LiftOff],
    mass: float,
    *,
    gap_range: tuple[float, float] = (0.0, math.inf),
) -> LiftOffFit:
    """Fit magnet constant and gap offset to lift-off points, by robust linear least squares."""
    # Points off the line weigh less, by Huber's function with 1.345 standard deviations, these from
    # the median of the residuals (Huber, 1981, chapter 7, for the standard errors too).
    low, high = gap_range
    outside = f"outside of {1e3 * low:g} to {1e3 * high:g} mm"
    used: list[LiftOff] = []
    left_out: dict[int, str] = {}
    for point in points:
        if point.problem or not low <= point.gap <= high:
            left_out[point.run] = point.problem or outside
        else:
            used.append(point)
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
