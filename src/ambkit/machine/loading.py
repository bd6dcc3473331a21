"""A machine by its name: a preset, or a TOML file, in the short form of one axis or in the long."""

from __future__ import annotations

import os

from ambkit.base import files
from ambkit.base.config import toml_text
from ambkit.machine import presets
from ambkit.machine.bearing import Bearing
from ambkit.machine.machine import Machine, short_form


def load_machine(name: str | os.PathLike[str]) -> Bearing | Machine:
    """Return a preset, or the machine in a file; of a single axis its short form."""
    if name in presets.names():
        return Bearing.preset(str(name))
    if name in presets.machine_names():
        return short_form(Machine.preset(str(name)))
    if is_short(name):
        return Bearing.load(name)
    return short_form(Machine.load(name))


def is_short(path: str | os.PathLike[str]) -> bool:
    """Whether a file describes a machine in its short form: the sensor is a table, no list."""
    data = toml_text.parse(files.read_text(path)).data or {}
    return isinstance(data.get("sensor", {}), dict) and not isinstance(data.get("bearing"), list)
