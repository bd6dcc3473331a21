"""Force of a magnet that a machine describes by its drawing."""

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array, real
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.machine.force_law import IsolatedAxis, Law
from ambkit.machine.forces.fitted_law import law_errors, preferred
from ambkit.machine.forces.force_points import ForcePoints
from ambkit.machine.forces.patches import PatchedForce
from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import conducts, dynamics_of
from ambkit.machine.magnetostatics.magnet_map import (
    Box,
    MagnetMap,
    TwoAxisMap,
    map_of,
    two_axis_map,
)


class ComputedForce(PatchedForce):
    """The map of a drawing."""

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
    """Return the drawing in a file, checked, and cached for each state of the file."""
    try:
        return _read(os.fspath(path), os.stat(path).st_mtime_ns)
    except OSError as error:
        raise AmbkitError(f"{path}: cannot be read: {error.strerror}") from None


@lru_cache(maxsize=16)
def _read(path: str, _changed: int) -> Drawing:
    drawing = Drawing.load(path)
    drawing.check(path)
    return drawing


def stated_by(path: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys of ``[magnet]`` that follow from a drawing with some changes."""
    drawing = drawing_of(path, changes)
    lag = {}
    if conducts(drawing):
        dynamics = dynamics_of(drawing)
        if dynamics.laminated:
            seconds = float(1 / (2 * np.pi * dynamics.corner))
            lag["eddy_current_lag"] = engineering(seconds, "s", digits=None)
        else:
            lag["eddy_current_corner"] = engineering(dynamics.corner, "Hz", digits=None)
    return lag | {
        "type": drawing.geometry.sides,
        "magnet_constant": engineering(drawing.magnet_constant, "N m^2/A^2", digits=None),
        "air_gap": engineering(drawing.geometry.air_gap, "m", digits=None),
        "bias_current": engineering(drawing.bias_current, "A", digits=None),
    }


def drawing_of(path: str, changes: Mapping[str, Any]) -> Drawing:
    """Return the drawing in a file with changed values at some dotted keys."""
    drawing = load_drawing(path)
    if not changes:
        return drawing
    made = drawing.replace(**changes)
    made.check(path)
    return made


def computed_force(machine: IsolatedAxis) -> Law:
    """Return the force of a drawing with the tolerances of a machine, by its preferred law."""
    m = machine.magnet
    drawing, changes = load_drawing(m.force_map), _changes(m)
    ends = machine.current_min, machine.current_max, machine.clearance
    scale = 1.0 if m.force_scale is None else m.force_scale
    about = m.type, m.magnet_constant, m.bias_current
    return _force(drawing, about, tuple(changes.items()), ends, scale)


def computed_force_of_both(machine: IsolatedAxis) -> TwoAxisMap:
    """Return the force of a drawing over both axes with the tolerances of a machine."""
    m = machine.magnet
    drawing = load_drawing(m.force_map)
    if len(drawing.layout.directions) < 2:
        raise AmbkitError(
            f"{m.force_map}: both_axes: a {drawing.geometry.type} magnet has one axis"
        )
    ends = machine.current_min, machine.current_max, machine.clearance
    box = _box(drawing, *ends)._replace(bias=m.bias_current)
    result = two_axis_map(drawing.replace(**_changes(m)), box)
    return result if m.force_scale is None else result.scaled(m.force_scale)


def _changes(magnet: Any) -> dict[str, Any]:
    """Return the values, in SI, in which a machine's drawing differs from the file."""
    drawing, own = load_drawing(magnet.force_map), dict(magnet.drawing)
    other = drawing.replace(**own) if own else drawing
    changes = {key: value_in(other, key) for key in own} | {"geometry.air_gap": magnet.air_gap}
    share, permanent = magnet.bias_current / other.bias_current, other.geometry.permanent
    if permanent is None:
        return changes | {"winding.bias_current": share * (other.winding.bias_current or 0.0)}
    if share == 1.0:
        return changes
    changes = {key: new for key, new in changes.items() if not key.startswith("geometry.magnet")}
    return changes | {"geometry.magnet": permanent.scaled(share)}  # with the strength of the bias


@lru_cache(maxsize=16)
def _force(
    drawing: Drawing, about: tuple[str, float, float], changes: tuple[tuple[str, Any], ...],
    ends: tuple[float, float, float], scale: float,
) -> Law:  # fmt: skip
    of, (sides, constant, bias) = dict(changes), about
    gap = of["geometry.air_gap"]
    magnet = SimpleNamespace(
        type=sides, magnet_constant=constant / scale, air_gap=gap, bias_current=bias
    )
    solved = map_near(drawing, of, _box(drawing, *ends))
    best = preferred(law_errors(magnet, solved)) if solved.left_out.size else None
    if best is not None and best.law is not None:
        best.law.machine.magnet.magnet_constant *= scale
        return best.law
    low, high, clearance = ends
    machine = SimpleNamespace(magnet=magnet, current_min=low, current_max=high, clearance=clearance)
    result = ComputedForce(cast("IsolatedAxis", machine), solved)
    return result if scale == 1.0 else result.scaled(scale)


def _box(drawing: Drawing, low: float, high: float, clearance: float) -> Box:
    """Return the range of a map that covers a machine's, shared by machines that differ little."""
    bias, gap = drawing.bias_current, drawing.geometry.air_gap

    def steps(value: float, step: float) -> float:
        return step * float(np.ceil(value / step - 1e-9))

    far = steps(clearance, gap / 20)
    far = far if far < 0.95 * gap else clearance
    return Box(bias, -steps(-low, bias / 10), steps(high, bias / 10), far)


STEP, MOST = 0.04, 0.1  #: Relative step of the differences, and their range of validity.
ROUGH = (7, 5), 0.5  #: Nodes and fineness of the maps for differences.


def value_in(drawing: Drawing, key: str) -> Any:
    """Return the value at a dotted key."""
    here: Any = drawing
    for step in key.split("."):
        here = getattr(here, step)
    return here


def map_near(drawing: Drawing, changes: Mapping[str, Any], box: Box) -> MagnetMap:
    """Return the map of a drawing with other values at some dotted keys."""
    near = {}
    for key, new in changes.items():
        old = value_in(drawing, key)
        if isinstance(old, float) and 0 < abs(new - old) <= MOST * abs(old):
            near[key] = new
        elif new != old:  # too different, or not a number
            drawing = drawing.replace(**{key: new})
    base = _map(drawing, box)
    if not near:
        return base
    weighted = _weighted(base, base)
    for key, new in near.items():
        first, second, step = _differences(drawing, box, key)
        t = (new - value_in(drawing, key)) / step
        weighted = weighted + t * (first + t * second)
    gap = near.get("geometry.air_gap", base.gap)
    result = replace(base, gap=gap, left_out=np.empty((3, 0)))
    w = result.weight(base.displacement)[0][:, None]
    return replace(result, force=weighted[0] / w**2, flux=weighted[1] / w)


@lru_cache(maxsize=64)
def _map(drawing: Drawing, box: Box, *how: Any) -> MagnetMap:
    box = box._replace(bias=drawing.bias_current)
    return map_of(drawing, box, *how)


@lru_cache(maxsize=64)
def _differences(drawing: Drawing, box: Box, key: str) -> tuple[Array, Array, float]:
    """Return the first and second difference by the value at a key, and its step."""
    base, old = _map(drawing, box), value_in(drawing, key)
    step = STEP * abs(old)
    less, middle, more = (
        _weighted(_map(drawing.replace(**{key: old + by}) if by else drawing, box, *ROUGH), base)
        for by in (-step, 0, step)
    )
    return 0.5 * (more - less), 0.5 * (more - 2 * middle + less), step


def _weighted(result: MagnetMap, base: MagnetMap) -> Array:
    """Return force and flux linkage at the points of another map, without the poles at the gap."""
    x = base.displacement[:, None]
    w = result.weight(x)[0]
    return np.stack([result.force_at(base.current, x) * w**2, result.flux_at(base.current, x) * w])
