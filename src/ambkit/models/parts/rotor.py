"""The rotor: ``M q'' + (D + speed G) q' + (K + speed N) q`` = forces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ambkit.machine.geometry import masses, modal_positions, static_deflection
from ambkit.machine.rotors.modes import Bending
from ambkit.models.declaration import UNIT, Plan
from ambkit.models.parts.typical_sizes import Typical

Entries = Mapping[tuple[int, int], float]
"""Entries of a matrix by row and column; listed ones are in the pattern, zero or not."""


@dataclass(frozen=True)
class Rotor:
    """A rotor with several coordinates; by default a mass with one."""

    mass: float | Entries  #: Mass [kg], or entries of M [kg], of an angle [kg m^2].
    size: float  #: Typical displacement [m].
    speed_size: float  #: Typical velocity [m/s].
    positions: tuple[str, ...] = ("x",)  #: Names of the coordinates q.
    velocities: tuple[str, ...] = ("v",)  #: Names of q'.
    turns: tuple[bool, ...] = ()  #: Which coordinates are angles [rad]; empty: none.
    lever: float = 1.0  #: Displacement per radian [m], for typical sizes.
    bends: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Typical displacement [m] and velocity [m/s] of the modal coordinates."""
    damping: Entries = field(default_factory=dict)  #: Entries of D [N s/m].
    gyroscopic: Entries = field(default_factory=dict)  #: Entries of G [N s^2/m].
    stiffness: Entries = field(default_factory=dict)  #: Entries of K [N/m].
    circulatory: Entries = field(default_factory=dict)
    """Entries of N [N s/m]: from rotating damping."""
    speed: float = 0.0  #: Speed of rotation [rad/s].

    @classmethod
    def of(cls, machine: Any, sizes: Sequence[Typical]) -> list[Rotor]:
        """Return it with gyroscopics at the machine's speed, and bending modes."""
        way, fast = max(s.displacement for s in sizes), max(s.velocity for s in sizes)
        if machine.rotor.type == "mass":  # called for each run of a campaign
            return [
                cls({(0, 0): machine.rotor.mass}, way, fast, turns=(False,), speed=machine.speed)
            ]
        positions = machine.positions
        max_lever = max(
            (abs(a.line.place) for a in machine.axes if not (a.line.axial or a.line.translation)),
            default=1.0,
        )
        at = {q: k for k, q in enumerate(positions)}
        polar = {("th_x", "th_y"): machine.rotor.polar_inertia} if "th_x" in positions else {}
        stiffness: dict[str, float] = {}
        damping: dict[tuple[str, str], float] = {}
        circulatory: dict[tuple[str, str], float] = {}
        bends: dict[str, tuple[float, float]] = {}
        bending = machine.bending
        if bending is not None:
            stiffness = dict(
                zip(modal_positions(bending), bending.stiffness.repeat(2), strict=True)
            )
            bends = _typical_bendings(machine, sizes)
            polar, damping = _coupled(bending)
            circulatory = _circulatory(bending)
        by_position = masses(machine.rotor, positions, bending)
        entries = {(k, k): value for k, value in enumerate(by_position.values())}
        own = cls(
            entries, way, fast, positions, velocities_of(positions), speed=machine.speed,
            gyroscopic={(at[i], at[j]): g for (i, j), g in polar.items()}
            | {(at[j], at[i]): -g for (i, j), g in polar.items()},
            stiffness={(at[q], at[q]): float(k) for q, k in stiffness.items()},
            damping={(at[i], at[j]): d for (i, j), d in damping.items()},
            circulatory={(at[i], at[j]): n for (i, j), n in circulatory.items()},
            turns=tuple(q.startswith("th") for q in positions), lever=max_lever, bends=bends,
        )  # fmt: skip
        return [own]

    def declare(self, plan: Plan) -> None:
        """Add q, then q'."""
        turns = self.turns or (False,) * len(self.positions)
        for k, (names, unit, size, roles) in enumerate((
            (self.positions, "", self.size, ("position", "bending")),
            (self.velocities, "/s", self.speed_size, ("velocity", "bending velocity")),
        )):  # fmt: skip
            for name, position, turn in zip(names, self.positions, turns, strict=True):
                parts = size / self.lever if turn else size
                bent = self.bends.get(position)
                parts, role = (parts, roles[0]) if bent is None else (bent[k], roles[1])
                plan.state(name, ("rad" if turn else "m") + unit, parts, role)
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
                for (i, column), moved in inverse.items():
                    if column == k:
                        plan.rate(self.velocities[i], sources[j], -moved * scale * value)

    def _inverse_mass(self) -> dict[tuple[int, int], float]:
        """Return entries of the inverse of M: all within a group coupled by M."""
        n = len(self.positions)
        entries = self.mass if isinstance(self.mass, Mapping) else {(0, 0): self.mass}
        if all(i == j for i, j in entries) and np.all([value > 0 for value in entries.values()]):
            # also for many machines at once
            return {place: 1 / value for place, value in entries.items()}
        M, joined = np.zeros((n, n)), np.eye(n, dtype=bool)
        for (i, j), value in entries.items():
            M[i, j], joined[i, j], joined[j, i] = value, True, True
        if (M != M.T).any() or np.linalg.eigvalsh(M).min() <= 0:
            raise ValueError(f"mass must be symmetric and positive definite, is {M.tolist()}")
        joined = np.linalg.matrix_power(joined.astype(np.int64), n) > 0
        inverse = np.linalg.inv(M)
        return {(int(i), int(j)): float(inverse[i, j]) for i, j in np.argwhere(joined)}


def velocities_of(positions: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the derivatives: ``v_x``, ``w_x`` of ``th_x``; for a mass ``v``."""
    if positions == ("x",):
        return ("v",)
    return tuple(f"w_{q[3:]}" if q.startswith("th_") else f"v_{q}" for q in positions)


def _coupled(bending: Bending) -> tuple[dict[tuple[str, str], float], dict[tuple[str, str], float]]:
    """Return entries of G and D, with the transposed ones."""
    # In one plane the slopes are th_y and those of the modes, in the other -th_x and those.
    planes = [
        [("x", 1.0), ("th_y", 1.0), *((f"{name}_x", 1.0) for name in bending.names)],
        [("y", 1.0), ("th_x", -1.0), *((f"{name}_y", 1.0) for name in bending.names)],
    ]
    polar = {
        (i, j): float(bending.polar[k, m] * si * sj)
        for k, (i, si) in enumerate(planes[0][1:])
        for m, (j, sj) in enumerate(planes[1][1:])
        if bending.polar[k, m]
    }
    every = bending.damping.copy()
    every[2:, 2:] += bending.internal
    damping = {
        (i, j): float(every[k, m] * si * sj)
        for plane in planes
        for k, (i, si) in enumerate(plane)
        for m, (j, sj) in enumerate(plane)
        if every[k, m]
    }
    return polar, damping


def _circulatory(bending: Bending) -> dict[tuple[str, str], float]:
    """Return entries of N: the part of D_internal (q' - speed J q) without q'."""
    # J rotates from x towards y. A deflection at rest in the fixed frame moves relative to the
    # rotating material, which drives whirls slower than the rotor.
    results: dict[tuple[str, str], float] = {}
    for k, m in np.argwhere(bending.internal):
        one, other, value = bending.names[k], bending.names[m], float(bending.internal[k, m])
        results |= {(f"{one}_x", f"{other}_y"): value, (f"{one}_y", f"{other}_x"): -value}
    return results


LEAST_BENT = 1 / 30  #: Minimum typical deflection of a mode, over the clearance.


def _typical_bendings(machine: Any, sizes: Sequence[Typical]) -> dict[str, tuple[float, float]]:
    """Return typical displacement and velocity of modes [m], [m/s], at maximum magnet force."""
    bending, positions = machine.bending, modal_positions(machine.bending)
    least = LEAST_BENT * min(s.displacement for s in sizes)
    most = np.full(len(positions), least)
    for k, size in enumerate(sizes):
        pull = size.force * np.eye(len(sizes))[k]
        most = np.maximum(most, np.abs(static_deflection(machine, pull)))
    rates = bending.frequency.repeat(2)
    return {
        q: (float(far), float(far * rate))
        for q, far, rate in zip(positions, most, rates, strict=True)
    }
