"""The recordings that come with ambkit, from ``examples/recordings``: logs of a real rig."""

from pathlib import Path

from ambkit.base import installed


def folder() -> Path:
    """Return the folder with the recordings."""
    return installed.folder("recordings", "examples/recordings")
