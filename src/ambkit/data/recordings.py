"""The recordings of a real rig in ``examples/recordings``."""

from pathlib import Path

from ambkit.base import files


def folder() -> Path:
    """Return the folder with the recordings."""
    return files.installed_folder("recordings", "examples/recordings")
