"""The force map of a machine as a surface, cached for each file and law."""

import os
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, cast

from ambkit.base.errors import AmbkitError
from ambkit.base.progress import progress
from ambkit.machine.force_law import IsolatedAxis
from ambkit.machine.forces.force_points import ForcePoints, load_force_points
from ambkit.machine.forces.force_surface import ForceSurface


def surface_of(machine: IsolatedAxis) -> ForceSurface:
    """Return the surface of a machine's force map."""
    m = machine.magnet
    scale = 1.0 if m.force_scale is None else m.force_scale
    # For the law at the scale of the measurement: a scale changes both, and the surface is the
    # same.
    law = tuple((key, getattr(m, key)) for key in LAW)
    box = machine.current_min, machine.current_max, machine.clearance
    constant = float(f"{m.magnet_constant / scale:.12g}")
    result = _cached_surface(*_files(m.force_map, m.force_channels), constant, law, box)
    return result if scale == 1.0 else result.scaled(scale)


def surface_in(path: str | os.PathLike[str], machine: IsolatedAxis) -> ForceSurface:
    """Return the surface of another force map with the standard columns."""
    points = load_force_points(path)
    try:
        with progress("finding the force"):
            return ForceSurface(machine, points)
    except AmbkitError as error:
        raise AmbkitError(f"{path}: {error}") from None


def true_magnet(plant: Any, machine: Any) -> Any:
    """Return the true magnet of a plant with one axis, if it is a force map."""
    if plant is not None and len(machine.axes) > 1:
        count = len(machine.axes)
        raise AmbkitError(f"plant is the magnet of one axis, and {machine.name} has {count}")
    if isinstance(plant, str | os.PathLike):
        return surface_in(plant, machine.isolated_axis(machine.axes[0].name))
    return plant


def points_of(path: str, channels: str | None) -> ForcePoints:
    """Return the points of a force map, cached for each state of its files."""
    return _read(*_files(path, channels))


LAW = (
    "type", "air_gap", "bias_current", "turns", "iron_length", "relative_permeability",
    "saturation", "force_map",
)  # fmt: skip
"""Parameters of a law besides its constant."""


def _files(path: str | None, channels: str | None) -> tuple[Any, ...]:
    """Return names and times of change, so that a changed file is read again."""
    named = [name for name in (path, channels) if name is not None and os.path.exists(name)]
    return path, channels, tuple(os.stat(name).st_mtime_ns for name in named)


@lru_cache(maxsize=16)
def _read(path: str, channels: str | None, _changed: tuple[int, ...]) -> ForcePoints:
    return load_force_points(path, channels)


@lru_cache(maxsize=16)
def _cached_surface(
    path: str,
    channels: str | None,
    changed: tuple[int, ...],
    constant: float,
    law: tuple[tuple[str, Any], ...],
    box: tuple[float, float, float],
) -> ForceSurface:
    low, high, travel = box
    machine = SimpleNamespace(
        magnet=SimpleNamespace(magnet_constant=constant, **dict(law)),
        clearance=travel,
        current_min=low,
        current_max=high,
    )
    return ForceSurface(cast("IsolatedAxis", machine), _read(path, channels, changed))
