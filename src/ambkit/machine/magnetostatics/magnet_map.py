"""Force and flux linkage over currents and displacements, solved once for each drawing."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base import files
from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.field import FieldSolver

NODES = (11, 7)  #: Currents and displacements of a map.
VERSION = 2  #: Of what is computed; maps of others are solved anew.


class Box(NamedTuple):
    """Bias current and ranges of a map."""

    bias: float  #: [A]
    low: float  #: Least control current [A].
    high: float  #: Greatest [A].
    displacement_range: float  #: Greatest displacement either way [m].


@dataclass(frozen=True, eq=False)
class MagnetMap:
    """The map of one axis of a magnet, with bicubic splines between its points."""

    # The splines go through force and flux linkage times what would make them polynomials if the
    # iron were ideal.

    gap: float  #: [m]
    two_sided: bool
    current: Array  #: (n,) Control current [A].
    displacement: Array  #: (m,) [m]
    force: Array  #: (m, n) [N]
    across: Array  #: (m, n) Force along the other axis [N]; 0 where there is none.
    flux: Array  #: (m, n) Flux linkage that works on the control current [Vs].

    def __len__(self) -> int:
        return self.force.size

    def _weight(self, x: Array, power: int) -> Array:
        weight = (1 - x / self.gap) ** power
        return weight * (1 + x / self.gap) ** power if self.two_sided else weight

    @cached_property
    def _splines(self) -> tuple[Any, Any]:
        from scipy.interpolate import RectBivariateSpline

        rows = self.displacement[:, None]
        return (
            RectBivariateSpline(
                self.displacement, self.current, self.force * self._weight(rows, 2)
            ),
            RectBivariateSpline(self.displacement, self.current, self.flux * self._weight(rows, 1)),
        )

    def force_at(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the force [N] at places (iu [A], x [m]), of shapes that broadcast."""
        iu, x = np.broadcast_arrays(np.asarray(iu, float), np.asarray(x, float))
        return np.asarray(self._splines[0].ev(x, iu) / self._weight(x, 2))

    def flux_at(self, iu: ArrayLike, x: ArrayLike) -> Array:
        """Return the flux linkage [Vs] at places (iu [A], x [m]), of shapes that broadcast."""
        iu, x = np.broadcast_arrays(np.asarray(iu, float), np.asarray(x, float))
        return np.asarray(self._splines[1].ev(x, iu) / self._weight(x, 1))

    def loop_work(self) -> float:
        """Return the work of a loop around the map, in parts of that of its largest leg."""
        iu, x = (np.linspace(axis[0], axis[-1], 401) for axis in (self.current, self.displacement))
        legs = [
            np.trapezoid(self.force_at(iu[-1], x), x), -np.trapezoid(self.force_at(iu[0], x), x),
            np.trapezoid(self.flux_at(iu, x[0]), iu), -np.trapezoid(self.flux_at(iu, x[-1]), iu),
        ]  # fmt: skip
        return float(abs(sum(legs)) / np.abs(legs).max())


def map_of(drawing: Drawing, box: Box | None = None, nodes: tuple[int, int] = NODES) -> MagnetMap:
    """Return the map of a drawing, from the cache where it was solved before."""
    w = drawing.winding
    one_sided = drawing.geometry.sides == "one-sided"
    low = -min(w.limit, w.bias_current) if one_sided else -w.limit
    box = Box(w.bias_current, low, w.limit, drawing.displacement_range) if box is None else box
    about = drawing.geometry.air_gap, not one_sided
    arrays = kept(drawing.key(box, nodes, VERSION), lambda: _solved(drawing, box, nodes))
    return MagnetMap(*about, *arrays)


def kept(key: str, solve: Callable[[], tuple[Array, ...]]) -> tuple[Array, ...]:
    """Return arrays from the user's cache, solved where they are not in it."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ambkit" / "magnets"
    path = root / f"{key}.npz"
    with suppress(OSError, ValueError, KeyError, EOFError, BadZipFile), np.load(path) as file:
        return tuple(file[name] for name in file.files)
    arrays = solve()
    with suppress(OSError, AmbkitError):
        files.make_folder(root)
        with files.replacing(path) as temporary, temporary.open("wb") as opened:
            np.savez(opened, *arrays)
    return arrays


def _solved(drawing: Drawing, box: Box, nodes: tuple[int, int]) -> tuple[Array, ...]:
    """Solve the points of a map; half of them where the others follow by symmetry."""
    current = np.linspace(box.low, box.high, nodes[0])
    displacement = -box.displacement_range * np.cos(np.pi * np.arange(nodes[1]) / (nodes[1] - 1))
    displacement[nodes[1] // 2] *= nodes[1] % 2 == 0  # the middle is 0
    opposed = drawing.layout.opposed
    mirrored = drawing.geometry.sides == "two-sided" and not opposed and -box.low == box.high
    begin = nodes[0] // 2 if mirrored else 0
    result = np.zeros((3, nodes[1], nodes[0]))
    with progress("solving the magnetic field", nodes[1] * (nodes[0] - begin)) as done:
        solver = FieldSolver(drawing.layout)
        for row, x in enumerate(displacement):
            start = None
            for column in range(begin, nodes[0]):
                iu = float(current[column])
                force, flux, start = _point(solver, box.bias, iu, float(x), start)
                result[:, row, column] = force[0], force[-1] if len(force) > 1 else 0.0, flux
                done()
    if opposed:  # the same core behind the rotor, with the other current and displacement
        result = result + np.array([-1, 1, -1])[:, None, None] * result[:, ::-1, ::-1]
    if mirrored:
        result[:, :, :begin] = -result[:, ::-1, : -begin - 1 : -1]
    return current, displacement, *result


def _point(
    solver: FieldSolver, bias: float, iu: float, x: float, start: Array | None
) -> tuple[Array, float, Array]:
    layout = solver.layout
    currents = bias * layout.bias + iu * layout.control[0]
    s = solver.at(x * layout.directions[0]).solve(currents, start)
    return s.force, float(layout.control[0] @ s.flux), s.a


def points_between(drawing: Drawing, result: MagnetMap, bias: float, count: int = 8) -> Array:
    """Return currents, displacements and forces (3, count) solved between the points of a map."""
    random = np.random.default_rng(1)
    axes = result.current, result.displacement
    middles = [np.resize(random.permutation(0.5 * (a[1:] + a[:-1])), count) for a in axes]
    at = list(zip(*(m.tolist() for m in middles), strict=True))
    solver, forces = FieldSolver(drawing.layout), []
    for iu, x in at:
        force = _point(solver, bias, iu, x, None)[0][0]
        if drawing.layout.opposed:
            force -= _point(solver, bias, -iu, -x, None)[0][0]
        forces.append(float(force))
    return np.array([*zip(*at, strict=True), forces])
