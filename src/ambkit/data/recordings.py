"""The recordings that come with ambkit: a small part of the logs of a real rig.

They stand in ``examples/recordings`` of the repository, with their origin and licence, and are
installed beside the package.
"""

from pathlib import Path

from ambkit.base import installed


def folder() -> Path:
    """Return the folder with the recordings."""
    return installed.folder("recordings", "examples/recordings")
