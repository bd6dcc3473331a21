"""A machine by its name: a preset, or a TOML file."""

from __future__ import annotations

import os

from ambkit.machine import presets
from ambkit.machine.machine import Machine


def load_machine(name: str | os.PathLike[str]) -> Machine:
    """Return a preset, or the machine in a file; of a single axis its short form."""
    if name in presets.all_names():
        return Machine.preset(str(name))
    return Machine.load(name).short
