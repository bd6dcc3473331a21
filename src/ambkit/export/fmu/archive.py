"""A ZIP archive whose bytes depend on its content alone."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

from ambkit.base import files

_LONG_AGO = (1980, 1, 1, 0, 0, 0)  # the earliest time that ZIP knows


def write(path: Path, content: Mapping[str, bytes]) -> None:
    """Write files, in alphabetical order and without their times, to an archive."""
    with files.replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in sorted(content):
            entry = zipfile.ZipInfo(name, _LONG_AGO)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3  # Unix, wherever this runs
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, content[name])
