"""A machine by its name: a preset, or a TOML file."""

from __future__ import annotations

import difflib
import os
from pathlib import Path

from ambkit.base.errors import AmbkitError
from ambkit.machine import presets
from ambkit.machine.machine import Machine


def load_machine(name: str | os.PathLike[str]) -> Machine:
    """Return a preset, or the machine in a file; of a single axis its short form."""
    known, text = presets.all_names(), os.fspath(name)
    if text in known:
        return Machine.preset(text)
    if Path(text).suffix == ".toml" or os.sep in text or Path(text).exists():
        return Machine.load(name).short
    near = difflib.get_close_matches(text, known, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(known)}"
    raise AmbkitError(f'there is no preset and no file "{text}"; {hint}')
