"""The rotor: ``M q'' + (D + speed G) q' + (K + speed N) q`` = what pushes it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ambkit.models.parts.typical import Typical
from ambkit.models.plan import UNIT, Plan

Entries = Mapping[tuple[int, int], float]
"""Entries of a matrix by row and column; what is listed is in the pattern, zero or not."""


@dataclass(frozen=True)
class Rotor:
    """A rotor of several coordinates; one mass of one axis by default."""

    mass: float | Entries
    """Mass [kg], or entries of M [kg], of an angle [kg m^2]."""
    size: float
    """Typical displacement [m]."""
    speed_size: float
    """Typical velocity [m/s]."""
    positions: tuple[str, ...] = ("x",)
    """Names of the coordinates q."""
    velocities: tuple[str, ...] = ("v",)
    """Names of q'."""
    turns: tuple[bool, ...] = ()
    """Which coordinates are angles [rad]; without it all are displacements [m]."""
    lever: float = 1.0
    """Where an angle of 1 rad moves the rotor by so much [m], for typical sizes."""
    bends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Of coordinates by which the rotor bends, typical displacement [m] and velocity [m/s]."""
    damping: Entries = field(default_factory=dict)
    """Entries of D [N s/m]."""
    gyroscopic: Entries = field(default_factory=dict)
    """Entries of G [N s^2/m]."""
    stiffness: Entries = field(default_factory=dict)
    """Entries of K [N/m]."""
    circulatory: Entries = field(default_factory=dict)
    """Entries of N [N s/m]: what damps within the rotor turns with it."""
    speed: float = 0.0
    """Speed of rotation [rad/s]."""

    @classmethod
    def of_axis(cls, bearing: Any, typical: Typical) -> list[Rotor]:
        """Return the mass of one axis."""
        return [cls(bearing.rotor.mass, typical.displacement, typical.velocity)]

    def declare(self, plan: Plan) -> None:
        """Add q, then q'."""
        turns = self.turns or (False,) * len(self.positions)
        for k, (names, unit, size, roles) in enumerate((
            (self.positions, "", self.size, ("position", "bending")),
            (self.velocities, "/s", self.speed_size, ("velocity", "bending velocity")),
        )):  # fmt: skip
            for name, position, turn in zip(names, self.positions, turns, strict=True):
                each = size / self.lever if turn else size
                bent = self.bends.get(position)
                each, role = (each, roles[0]) if bent is None else (bent[k], roles[1])
                plan.state(name, ("rad" if turn else "m") + unit, each, role)
        pairs = list(zip(self.positions, self.velocities, strict=True))
        for position, velocity in pairs:
            plan.rate(position, velocity, UNIT)
        inverse = self._inverse_mass()
        for j, (position, _) in enumerate(pairs):
            plan.inertia[position] = {
                self.velocities[i]: value for (i, k), value in inverse.items() if k == j
            }
        driven = (
            (self.damping, self.velocities, 1.0),
            (self.gyroscopic, self.velocities, self.speed),
            (self.stiffness, self.positions, 1.0),
            (self.circulatory, self.positions, self.speed),
        )
        for entries, sources, scale in driven:
            for (k, j), value in entries.items():
                for (i, pushed), moved in inverse.items():
                    if pushed == k:
                        plan.rate(self.velocities[i], sources[j], -moved * scale * value)

    def _inverse_mass(self) -> dict[tuple[int, int], float]:
        """Return entries of the inverse of M: all within a group that M couples."""
        n = len(self.positions)
        if not isinstance(self.mass, Mapping) and n == 1 and np.all(self.mass > 0):
            return {(0, 0): 1 / self.mass}
        entries = self.mass if isinstance(self.mass, Mapping) else {(0, 0): self.mass}
        M, joined = np.zeros((n, n)), np.eye(n, dtype=bool)
        for (i, j), value in entries.items():
            M[i, j], joined[i, j], joined[j, i] = value, True, True
        if (M != M.T).any() or np.linalg.eigvalsh(M).min() <= 0:
            raise ValueError(f"mass must be symmetric and positive definite, is {M.tolist()}")
        joined = np.linalg.matrix_power(joined.astype(np.int64), n) > 0
        inverse = np.linalg.inv(M)
        return {(int(i), int(j)): float(inverse[i, j]) for i, j in np.argwhere(joined)}
