"""The recordings that come with ambkit, from ``examples/recordings``: logs of a real rig."""

from pathlib import Path

from ambkit.base import files


def folder() -> Path:
    """Return the folder with the recordings."""
    return files.installed_folder("recordings", "examples/recordings")
