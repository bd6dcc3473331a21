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


def preset(name: str) -> Machine:
    """Return a machine that comes with ambkit.

    Parameters
    ----------
    name : str
        As ``ambkit presets`` lists them, such as ``"zittau_axial"``.

    Returns
    -------
    Machine
        With one axis in its short form.

    Raises
    ------
    AmbkitError
        There is no preset of that name.

    Examples
    --------
    >>> [axis.name for axis in preset("tum_mlps").axes]
    ['A1', 'A2', 'B1', 'B2']
    """
    return Machine.preset(name)
