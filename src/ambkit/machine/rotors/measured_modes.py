"""Shapes of modes through measured points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambkit.base.arrays import Array


class ThroughPoints:
    """Shapes of modes that were measured at some places, between them by natural cubic splines."""

    # largest (modes,) What the deflections are divided by.

    def __init__(
        self, points: Sequence[tuple[Sequence[float], Sequence[float]]], largest: Array
    ) -> None:
        from scipy.interpolate import CubicSpline

        self.splines = [
            CubicSpline(places, np.asarray(values, float) / size, bc_type="natural")
            for (places, values), size in zip(points, largest, strict=True)
        ]

    def __call__(self, place: float) -> Array:
        """Return each mode's deflection (modes,) [1] at a place [m]."""
        return np.array([float(spline(place)) for spline in self.splines])
