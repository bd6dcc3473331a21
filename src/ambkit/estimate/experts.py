"""What a file knows of a machine's magnets: an expert, or a force map."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

from ambkit.base.errors import AmbkitError
from ambkit.fuzzy.expert import Expert
from ambkit.machine.force_laws import bank_of, isolated_axes
from ambkit.machine.forces.force_map import surface_in

if TYPE_CHECKING:
    from ambkit.machine.forces.force_surface import ForceSurface
    from ambkit.machine.machine import Bearing, Machine
    from ambkit.machine.magnets import MagnetModel

EXPERTS = (".json", ".csv", ".parquet")
"""Endings of an expert's file, and of the points of a force map."""


def experts(path: Path, machine: Machine) -> MagnetModel:
    """Return the expert in a file for each axis of a machine, whose magnets must be alike."""
    axes = isolated_axes(machine)
    other = next((b.name for b in axes if b.magnet != axes[0].magnet), None)
    if other is not None:
        raise AmbkitError(
            f"{path}: an expert is of one magnet, and the axes {axes[0].name} and {other} of "
            f"{machine.name} have different ones"
        )
    return bank_of([read_expert(path, axes[0])] * len(axes), machine)


def read_expert(path: Path, bearing: Bearing) -> Expert | ForceSurface:
    """Return the expert in a file, or the surface through the points of a force map."""
    if path.suffix.lower() != ".json":
        return surface_in(path, bearing)
    trained = Expert.load(path)
    if not trained.source.startswith(bearing.name):
        logging.getLogger("ambkit").warning(
            "%s: was trained for %s, not for %s", path, trained.source, bearing.name
        )
    return trained
