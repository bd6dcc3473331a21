"""The recordings that come with ambkit: a small part of the logs of a real rig.

They stand in ``examples/recordings`` of the repository, with their origin and licence, and are
installed beside the package.
"""

from pathlib import Path

from ambkit.base.errors import AmbkitError

_PACKAGE = Path(__file__).parents[1]
_FOLDERS = (_PACKAGE / "recordings", _PACKAGE.parents[1] / "examples" / "recordings")


def folder() -> Path:
    """Return the folder with the recordings."""
    for candidate in _FOLDERS:
        if candidate.is_dir():
            return candidate
    raise AmbkitError(f"the recordings that come with ambkit are not there: {_FOLDERS[0]}")
