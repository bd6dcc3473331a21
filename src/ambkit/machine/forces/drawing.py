"""The force of a magnet that a machine states by its drawing."""

from __future__ import annotations

import os
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.machine.force_law import IsolatedAxis
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.patches import PatchedForce
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import conducts, dynamics_of
from ambkit.machine.magnetostatics.magnet_map import Box, MagnetMap, map_of


class ComputedForce(PatchedForce):
    """The splines between the points of a drawing's map."""

    def __init__(self, machine: IsolatedAxis, result: MagnetMap) -> None:
        self.machine, self.map = machine, result
        self.points = points_of(result)

    def __call__(self, iu: ArrayLike, x: ArrayLike) -> Array:
        return self._scale * self.map.force_at(real("iu", iu), real("x", x))


def points_of(solved: MagnetMap) -> ForcePoints:
    """Return the points of a map."""
    iu, x = np.meshgrid(solved.current, solved.displacement)
    return ForcePoints(iu.ravel(), x.ravel(), solved.force.ravel())


def load_drawing(path: str | os.PathLike[str]) -> Drawing:
    """Return the drawing in a file, checked, read once for each state of the file."""
    try:
        return _read(os.fspath(path), os.stat(path).st_mtime_ns)
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be read: {error.strerror}") from None


@lru_cache(maxsize=16)
def _read(path: str, _changed: int) -> Drawing:
    drawing = Drawing.load(path)
    drawing.check(path)
    return drawing


def stated(path: str) -> dict[str, Any]:
    """Return the keys of ``[magnet]`` that a drawing states."""
    drawing = load_drawing(path)
    lag = {}
    if conducts(drawing):
        lag["eddy_current_corner"] = engineering(dynamics_of(drawing)[1], "Hz", digits=None)
    return lag | {
        "type": drawing.geometry.sides,
        "magnet_constant": engineering(drawing.magnet_constant, "N m^2/A^2", digits=None),
        "air_gap": engineering(drawing.geometry.air_gap, "m", digits=None),
        "bias_current": engineering(drawing.winding.bias_current, "A", digits=None),
    }


def computed_force(machine: IsolatedAxis) -> ComputedForce:
    """Return the force of a drawing with the gap and bias current of a machine."""
    m = machine.magnet
    drawing = load_drawing(m.force_map)
    if drawing.geometry.air_gap != m.air_gap:
        drawing = drawing.replace(geometry__air_gap=m.air_gap)
    box = Box(m.bias_current, machine.current_min, machine.current_max, machine.clearance)
    key = drawing.key(box)
    if key not in _FORCES:
        if len(_FORCES) > 15:
            _FORCES.pop(next(iter(_FORCES)))
        _FORCES[key] = ComputedForce(machine, map_of(drawing, box))
    result = _FORCES[key]
    return result if m.force_scale is None else result.scaled(m.force_scale)


_FORCES: dict[str, ComputedForce] = {}  #: Those of this process, by what they depend on.
