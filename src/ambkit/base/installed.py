"""Folders of the repository that are installed beside the package."""

from pathlib import Path

from ambkit.base.errors import AmbkitError

_PACKAGE = Path(__file__).parents[1]


def folder(name: str, source: str) -> Path:
    """Return a folder by its name beside the package, or by its place in the repository."""
    for candidate in (_PACKAGE / name, _PACKAGE.parents[1] / source):
        if candidate.is_dir():
            return candidate
    raise AmbkitError(f"a folder that comes with ambkit is not there: {_PACKAGE / name}")
